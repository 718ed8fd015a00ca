//! What happens when the gyroscope clips: nothing, or what the float filters do.

use nalgebra::Vector3;

use super::estimator::{Counts, Scale};
use super::number::Q20;
use super::rotation::{BIAS_BITS, Products};
use crate::quaternion::HalfRows;
use crate::range::{Hidden, Range};
use crate::real::{Number, sealed};
use crate::recovery::{Recovery, Seen};

/// Largest part of a correction that one step takes, half an angle in Q31: a sixteenth of a radian.
const MOST: i32 = 1 << 27;

/// Field counts are brought to parts of this, uT: squares of the earth's field would not fit.
const FIELD_UT: f32 = 64.0;

/// What an estimator does when rates clip: [`Ignored`] or [`Recovered`].
pub trait OverRange: sealed::Sealed {
    /// One step.
    #[doc(hidden)]
    fn step(&mut self, step: &Step<'_>) -> Found;

    /// A rate is clipped, or was so lately.
    fn is_active(&self) -> bool;
}

/// What an estimator knows at the end of a step.
pub struct Step<'a> {
    pub(super) dt_us: u32,
    pub(super) counts: &'a Counts,
    pub(super) products: &'a Products,
    /// Offset of the gyroscope, counts with `BIAS_BITS`.
    pub(super) bias: &'a [i32; 3],
    /// The field's reference: north and down, counts.
    pub(super) field: Option<[i32; 2]>,
    /// By how much the gains are larger than the filter's own, as a power of two.
    pub(super) boost: i32,
}

/// What is to be done about it.
#[derive(Default)]
pub struct Found {
    /// A correction, half a rotation vector in the body frame, Q31 rad.
    pub(super) correction: [i32; 3],
    /// Gains that much larger than the filter's own, as a power of two, for so many blocks, then half of that.
    pub(super) settle: Option<(i32, u32)>,
}

/// Clipping is not looked for: where the gyroscope measures all that the body does. It costs nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ignored;

impl sealed::Sealed for Ignored {}

impl OverRange for Ignored {
    #[inline(always)]
    fn step(&mut self, _: &Step<'_>) -> Found {
        Found::default()
    }

    #[inline(always)]
    fn is_active(&self) -> bool {
        false
    }
}

/// Clipping is found, and the rotation that it hid, by the same steps as in float.
#[derive(Clone, Debug)]
pub struct Recovered {
    range: Range<Q20>,
    recovery: Recovery<Q20>,
    gyr: i32,
    acc: i32,
    field: i32,
    /// Time since the last field.
    field_dt: Q20,
    /// What the steps so far were too short for, half an angle about the body's axes in Q31.
    owed: [i32; 3],
    per_density: Q20,
    /// Twice the smaller one of the filter's gains, 1/s: where the next power of two begins.
    slow_per_s: Q20,
    blocks_per_s: Q20,
}

/// Rate, 1/s, of a running mean that has become as slow as the slowest filter.
const SETTLED_PER_S: f32 = 0.1;

impl Recovered {
    pub(super) fn new(
        scale: &Scale,
        gyro_range_rad_s: f32,
        recovery_rad2_s: f32,
        slow_per_s: f32,
        block_s: f32,
    ) -> Self {
        Self {
            range: Range::new(gyro_range_rad_s),
            recovery: Recovery::new(Q20::from_f32(recovery_rad2_s)),
            gyr: Q20::from_f32(scale.gyr_rad_s).0,
            acc: Q20::from_f32(scale.acc_m_s2).0,
            field: Q20::from_f32(scale.mag_ut / FIELD_UT).0,
            field_dt: Q20::ZERO,
            owed: [0; 3],
            per_density: Q20::from_f32(1.0 / recovery_rad2_s),
            slow_per_s: Q20::from_f32(slow_per_s * 2.0),
            blocks_per_s: Q20::from_f32(1.0 / block_s),
        }
    }

    /// The attitude's variance has grown, rad^2: gains as those of a running mean whose variance is as large.
    #[cold]
    fn unsettle(&self, variance: Q20, boost: i32) -> Option<(i32, u32)> {
        let mut slow = self.slow_per_s;
        let now = if boost == 0 {
            Q20::from_f32(SETTLED_PER_S)
        } else {
            Q20((slow.0 << (boost & 7)) >> 1)
        };
        let rate = now + variance * self.per_density;
        let mut larger = 0;
        while slow < rate && larger < 8 {
            slow += slow;
            larger += 1;
        }
        let blocks = (self.blocks_per_s * rate.recip()).0 >> 20;
        (larger != 0 && larger >= boost).then_some((larger, blocks.clamp(1, 100) as u32))
    }

    #[inline(never)]
    fn recover(
        &mut self,
        dt: Q20,
        rate: &Vector3<Q20>,
        hidden: Option<[Hidden<Q20>; 3]>,
        step: &Step<'_>,
    ) -> Option<(i32, u32)> {
        // Half a row in Q20 is a row in Q15 times 16.
        let half = |row: [i32; 3]| Vector3::from(row.map(|part| Q20(part << 4)));
        let rows = HalfRows {
            north: half(step.products.north()),
            east: half(step.products.east()),
            down: half(step.products.down()),
        };
        let vector = |counts: &[i16; 3], scale: i32| {
            Vector3::from(counts.map(|count| Q20(i32::from(count) * scale)))
        };
        let [bx, by, bz] = step.bias.map(|bias| Q20((bias * self.gyr) >> BIAS_BITS));
        let seen = Seen {
            acc: Some(vector(&step.counts.acc, self.acc)),
            field: step
                .counts
                .mag
                .as_ref()
                .zip(step.field)
                .map(|(mag, [north, down])| {
                    let part = |counts: i32| Q20(counts * self.field);
                    (
                        vector(mag, self.field),
                        Vector3::new(part(north), Q20::ZERO, part(down)),
                    )
                }),
            field_dt: self.field_dt,
            rate: Vector3::new(rate.x - bx, rate.y - by, rate.z - bz),
        };
        let hidden = hidden.unwrap_or([Hidden::Nothing; 3]);
        let (half_angle, variance) = self.recovery.step(dt, &rows, &hidden, &seen);
        for (owed, part) in self.owed.iter_mut().zip(half_angle.iter()) {
            // From Q20 to Q31.
            *owed = owed.saturating_add(part.0.clamp(-(1 << 19), 1 << 19) << 11);
        }
        if variance > Q20::ZERO {
            self.unsettle(variance, step.boost)
        } else {
            None
        }
    }
}

impl sealed::Sealed for Recovered {}

impl OverRange for Recovered {
    #[inline]
    fn step(&mut self, step: &Step<'_>) -> Found {
        let mut found = Found::default();
        // us to Q20: 2^20 / 10^6 is 1 + 3183 / 2^16.
        let us = step.dt_us.min(30_000) as i32;
        let dt = Q20(us + ((us * 3_183) >> 16));
        self.field_dt += dt;
        let mut rate = Vector3::from(step.counts.gyr).map(|count| Q20(i32::from(count) * self.gyr));
        let mut hidden = None;
        if dt > Q20::ZERO && !self.range.is_quiet(&rate) {
            hidden = Some(self.range.examine(dt, &mut rate));
        }
        if hidden.is_some() || self.recovery.is_active() {
            found.settle = self.recover(dt, &rate, hidden, step);
        }
        if step.counts.mag.is_some() {
            self.field_dt = Q20::ZERO;
        }
        for (part, owed) in found.correction.iter_mut().zip(&mut self.owed) {
            *part = (*owed).clamp(-MOST, MOST);
            *owed -= *part;
        }
        found
    }

    fn is_active(&self) -> bool {
        self.recovery.is_active()
    }
}
