//! One step: from counts to orientation.
//!
//! # The equations
//! With the measured rates `g`, their offset `b`, the time step `dt`, the correction `c` that the
//! step before has found, the specific force `a` and the field `m`:
//!
//! ```text
//! h = (g - b) dt / 2 + c                  half the rotation vector of the step, body frame
//! q = q (1 - s/2 + s^2/24, h (1 - s/6))   s = |h|^2: the orientation, body to earth
//! n, e, d = rows of R(q)                  north, east and down in the body frame
//! c = tilt(n, e, d, a) + gain sin(heading error of m) d / 2
//! b = mean of g over blocks at rest
//! ```
//!
//! | file | what it derives |
//! |---|---|
//! | this one | time step, heading correction, which step does what |
//! | `rotation` | integration, rows, the room that a rotation has |
//! | `filters` | the tilt correction |
//! | `field` | the heading error and its weight |
//! | `rest` | the offset, and the blocks that all slow work is counted in |
//! | `start_up` | the gains, from those of a running mean to the filter's own |
//! | `lag` | what a sensor shows now whose samples are older than the rates |
//! | `quality` | how far the estimate may be off |
//! | `over_range` | what a clipped gyroscope has hidden |
//!
//! # The number formats
//! `format` has the rules. Gyroscope, accelerometer and magnetometer stay in counts of 16 bits:
//!
//! | number | format | bound, and what sets it |
//! |---|---|---|
//! | half angle per count and us | Q(31 + `turn_shift` + 16) | below `2^31 / max_short_dt_us`: times a time step it fits |
//! | half angle per count | Q(31 + `turn_shift`) | below `2^15`: times a rate of 16 bits it fits |
//! | half angles, corrections | Q31 rad | each its own part of the 0.84 rad that a rotation has room for |
//! | quaternion | Q30 | 1; Q15 where it is a factor |
//! | rows n, e, d | Q15 | 1 |
//! | row times counts | Q15 counts | `2^15 * 2^15 sqrt(3) < 2^31` |
//! | sine of the heading error | Q15 | 1, and 2 beyond a right angle |
//! | heading correction | Q(16 + `heading_shift`) rad | `MAX_HEADING_TURN`: times a row it fits |
//!
//! **Time.** `turn_shift` is chosen so that a count turns by `2^14` to `2^15` units in the longest
//! short step, of 1.25 periods: all the bits that the product with a rate leaves. What the product
//! with the time step has below a unit is carried into the next step, so that no time is lost. A
//! longer step divides its time by `2^coarse_shift` and gives up as many bits of `turn_shift`.
//!
//! **Heading.** An error of `x` in Q15 is a half angle of `x` in Q16, which spares a shift. The
//! gain's factor is below `2^13`, the sine at most `2^16`: below `2^29`, then cut by 15. One
//! correction stands for all samples since the last field, at most for as many as make the whole
//! error, `4 << heading_shift`.
//!
//! # Which step does what
//! Judging the field, closing the blocks of the rest detection and changing the gains are spread
//! over steps of their own ([`Estimator::housekeeping`]), and such a step skips the heading
//! correction. The worst case is so little more than the mean.

use nalgebra::Vector3;

use super::counts::{Counts, PERIOD_US, Scale};
use super::field::{self, Compass, size};
use super::filters::{Filter, Heading, View};
use super::format::{Q15, normalised};
use super::lag::{self, Lag, PerLag};
use super::memory::all;
use super::orientation::{Angles, Orientation};
use super::over_range::{Ignored, OverRange, Recovered, StepEnd};
use super::quality::{Doubt, Due, Job};
use super::rest::{self, Rest};
use super::rotation::{BIAS_BITS, PerCount, Rotation};
use super::start_up::{Gains, StartUpGains};
use crate::config::{Config, GRAVITY};
use crate::error::{ConfigError, in_range};
use crate::estimator::{Attitude, Flags};
use crate::lag::FieldLag;
use crate::quality::{BiasState, Quality};

/// Longest time step, us: more is a gap.
const MAX_DT_US: u32 = 30_000;

/// Largest half angle of a long step, rad, the sum of three axes.
const MAX_HALF_ANGLE: f32 = 0.38;

/// Fractional bits of the half angle per count and us below those of the half angle per count.
const DT_BITS: u32 = 16;

/// Most bits that are given up in a step longer than 1.25 periods: eight times that are ten
/// periods.
const MAX_COARSE_SHIFT: u8 = 3;

/// An attitude estimator in fixed point. `R` is what it does when rates clip.
///
/// Fields in the order of use: what every step touches lies within reach of the core's short
/// offsets.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Estimator<F, R = Ignored> {
    rotation: Rotation,
    /// Half angle per count and us, Q(31 + `turn_shift` + `DT_BITS`) rad.
    per_count_us: u32,
    /// Longest step that is taken at full resolution, us: 1.25 periods.
    max_short_dt_us: u32,
    /// What the half angle per count was cut by in the last step, its low `DT_BITS` bits: added in
    /// the next.
    dt_remainder: u32,
    /// Right shift that brings the product of a half angle per count and a rate to Q31.
    turn_shift: u32,
    gains: Gains,
    rest: Rest,
    /// Sample number of the last field that has corrected the heading.
    heading_tick: u32,
    /// A sensor's samples are older than the rates, or the rates than the present.
    is_late: bool,
    /// Jobs of the deviations that are to come, and for how many steps they have waited.
    due: Due,
    compass: Compass,
    filter: F,
    start_up: StartUpGains,
    doubt: Doubt,
    /// Longest step that is integrated, us; a longer one is a gap, and integrated as this.
    max_dt_us: u32,
    /// Largest product of a long step, us, and the sum of the rates' sizes, counts:
    /// [`MAX_HALF_ANGLE`].
    max_rotation: u32,
    /// Bits of the time step and of `turn_shift` that are given up in a long step.
    coarse_shift: u32,
    /// There was a step of more than 1.25 periods since the last block began.
    gap: bool,
    /// Blocks after which the estimate counts as initialised.
    start_up_blocks: u32,
    /// The last field while accelerations are limited: it stands for those that a slow magnetometer
    /// leaves out.
    last_mag: Option<[i32; 3]>,
    /// Cosine and sine of half the declination, unless it is zero.
    half_declination: Option<(Q15, Q15)>,
    /// What a count of the gyroscope is worth, rad/s.
    gyr_rad_s: f32,
    acc_lag: Lag,
    mag_lag: Lag,
    per_lag: PerLag,
    /// The gyroscope's own lag, unless it is zero.
    gyr_lag: Option<Lag>,
    /// Rates of the last step less their offset, counts, if a sensor is late.
    rates: [i32; 3],
    over_range: R,
}

impl<F: Filter> Estimator<F> {
    /// An estimator for samples of about every `period_us` microseconds, in [`PERIOD_US`]. The
    /// gains of the correction are per sample, the rates are integrated over the time steps as they
    /// are.
    ///
    /// # Errors
    /// A parameter, a gain, the period or the scale of a sensor out of range, by name. The
    /// accelerometer's gate and Mahony's integral gain do not exist in fixed point and are refused
    /// too.
    // Inlined with all that it calls, a configuration that is constant leaves constants: 2 KB of
    // soft float less.
    #[inline(always)]
    pub fn new(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
    ) -> Result<Self, ConfigError> {
        Self::build(config, scale, period_us, |_| Ok(Ignored))
    }

    /// All that the next steps depend on besides their samples and the configuration, word by word:
    /// each is shown to `each` and becomes what that returns. So the estimate can be written down,
    /// and be continued elsewhere with the same bits. There are
    /// [`MEMORY_WORDS`](super::MEMORY_WORDS).
    #[inline(never)]
    pub fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        self.rotation.memory(each);
        self.dt_remainder = each(self.dt_remainder as i32) as u32;
        self.start_up.memory(&mut self.gains, each);
        self.rest.memory(each);
        self.heading_tick = each(self.heading_tick as i32) as u32;
        self.compass.memory(each);
        self.filter.memory(each);
        self.gap = each(self.gap.into()) != 0;
        let known = each(self.last_mag.is_some().into()) != 0;
        let mut last_mag = self.last_mag.unwrap_or_default();
        all(&mut last_mag, each);
        self.last_mag = known.then_some(last_mag);
        all(&mut self.rates, each);
        self.doubt.memory(each);
        self.due.memory(each);
    }
}

impl<F: Filter> Estimator<F, Recovered> {
    /// As [`Estimator::new`], with what the float filters do about clipped rates: more code, and in
    /// a step that is over range several times the cycles of another.
    ///
    /// # Errors
    /// As [`Estimator::new`]; the gyroscope's range and the noise of the recovery are checked too.
    pub fn with_recovery(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
    ) -> Result<Self, ConfigError> {
        Self::build(config, scale, period_us, |block_s| {
            let field_lag = FieldLag::new(config.mag_lag_s, config.mag_lag_prior_rad2_s)?;
            in_range(config.gyro_range_rad_s, 0.1, 200.0, "gyro_range_rad_s")?;
            in_range(config.recovery_rad2_s, 1e-4, 10.0, "recovery_rad2_s")?;
            let (acc_per_s, mag_per_s) = F::rates(&config.gains, period_us as f32 * 1e-6);
            Ok(Recovered::new(
                scale,
                config.gyro_range_rad_s,
                config.recovery_rad2_s,
                acc_per_s.min(mag_per_s),
                block_s,
                field_lag,
            ))
        })
    }
}

impl<F: Filter, R: OverRange> Estimator<F, R> {
    /// `over_range` makes what handles clipped rates from the duration of a block, s.
    #[inline(always)]
    fn build(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
        over_range: impl FnOnce(f32) -> Result<R, ConfigError>,
    ) -> Result<Self, ConfigError> {
        if !PERIOD_US.contains(&period_us) {
            return Err(ConfigError::OutOfRange("period_us"));
        }
        if config.acc_gate.is_finite() {
            return Err(ConfigError::OutOfRange("acc_gate"));
        }
        let period_s = period_us as f32 * 1e-6;
        scale.check(period_s)?;
        let log2_block = rest::log2_block(period_s);
        let block_s = period_s * f32::from(1u16 << log2_block);
        let (acc_per_s, mag_per_s) = F::rates(&config.gains, period_s);
        let per_g = GRAVITY / scale.acc_m_s2;
        let (start_up, gains) = StartUpGains::new(
            acc_per_s * period_s,
            mag_per_s * period_s,
            per_g,
            F::counts(&config.gains, per_g),
            log2_block,
        )?;
        let max_short_dt_us = period_us + period_us / 4;
        // Q31 of the half angle.
        let per_count_us = scale.gyr_rad_s * 0.5e-6 * 2_147_483_648.0;
        let rest = rest::Limits::new(&config.rest, scale, period_s)?;
        let turn = per_count_us * max_short_dt_us as f32;
        let most = (1u32 << (31 - BIAS_BITS)) as f32 / (rest.max_bias + 1) as f32;
        in_range(turn, 0.0, most, "rest.max_bias_rad_s")?;
        let (_, turn_shift) = normalised(turn, most.min(32_768.0));
        let per_count_us = per_count_us * f32::from(1u16 << turn_shift) * (1u32 << DT_BITS) as f32;
        let coarse_shift = MAX_COARSE_SHIFT.min(turn_shift);
        let per_lag = PerLag::new(scale.gyr_rad_s);
        let lag = |lag_s, name| Ok(per_lag.lag(lag::checked(lag_s, name)?));
        let gyr_lag = lag(config.gyr_lag_s, "gyr_lag_s")?;
        Ok(Self {
            rotation: Rotation::new(),
            per_count_us: per_count_us as u32,
            max_short_dt_us,
            dt_remainder: 0,
            turn_shift: turn_shift.into(),
            gains,
            rest: Rest::new(&rest),
            is_late: [config.gyr_lag_s, config.acc_lag_s, config.mag_lag_s] != [0.0; 3],
            acc_lag: lag(config.acc_lag_s, "acc_lag_s")?,
            mag_lag: lag(config.mag_lag_s, "mag_lag_s")?,
            heading_tick: 0,
            due: Due::default(),
            compass: Compass::new(
                &field::Limits::new(&config.field, scale, period_s)?,
                period_s,
            ),
            filter: F::new(&config.gains, period_s, per_g)?,
            start_up_blocks: ((config.start_up_s / block_s + 0.5) as u32)
                .max(start_up.first_blocks),
            start_up,
            doubt: Doubt::new(scale, block_s),
            max_dt_us: MAX_DT_US.min(max_short_dt_us << coarse_shift),
            max_rotation: (MAX_HALF_ANGLE * 2e6 / scale.gyr_rad_s) as u32,
            coarse_shift: coarse_shift.into(),
            gap: false,
            last_mag: None,
            half_declination: half_declination(config.declination_rad)?,
            gyr_rad_s: scale.gyr_rad_s,
            per_lag,
            gyr_lag: (config.gyr_lag_s != 0.0).then_some(gyr_lag),
            rates: [0; 3],
            over_range: over_range(block_s)?,
        })
    }

    /// The orientation, with geographic north if a declination was configured.
    pub fn orientation(&self) -> Orientation {
        let of_rates = self.rotation.q30();
        let magnetic = Orientation {
            wxyz_q30: match self.gyr_lag {
                Some(lag) => lag.ahead(of_rates, &self.rates),
                None => of_rates,
            },
        };
        match self.half_declination {
            Some(half) => magnetic.turned(half),
            None => magnetic,
        }
    }

    /// Gyroscope offset, counts in Q9.
    pub fn bias_q9(&self) -> [i32; 3] {
        self.rotation.bias
    }

    /// The whole estimate in float, with the rate of the sample given: for whoever does not count
    /// cycles.
    pub fn attitude(&self, counts: &Counts) -> Attitude {
        let bias = Vector3::from(self.bias_q9()).map(|bias| bias as f32 / 512.0 * self.gyr_rad_s);
        let rate = Vector3::from(counts.gyr).map(|rate| f32::from(rate) * self.gyr_rad_s) - bias;
        Attitude {
            orientation: self.orientation().quaternion(),
            rate,
            bias,
            flags: self.flags(),
        }
    }

    /// Health of the estimate. A gap is a step of more than 1.25 periods in the last quarter of a
    /// second; the accelerometer is never rejected.
    pub fn flags(&self) -> Flags {
        Flags {
            initialised: self.start_up.blocks > self.start_up_blocks,
            at_rest: self.rest.is_at_rest(),
            mag_disturbed: self.compass.is_disturbed(),
            gap: self.gap,
            over_range: self.over_range.is_active(),
            ..Flags::default()
        }
    }

    /// How far the estimate may be off, brought up to date once a block of about a quarter of a
    /// second. Of a body in free flight ([`Estimator::coast`]) it says no more than that the tilt
    /// is uncertain.
    // Inlined, so that what nobody asks for is left out.
    #[inline(always)]
    pub fn quality(&self) -> Quality {
        self.doubt
            .quality(self.compass.reference(), self.bias_state())
    }

    /// What is known of the gyroscope's offset.
    pub fn bias_state(&self) -> BiasState {
        self.rest.bias_state()
    }

    /// Whether the tilt's standard deviation, as [`Self::quality`] has it, is within the root of
    /// this variance, Q28 rad^2: without a float.
    pub fn tilt_is_within(&self, variance_q28: i32) -> bool {
        self.doubt.tilt_is_within(variance_q28)
    }

    /// Find tilt and heading anew, from the next block of samples on and as after a gap; the offset
    /// that has been learned stays. For whoever knows that the estimate was turned by a rate that
    /// was none.
    pub fn level(&mut self) {
        self.start_up.restart();
        self.expect_large_gains();
    }

    /// Take one sample, `dt_us` microseconds after the one before; with 0, nothing turns. More than
    /// 30,000, or than 2.5 to 10 periods (as period and scale leave room), is a gap: only that much
    /// is integrated, and the gains are those of a running mean again.
    #[inline]
    pub fn update(&mut self, dt_us: u32, counts: &Counts) {
        let gyr = counts.gyr;
        let mut acc = counts.acc.map(i32::from);
        let mut mag = counts.mag.map(|mag| mag.map(i32::from));
        let long = dt_us > self.max_short_dt_us;
        let limited = self.gains.acc_limit != 0;
        if limited {
            // A mask of all bits or none, as the core has no conditional move.
            let size = acc[0].abs() + acc[1].abs() + acc[2].abs();
            let within = (size - self.gains.acc_limit) >> 31;
            acc = acc.map(|acc| acc & within);
            // The heading may be off by any angle: the last field stands for those that a slow
            // magnetometer leaves out.
            match mag {
                Some(_) => self.last_mag = mag,
                None => mag = self.last_mag,
            }
        }
        let job = if long {
            rest::NO_JOB
        } else {
            self.rest.add(&gyr, &counts.acc)
        };
        let (mut step_us, mut shift) = (dt_us, self.turn_shift);
        if long {
            (step_us, shift) = self.long_step(dt_us, &gyr);
        }
        self.turn(&gyr, step_us, shift);
        if self.is_late {
            self.rates = lag::rates(&gyr, &self.rotation.bias);
            acc = self.acc_lag.now(&acc, &self.rates);
            mag = mag.map(|mag| self.mag_lag.now(&mag, &self.rates));
        }

        // Heading correction is skipped in steps that are long or run housekeeping, to bound the
        // worst-case cycles.
        let busy = long
            || job <= rest::START_UP
            || self.compass.is_due()
            || self.due.is_now(mag.is_some());
        if busy {
            self.housekeeping(job, &gyr, acc[2]);
        }
        let products = self.rotation.products();
        let down = products.down();
        let shift = self.gains.heading_shift & 31;
        let heading = mag.as_ref().filter(|_| !busy).map(|mag| {
            let tick = self.rest.tick();
            let samples = tick.wrapping_sub(self.heading_tick).min(4 << shift) as i32;
            self.heading_tick = tick;
            let sine = self.compass.heading(&products, &down, mag, tick);
            Heading { sine, samples }
        });
        let correction = self.filter.correction(&View {
            products: &products,
            down: &down,
            acc: &acc,
            heading,
            gains: &self.gains,
        });
        let (tilt, turn) = (correction.tilt, correction.heading);
        let response = self.over_range.step(&StepEnd {
            dt_us,
            counts,
            products: &products,
            acc: &acc,
            bias: &self.rotation.bias,
            field: self.compass.reference(),
            field_is_like_it: self.compass.is_like_reference(),
            gain_log2: self.start_up.gain_log2,
        });
        if let Some((gain_log2, blocks)) = response.raise {
            self.start_up.raise(gain_log2, blocks);
            self.expect_large_gains();
        }
        if let Some(lag_s) = response.mag_lag_s {
            self.mag_lag = self.per_lag.lag(lag_s);
            self.is_late = true;
        }
        let [rx, ry, rz] = response.correction;
        let pending = &mut self.rotation.pending;
        pending[0] += tilt[0] + ((turn * down[0]) >> shift) + rx;
        pending[1] += tilt[1] + ((turn * down[1]) >> shift) + ry;
        pending[2] += tilt[2] + ((turn * down[2]) >> shift) + rz;
    }

    /// Take one sample of a body in free flight, `dt_us` after the one before: the rates alone turn
    /// the estimate. Its accelerometer feels thrust and air, which show no vertical, so that
    /// neither tilt, heading nor offset is corrected. Of more than 30,000 us, or than 2.5 to 10
    /// periods, only that much is integrated.
    #[inline(never)]
    pub fn coast(&mut self, dt_us: u32, gyr: &[i16; 3]) {
        let (mut step_us, mut shift) = (dt_us, self.turn_shift);
        if dt_us > self.max_short_dt_us {
            self.gap = true;
            (step_us, shift) = self.coarse(dt_us.min(self.max_dt_us), gyr);
        }
        self.turn(gyr, step_us, shift);
        self.rates = lag::rates(gyr, &self.rotation.bias);
        // They keep the norm.
        let _ = self.rotation.products();
        // A rest that is under way has not been one.
        self.rest.moved = true;
        self.doubt.lose_tilt();
    }

    /// Integrate the rates over a step, whose time and shift are those of [`Self::coarse`] where it
    /// is long.
    #[inline(always)]
    fn turn(&mut self, gyr: &[i16; 3], step_us: u32, shift: u32) {
        let product = step_us * self.per_count_us + self.dt_remainder;
        self.dt_remainder = product & ((1 << DT_BITS) - 1);
        let half_angle = (product >> DT_BITS) as i32;
        self.rotation.turn(gyr, PerCount { half_angle, shift });
    }

    /// Runs the job of the rest detection or of the gains that is due, else that of the compass,
    /// else that of the deviations. Not in a long step.
    #[inline(never)]
    fn housekeeping(&mut self, job: u32, gyr: &[i16; 3], acc_z: i32) {
        if job < rest::START_UP {
            self.rest.close(job, &mut self.rotation.bias);
        } else if job == rest::START_UP {
            if self.start_up.blocks == 0 && acc_z > 0 {
                self.rotation.turn_over();
            }
            self.gap = false;
            self.start_up.next_block(&mut self.gains);
            self.due.begin();
        } else if job != rest::NO_JOB {
            if self.compass.is_due() {
                self.compass.judge(gyr);
            } else {
                self.account(gyr);
            }
        }
    }

    /// Runs the next job of the deviations.
    #[inline(never)]
    fn account(&mut self, gyr: &[i16; 3]) {
        match self.due.next_job() {
            Job::Close => {
                let good_field = self.rest.is_recent(self.heading_tick)
                    && self.compass.reference().is_some()
                    && !self.compass.is_disturbed();
                self.doubt.close(self.rest.is_at_rest(), good_field);
            }
            Job::Turn => self.doubt.turn(&lag::rates(gyr, &self.rotation.bias)),
            Job::Tilt => self.doubt.pass_tilt(self.start_up.tilt_raised()),
            Job::Heading => self.doubt.pass_heading(self.start_up.heading_raised()),
            Job::None => {}
        }
    }

    /// Large gains could overflow: limit accelerations from now on. A rest that is under way has
    /// not been one.
    #[inline(always)]
    fn expect_large_gains(&mut self) {
        self.start_up.limit_acc(&mut self.gains);
        self.rest.moved = true;
    }

    /// A step of more than 1.25 periods: the time that is integrated and the shift, as
    /// [`Self::coarse`] gives them. One that is too long begins the gains anew.
    #[cold]
    #[inline(never)]
    fn long_step(&mut self, dt_us: u32, gyr: &[i16; 3]) -> (u32, u32) {
        self.gap = true;
        let mut dt_us = dt_us;
        if dt_us > self.max_dt_us {
            dt_us = self.max_dt_us;
            self.start_up.restart();
            self.doubt.widen();
            self.expect_large_gains();
        }
        self.coarse(dt_us, gyr)
    }

    /// A time (us) of more than 1.25 periods, divided by `2^coarse_shift`, and the shift that goes
    /// with it. Where the body turns so fast that the whole time would be too large a rotation, it
    /// is 1.25 periods.
    fn coarse(&self, mut dt_us: u32, gyr: &[i16; 3]) -> (u32, u32) {
        if dt_us * size(gyr) > self.max_rotation {
            dt_us = self.max_short_dt_us;
        }
        (
            dt_us >> (self.coarse_shift & 31),
            self.turn_shift - self.coarse_shift,
        )
    }
}

/// Cosine and sine of half the declination; `None` when it is zero.
fn half_declination(declination_rad: f32) -> Result<Option<(Q15, Q15)>, ConfigError> {
    use core::f32::consts::PI;
    in_range(declination_rad, -PI, PI, "declination_rad")?;
    let (sin, cos) = Angles::sin_cos_q30(Angles::from_rad(0.5 * declination_rad));
    Ok((declination_rad != 0.0).then_some((cos >> 15, sin >> 15)))
}

#[cfg(test)]
mod tests;
