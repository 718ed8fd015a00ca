//! What happens when the gyroscope clips: nothing, or what the float filters do. They learn the
//! field's lag too, in the same numbers.

use nalgebra::Vector3;

use super::counts::{Counts, Scale};
use super::format::{Q9, Q31};
use super::lag;
use super::number::Q20;
use super::rotation::Products;
use crate::lag::FieldLag;
use crate::quaternion::HalfRows;
use crate::range::{Hidden, Range, Rules};
use crate::real::{Number, sealed};
use crate::recovery::{Recovery, Seen};
use crate::vector::dot;

/// Largest part of a correction that one step takes, half an angle: a sixteenth of a radian.
const MAX_STEP: Q31 = 1 << 27;

/// Field counts are brought to parts of this, uT: squares of the earth's field would not fit.
const FIELD_UT: f32 = 64.0;

/// What an estimator does when rates clip: [`Ignored`] or [`Recovered`].
pub trait OverRange: sealed::Sealed {
    /// Looks for clipped rates at the end of a step.
    #[doc(hidden)]
    fn step(&mut self, step: &StepEnd<'_>) -> Response;

    /// A rate is clipped, or was within the last seconds.
    fn is_active(&self) -> bool;
}

/// What an estimator knows at the end of a step.
pub struct StepEnd<'a> {
    /// Time step, us.
    pub(super) dt_us: u32,
    /// The sample.
    pub(super) counts: &'a Counts,
    /// The orientation after the step.
    pub(super) products: &'a Products,
    /// Specific force, as it is now, counts.
    pub(super) acc: &'a [i32; 3],
    /// Offset of the gyroscope, counts.
    pub(super) bias: &'a [Q9; 3],
    /// The field's reference: north and down, counts.
    pub(super) field: Option<[i32; 2]>,
    /// The field is like it, to its full weight.
    pub(super) field_is_like_it: bool,
    /// Base-2 logarithm of the gain increase of the slower channel.
    pub(super) gain_log2: i32,
}

/// What an estimator does about clipped rates.
#[derive(Default)]
pub struct Response {
    /// A correction, half a rotation vector in the body frame, rad.
    pub(super) correction: [Q31; 3],
    /// Base-2 logarithm of a gain increase and the blocks that it lasts: see `StartUpGains::raise`.
    pub(super) raise: Option<(i32, u32)>,
    /// The field's lag, s, where it was learned anew.
    pub(super) mag_lag_s: Option<Q20>,
}

/// Clipping is not looked for, which costs nothing: for gyroscopes whose range no motion exceeds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ignored;

impl sealed::Sealed for Ignored {}

impl OverRange for Ignored {
    #[inline(always)]
    fn step(&mut self, _: &StepEnd<'_>) -> Response {
        Response::default()
    }

    #[inline(always)]
    fn is_active(&self) -> bool {
        false
    }
}

/// Clipping is found, and the rotation that it hid, by the same code as in float, in Q20.
#[derive(Clone, Debug)]
pub struct Recovered {
    range: Range<Q20>,
    recovery: Recovery<Q20>,
    /// Bits of Q20 rad/s that a count of the gyroscope is worth.
    gyr: i32,
    /// Bits of Q20 m/s^2 that a count of the accelerometer is worth.
    acc: i32,
    /// Bits of Q20 that a count of the magnetometer is worth, in units of [`FIELD_UT`].
    field: i32,
    /// Time since the last field, s.
    field_dt: Q20,
    /// The part of the corrections that is still to be applied, half an angle about each body axis,
    /// rad.
    owed: [Q31; 3],
    /// One over the accelerometer's noise density, 1/(rad^2 s).
    per_density: Q20,
    /// Twice the smaller one of the filter's gains, 1/s: where the next power of two begins.
    slow_per_s: Q20,
    /// Blocks of the rest detection a second.
    blocks_per_s: Q20,
    field_lag: FieldLag<Q20>,
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
        field_lag: FieldLag<Q20>,
    ) -> Self {
        Self {
            range: Range::new(gyro_range_rad_s, Rules::Plain),
            recovery: Recovery::new(Q20::from_f32(recovery_rad2_s)),
            gyr: Q20::from_f32(scale.gyr_rad_s).0,
            acc: Q20::from_f32(scale.acc_m_s2).0,
            field: Q20::from_f32(scale.mag_ut / FIELD_UT).0,
            field_dt: Q20::ZERO,
            owed: [0; 3],
            per_density: Q20::from_f32(1.0 / recovery_rad2_s),
            slow_per_s: Q20::from_f32(slow_per_s * 2.0),
            blocks_per_s: Q20::from_f32(1.0 / block_s),
            field_lag,
        }
    }

    /// The attitude's variance has grown, rad^2: the gain increase of a running mean whose variance
    /// is as large, and how long it lasts, unless the gains are larger already.
    #[cold]
    fn unsettle(&self, variance: Q20, gain_log2: i32) -> Option<(i32, u32)> {
        let mut slow = self.slow_per_s;
        let now = if gain_log2 == 0 {
            Q20::from_f32(SETTLED_PER_S)
        } else {
            Q20((slow.0 << (gain_log2 & 7)) >> 1)
        };
        let rate = now + variance * self.per_density;
        let mut raised = 0;
        while slow < rate && raised < 8 {
            slow += slow;
            raised += 1;
        }
        let blocks = (self.blocks_per_s * rate.recip()).0 >> 20;
        (raised != 0 && raised >= gain_log2).then_some((raised, blocks.clamp(1, 100) as u32))
    }

    /// A field like the reference shows how late it is: the lag, where it was learned.
    #[inline(always)]
    fn learn_lag(&mut self, step: &StepEnd<'_>) -> Option<Q20> {
        let (mag, field) = step.counts.mag.zip(step.field)?;
        if self.recovery.is_active() || !step.field_is_like_it {
            return None;
        }
        let dt = self.field_lag.due(self.field_dt)?;
        let strength = self.earth(field);
        self.field_lag.learn(
            dt,
            &rows(step.products),
            &vector(mag.map(i32::from), self.field),
            &self.rate(step),
            dot(&strength, &strength).sqrt().recip(),
        );
        Some(self.field_lag.lag_s())
    }

    /// The rates less their offset, rad/s.
    fn rate(&self, step: &StepEnd<'_>) -> Vector3<Q20> {
        vector(lag::rates(&step.counts.gyr, step.bias), self.gyr)
    }

    /// A field in the earth frame, north and down in counts.
    fn earth(&self, [north, down]: [i32; 2]) -> Vector3<Q20> {
        vector([north, 0, down], self.field)
    }

    /// One step of the recovery: what the axes hide and the other sensors show becomes a correction
    /// that is owed.
    #[inline(never)]
    fn recover(
        &mut self,
        dt: Q20,
        hidden: Option<[Hidden<Q20>; 3]>,
        step: &StepEnd<'_>,
    ) -> Option<(i32, u32)> {
        let rows = rows(step.products);
        let seen =
            Seen {
                acc: Some(vector(*step.acc, self.acc)),
                field: step.counts.mag.zip(step.field).map(|(mag, field)| {
                    (vector(mag.map(i32::from), self.field), self.earth(field))
                }),
                field_dt: self.field_dt,
                field_lag_s: self.field_lag.lag_s(),
                rate: self.rate(step),
            };
        let hidden = hidden.unwrap_or([Hidden::Nothing; 3]);
        let (half_angle, variance) = self.recovery.step(dt, &rows, &hidden, &seen);
        for (owed, part) in self.owed.iter_mut().zip(half_angle.iter()) {
            // From Q20 to Q31.
            *owed = owed.saturating_add(part.0.clamp(-(1 << 19), 1 << 19) << 11);
        }
        if variance > Q20::ZERO {
            self.unsettle(variance, step.gain_log2)
        } else {
            None
        }
    }
}

/// Counts, each worth so many bits of Q20.
#[inline(always)]
fn vector(counts: [i32; 3], worth: i32) -> Vector3<Q20> {
    Vector3::from(counts.map(|count| Q20(count.saturating_mul(worth))))
}

fn rows(products: &Products) -> HalfRows<Q20> {
    // Half a row in Q20 is a row in Q15 times 16.
    let half = |row: [i32; 3]| vector(row, 16);
    HalfRows {
        north: half(products.north()),
        east: half(products.east()),
        down: half(products.down()),
    }
}

impl sealed::Sealed for Recovered {}

impl OverRange for Recovered {
    #[inline]
    fn step(&mut self, step: &StepEnd<'_>) -> Response {
        let mut response = Response::default();
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
            response.raise = self.recover(dt, hidden, step);
        }
        response.mag_lag_s = self.learn_lag(step);
        if step.counts.mag.is_some() {
            self.field_dt = Q20::ZERO;
        }
        for (part, owed) in response.correction.iter_mut().zip(&mut self.owed) {
            *part = (*owed).clamp(-MAX_STEP, MAX_STEP);
            *owed -= *part;
        }
        response
    }

    fn is_active(&self) -> bool {
        self.recovery.is_active()
    }
}
