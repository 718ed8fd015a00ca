//! A gyroscope that clips, in fixed point.
//!
//! A rate beyond the gyroscope's range hides part of the rotation. What the float filters do about it
//! ([`crate::range`] finds the limit and the hidden angle, [`crate::recovery`] the attitude again)
//! runs here as it is, generic over its number: on [`Q20`], from -2048 to 2048 in steps of 1e-6.
//! So does [`crate::lag`], which learns how late the field is. What this file adds is the border
//! between counts and Q20, once at the end of a step:
//!
//! | in | from | in Q20 |
//! |---|---|---|
//! | rates | counts | rad/s |
//! | specific force | counts | m/s^2 |
//! | field and its reference | counts | parts of [`FIELD_UT`], as the squares of uT have no room |
//! | rows | Q15 | half a row is 16 times that |
//!
//! | out | to | |
//! |---|---|---|
//! | correction | Q31, half angles | [`MAX_STEP`] a step at most, the rest is owed to the next ones |
//! | variance of the heading | gains of a running mean that is as uncertain | [`Clipped::unsettle`] |
//! | lag of the field | [`Lag`] | once it is learned anew |
//!
//! Most steps are not over range and cost a comparison of the rates with what is quiet.

use super::counts::Scale;
use super::format::{Q30, Q31};
use super::lag::{self, Lag};
use super::number::Q20;
use super::rotation::Products;
use super::sensors::{Late, Response, Sensors, StepEnd};
use crate::config::Config;
use crate::error::{ConfigError, in_range};
use crate::lag::FieldLag;
use crate::quaternion::HalfRows;
use crate::range::{Hidden, Range, Rules};
use crate::real::Number;
use crate::recovery::{Recovery, Seen};
use crate::vector::dot;

/// Largest part of a correction that one step takes, half an angle: a sixteenth of a radian.
const MAX_STEP: Q31 = 1 << 27;

/// Field counts are brought to parts of this, uT: squares of the earth's field would not fit.
const FIELD_UT: f32 = 64.0;

/// Rate, 1/s, of a running mean that has become as slow as the slowest filter.
const SETTLED_PER_S: f32 = 0.1;

/// Late sensors, and a gyroscope that clips: the rotation that it hides is recovered as the float
/// filters do, and the field's lag is learned. More code, and in a step that is over range several
/// times the cycles of another. [`Estimator`](super::Estimator) alone runs it.
#[derive(Clone, Debug)]
pub struct Clipped {
    late: Late,
    /// What lags are parts of.
    unit: Lag,
    /// Bits of Q20 rad/s that a count of the gyroscope is worth.
    gyr: i32,
    /// Bits of Q20 m/s^2 that a count of the accelerometer is worth.
    acc: i32,
    /// Bits of Q20 that a count of the magnetometer is worth, in units of [`FIELD_UT`].
    field: i32,
    /// One over the accelerometer's noise density, 1/(rad^2 s).
    per_density: Q20,
    /// Twice the smaller one of the filter's gains, 1/s: where the next power of two begins.
    slow_per_s: Q20,
    /// Blocks of the rest detection a second.
    blocks_per_s: Q20,
    first: Recovered,
}

/// What [`Clipped`] remembers.
#[derive(Clone, Debug)]
pub struct Recovered {
    range: Range<Q20>,
    recovery: Recovery<Q20>,
    /// Time since the last field, s.
    field_dt: Q20,
    /// The part of the corrections that is still to be applied, half an angle about each body axis,
    /// rad.
    owed: [Q31; 3],
    field_lag: FieldLag<Q20>,
    /// The same as `field_lag` has it.
    mag_lag: Lag,
}

impl Clipped {
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

    /// A field like the reference shows how late it is.
    #[inline(always)]
    fn learn_lag(&self, memory: &mut Recovered, step: &StepEnd<'_>) {
        if let Some((mag, field)) = step.counts.mag.zip(step.field)
            && !memory.recovery.is_active()
            && step.field_is_like_it
            && let Some(dt) = memory.field_lag.due(memory.field_dt)
        {
            let strength = self.earth(field);
            memory.field_lag.learn(
                dt,
                &rows(step.products),
                &vector(mag.map(i32::from), self.field),
                &self.rate(step),
                dot(&strength, &strength).sqrt().recip(),
            );
            memory.mag_lag = self.unit.times(memory.field_lag.lag_s());
        }
    }

    /// The rates less their offset, rad/s.
    fn rate(&self, step: &StepEnd<'_>) -> [Q20; 3] {
        vector(lag::rates(&step.counts.gyr, step.bias), self.gyr)
    }

    /// A field in the earth frame, north and down in counts.
    fn earth(&self, [north, down]: [i32; 2]) -> [Q20; 3] {
        vector([north, 0, down], self.field)
    }

    /// One step of the recovery: what the axes hide and the other sensors show becomes a correction
    /// that is owed.
    #[inline(never)]
    fn recover(
        &self,
        memory: &mut Recovered,
        dt: Q20,
        hidden: Option<[Hidden<Q20>; 3]>,
        step: &StepEnd<'_>,
    ) -> Option<(i32, u32)> {
        let field = step.counts.mag.zip(step.field);
        let seen = Seen {
            acc: Some(vector(*step.acc, self.acc)),
            field: field
                .map(|(mag, field)| (vector(mag.map(i32::from), self.field), self.earth(field))),
            field_dt: memory.field_dt,
            field_lag_s: memory.field_lag.lag_s(),
            rate: self.rate(step),
        };
        let hidden = hidden.unwrap_or([Hidden::Nothing; 3]);
        let rows = rows(step.products);
        let (half_angle, variance) = memory.recovery.step(dt, &rows, &hidden, &seen);
        for (owed, part) in memory.owed.iter_mut().zip(half_angle.iter()) {
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
fn vector(counts: [i32; 3], worth: i32) -> [Q20; 3] {
    counts.map(|count| Q20(count.saturating_mul(worth)))
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

impl Sensors for Clipped {
    type Memory = Recovered;

    fn new<G>(
        config: &Config<G>,
        scale: &Scale,
        slow_per_s: f32,
        block_s: f32,
    ) -> Result<Self, ConfigError> {
        let (range_rad_s, density) = (config.gyro_range_rad_s, config.recovery_rad2_s);
        in_range(range_rad_s, 0.1, 200.0, "gyro_range_rad_s")?;
        in_range(density, 1e-4, 10.0, "recovery_rad2_s")?;
        let late = Late::new(config, scale, slow_per_s, block_s)?;
        let worth = |unit: f32| Q20::from_f32(unit).0;
        Ok(Self {
            unit: Lag::unit(scale.gyr_rad_s),
            gyr: worth(scale.gyr_rad_s),
            acc: worth(scale.acc_m_s2),
            field: worth(scale.mag_ut / FIELD_UT),
            per_density: Q20::from_f32(1.0 / density),
            slow_per_s: Q20::from_f32(slow_per_s * 2.0),
            blocks_per_s: Q20::from_f32(1.0 / block_s),
            first: Recovered {
                range: Range::new(range_rad_s, Rules::Plain),
                recovery: Recovery::new(Q20::from_f32(density)),
                field_dt: Q20::ZERO,
                owed: [0; 3],
                field_lag: FieldLag::new(config.mag_lag_s, config.mag_lag_prior_rad2_s)?,
                mag_lag: late.mag,
            },
            late,
        })
    }

    fn start(&self) -> Recovered {
        self.first.clone()
    }

    #[inline(always)]
    fn keep_rates(rates: &mut [i32; 3], gyr: &[i16; 3], bias: &[i32; 3]) {
        Late::keep_rates(rates, gyr, bias);
    }

    #[inline(always)]
    fn now(
        &self,
        memory: &Recovered,
        rates: &[i32; 3],
        acc: [i32; 3],
        mag: Option<[i32; 3]>,
    ) -> ([i32; 3], Option<[i32; 3]>) {
        let (acc, _) = self.late.now(&(), rates, acc, None);
        (acc, mag.map(|mag| memory.mag_lag.now(&mag, rates)))
    }

    fn ahead(&self, of_rates: [Q30; 4], rates: &[i32; 3]) -> [Q30; 4] {
        self.late.ahead(of_rates, rates)
    }

    #[inline]
    fn examine(&self, memory: &mut Recovered, step: &StepEnd<'_>) -> Response {
        let mut response = Response::default();
        // us to Q20: 2^20 / 10^6 is 1 + 3183 / 2^16.
        let us = step.dt_us.min(30_000) as i32;
        let dt = Q20(us + ((us * 3_183) >> 16));
        memory.field_dt += dt;
        let mut rate = step
            .counts
            .gyr
            .map(|count| Q20(i32::from(count) * self.gyr));
        let mut hidden = None;
        if dt > Q20::ZERO && !memory.range.is_quiet(&rate) {
            hidden = Some(memory.range.examine(dt, &mut rate));
        }
        if hidden.is_some() || memory.recovery.is_active() {
            response.raise = self.recover(memory, dt, hidden, step);
        }
        self.learn_lag(memory, step);
        if step.counts.mag.is_some() {
            memory.field_dt = Q20::ZERO;
        }
        for (part, owed) in response.correction.iter_mut().zip(&mut memory.owed) {
            *part = (*owed).clamp(-MAX_STEP, MAX_STEP);
            *owed -= *part;
        }
        response
    }

    fn is_over_range(memory: &Recovered) -> bool {
        memory.recovery.is_active()
    }
}
