//! One step: from counts to orientation.
//!
//! # The equations
//! With the measured rates `g`, their offset `b`, the time step `dt`, the correction `c` from the
//! step before, the specific force `a` and the field `m`:
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
//! | this file | time step, heading correction, order of the slow work |
//! | `rotation` | integration, rows, the largest rotation |
//! | `filters` | the tilt correction |
//! | `field` | the heading error and its weight |
//! | `rest` | the offset, and the blocks in which all slow work is counted |
//! | `start_up` | the gains, from those of a running mean to the filter's own |
//! | `sensors` | which sensors are late |
//! | `lag` | the present value of a sensor whose samples are older than the rates |
//! | `quality` | the standard deviations of the estimate |
//!
//! # The number formats
//! `format` has the rules. Gyroscope, accelerometer and magnetometer stay in counts of 16 bits:
//!
//! | number | format | bound and its reason |
//! |---|---|---|
//! | half angle per count, us | Q(31 + `turn_shift` + 16) | `2^31 / max_short_dt_us` for a step |
//! | half angle per count | Q(31 + `turn_shift`) | below `2^15`: times a rate of 16 bits it fits |
//! | half angles, corrections | Q31 rad | each its part of the largest rotation, 0.84 rad |
//! | quaternion | Q30 | 1; Q15 where it is a factor |
//! | rows n, e, d | Q15 | 1 |
//! | row times counts | Q15 counts | `2^15 * 2^15 sqrt(3) < 2^31` |
//! | sine of the heading error | Q15 | 1, and 2 beyond a right angle |
//! | heading correction | Q(16 + `heading_shift`) rad | `MAX_HEADING_TURN`: times a row it fits |
//!
//! **Time.** With `turn_shift`, a count turns by `2^14` to `2^15` units in the longest short step,
//! of 1.25 periods: all the bits that the product with a rate leaves. The next step takes the
//! remainder of the product with the time step, so no time is lost. A longer step divides its time
//! by `2^coarse_shift` and gives up as many bits of `turn_shift`.
//!
//! **Heading.** An error of `x` in Q15 is a half angle of `x` in Q16, which spares a shift. The
//! gain's factor is below `2^13` and the sine at most `2^16`. Their product is below `2^29`, then
//! cut by 15. One correction stands for all samples since the last field, at most for
//! `4 << heading_shift`, which correct the whole error.
//!
//! # Which step does what
//! Judging the field, closing the blocks of the rest detection and changing the gains each have
//! steps of their own ([`Estimator::housekeeping`]). Such a step skips the heading correction. So
//! the worst case is little more than the mean.

use super::counts::{Counts, PERIOD_US, Scale};
use super::field::{Compass, size};
use super::filters::{Filter, Heading, Pace, View};
use super::format::{Q15, are_within, normalised};
use super::lag::{self, Lag};
use super::orientation::{Angles, Orientation};
use super::quality::{Uncertainty, UncertaintyState, job};
use super::rest::{self, Rest};
use super::rotation::{BIAS_BITS, PerCount, Rotation, cross, dot};
use super::sensors::{Late, Sensors};
use super::start_up::Schedule;
use super::state::{LastField, State};
use crate::config::{Config, GRAVITY};
use crate::consistency;
use crate::error::{ConfigError, in_range, require};
use crate::estimator::{Attitude, Flags};
use crate::quality::{BiasState, Quality};
use crate::vector::difference;
use bytemuck::Zeroable;

/// Longest time step, us: more is a gap.
const MAX_DT_US: u32 = 30_000;

/// Largest half angle of a long step, rad, the sum of three axes.
const MAX_HALF_ANGLE: f32 = 0.38;

/// Fractional bits of the half angle per count and us, beyond the bits of the half angle per count.
const DT_BITS: u32 = 16;

/// Most bits given up in a step longer than 1.25 periods: eight times 1.25 periods are ten periods.
const MAX_COARSE_SHIFT: u32 = 3;

/// An attitude estimator in fixed point: the constants of a configuration. Each step changes a
/// [`State`].
///
/// `S` is the kind of sensors: [`Late`] or [`Ideal`](super::Ideal).
#[derive(Clone, Debug, PartialEq)]
#[repr(C)]
pub struct Estimator<F, S = Late> {
    /// Half angle per count and us, Q(31 + `turn_shift` + `DT_BITS`) rad.
    per_count_us: u32,
    /// Longest step that is taken at full resolution, us: 1.25 periods.
    max_short_dt_us: u32,
    /// Right shift that brings the product of a half angle per count and a rate to Q31.
    turn_shift: u32,
    rest: Rest,
    filter: F,
    sensors: S,
    compass: Compass,
    schedule: Schedule,
    uncertainty: Uncertainty,
    /// Longest step that is integrated, us. A longer step is a gap, of which this much is
    /// integrated.
    max_dt_us: u32,
    /// Largest product of a long step, us, and the sum of the rates' sizes, counts:
    /// [`MAX_HALF_ANGLE`].
    max_rotation: u32,
    /// Bits of the time step and of `turn_shift` that are given up in a long step.
    coarse_shift: u32,
    /// Cosine and sine of half the declination, unless it is zero.
    half_declination: Option<(Q15, Q15)>,
    /// Value of a gyroscope's count, rad/s.
    gyr_rad_s: f32,
    /// Least acceleration along the vertical that says nothing against the estimate, counts.
    least_up: i32,
    /// Turn of half a block for a count, Q23 rad.
    half_block: i32,
    /// Square of the least acceleration of a block that shows a vertical.
    fall2: u32,
    /// Blocks in a row with less than that after which the estimate is wrong.
    low_blocks: u32,
}

impl<F: Filter, S: Sensors> Estimator<F, S> {
    /// For samples about every `period_us` microseconds, in [`PERIOD_US`]. The gains of the
    /// correction are per sample; the rates are integrated over the true time steps.
    ///
    /// # Errors
    /// The name of a parameter, gain, period or scale out of range. Fixed point also refuses the
    /// accelerometer's gate and Mahony's integral gain.
    // If it is inlined with its callees, a constant configuration leaves constants: 2 KB of soft
    // float less.
    #[inline(always)]
    pub fn new(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
    ) -> Result<Self, ConfigError> {
        require(PERIOD_US.contains(&period_us), "period_us")?;
        require(!config.acc_gate.is_finite(), "acc_gate")?;
        let period_s = period_us as f32 * 1e-6;
        scale.check(period_s)?;
        let log2_block = rest::log2_block(period_s);
        let block_s = period_s * f32::from(1u16 << log2_block);
        let per_g = GRAVITY / scale.acc_m_s2;
        let (filter, Pace { per_s, counts }) = F::new(&config.gains, period_s, per_g)?;
        let schedule = Schedule::new(
            (per_s.0 * period_s, per_s.1 * period_s),
            (per_g, counts),
            log2_block,
            config.start_up_s / block_s,
        )?;
        let max_short_dt_us = period_us + period_us / 4;
        // Q31 of the half angle.
        let per_count_us = scale.gyr_rad_s * 0.5e-6 * 2_147_483_648.0;
        let rest = Rest::new(&config.rest, scale, period_s)?;
        let turn = per_count_us * max_short_dt_us as f32;
        let squared = |value: f32| (value * value) as u32;
        let most = (1u32 << (31 - BIAS_BITS)) as f32 / (rest.max_bias + 1) as f32;
        in_range(turn, 0.0, most, "rest.max_bias_rad_s")?;
        let (_, turn_shift) = normalised(turn, most.min(32_768.0));
        let per_count_us = per_count_us * f32::from(1u16 << turn_shift) * (1u32 << DT_BITS) as f32;
        let coarse_shift = MAX_COARSE_SHIFT.min(turn_shift);
        Ok(Self {
            per_count_us: per_count_us as u32,
            max_short_dt_us,
            turn_shift,
            rest,
            filter,
            sensors: S::new(config, scale)?,
            compass: Compass::new(&config.field, scale, period_s)?,
            schedule,
            uncertainty: Uncertainty::new(scale, block_s),
            max_dt_us: MAX_DT_US.min(max_short_dt_us << coarse_shift),
            max_rotation: (MAX_HALF_ANGLE * 2e6 / scale.gyr_rad_s) as u32,
            coarse_shift,
            half_declination: half_declination(config.declination_rad)?,
            gyr_rad_s: scale.gyr_rad_s,
            least_up: (per_g * consistency::LEAST) as i32,
            half_block: (0.5 * block_s * scale.gyr_rad_s * 8_388_608.0) as i32,
            fall2: squared(0.5 * per_g * consistency::LEAST),
            low_blocks: (consistency::LASTING_S / block_s) as u32,
        })
    }

    /// The state before the first sample.
    pub fn start(&self) -> State {
        let (schedule, gains) = self.schedule.start();
        State {
            rotation: Rotation::new(),
            dt_remainder: 0,
            gains,
            rest: self.rest.start(),
            heading_tick: 0,
            due: 0,
            compass: self.compass.start(),
            filter: Zeroable::zeroed(),
            schedule,
            uncertainty: UncertaintyState::start(),
            gap: 0,
            last_field: Zeroable::zeroed(),
            rates: [0; 3],
            low_blocks: 0,
        }
    }

    /// Whether updates with these settings can have left this state, as far as their arithmetic
    /// depends on it. With any other state, numbers would overflow.
    pub fn accepts(&self, state: &State) -> bool {
        let LastField { is_known, mag } = &state.last_field;
        state.rotation.is_sound(self.rest.max_bias)
            && state.dt_remainder < 1 << DT_BITS
            && self.schedule.is_sound(&state.schedule, &state.gains)
            && self.rest.is_sound(&state.rest)
            && state.due <= job::CLOSE
            && self.compass.is_sound(&state.compass)
            && state.filter.is_sound()
            && state.uncertainty.is_sound()
            && state.gap | is_known <= 1
            && mag.iter().all(|part| i16::try_from(*part).is_ok())
            && are_within(&state.rates, MOST_RATE)
            && state.low_blocks < self.low_blocks
    }

    /// The orientation, with geographic north if a declination was configured.
    pub fn orientation(&self, state: &State) -> Orientation {
        let magnetic =
            Orientation { wxyz_q30: self.sensors.ahead(state.rotation.q30(), &state.rates) };
        match self.half_declination {
            Some(half) => magnetic.turned(half),
            None => magnetic,
        }
    }

    /// Gyroscope offset, counts in Q9.
    pub fn bias_q9(&self, state: &State) -> [i32; 3] {
        state.rotation.bias
    }

    /// The whole estimate in float, with these rates of the newest sample, counts. It takes many
    /// cycles.
    pub fn attitude(&self, state: &State, gyr: &[i16; 3]) -> Attitude {
        Attitude {
            orientation: self.orientation(state).quaternion(),
            rate: self.rate(state, gyr),
            bias: self.bias(state),
            flags: self.flags(state),
        }
    }

    /// Gyroscope offset, rad/s.
    fn bias(&self, state: &State) -> [f32; 3] {
        state.rotation.bias.map(|bias| bias as f32 / 512.0 * self.gyr_rad_s)
    }

    /// Rotation rate of these counts, less the offset, rad/s.
    pub(super) fn rate(&self, state: &State, gyr: &[i16; 3]) -> [f32; 3] {
        difference(&gyr.map(|rate| f32::from(rate) * self.gyr_rad_s), &self.bias(state))
    }

    /// Health of the estimate. A gap is a step of more than 1.25 periods in the last quarter of a
    /// second. `acc_rejected`, `over_range` and `skipped` stay false.
    pub fn flags(&self, state: &State) -> Flags {
        Flags {
            initialised: self.schedule.is_started(&state.schedule),
            at_rest: state.rest.is_at_rest(),
            mag_disturbed: state.compass.is_disturbed(),
            gap: state.gap != 0,
            ..Flags::default()
        }
    }

    /// Standard deviations of the estimate, renewed once a block of about a quarter of a second. In
    /// free flight ([`Estimator::coast`]) they tell only that the tilt is uncertain.
    // Inlined, so that the compiler leaves out unused parts.
    #[inline(always)]
    pub fn quality(&self, state: &State) -> Quality {
        let (field, bias) = (state.compass.reference(), self.bias_state(state));
        self.uncertainty.quality(&state.uncertainty, field, bias)
    }

    /// State of the gyroscope's offset.
    pub fn bias_state(&self, state: &State) -> BiasState {
        self.rest.bias_state(&state.rest)
    }

    /// Whether the tilt's standard deviation is within the root of this variance, Q28 rad^2,
    /// without a float. Unlike [`Self::quality`], it counts only how the accelerations pull now: a
    /// body that came to rest need not wait until what pulled it before is forgotten.
    pub fn tilt_is_within(&self, state: &State, variance_q28: i32) -> bool {
        state.uncertainty.tilt_is_within(variance_q28)
    }

    /// Find tilt and heading anew from the next block of samples on, as after a gap; the learned
    /// offset stays. For a body whose estimate a false rate has turned.
    #[inline(never)]
    pub fn level(&self, state: &mut State) {
        self.schedule.restart(&mut state.schedule);
        self.expect_large_gains(state);
    }

    /// Find the attitude anew from the next block of samples on, as after [`Estimator::start`]. The
    /// learned offset and field stay.
    pub fn reset(&self, state: &mut State) {
        let before = *state;
        *state = State {
            rest: before.rest,
            compass: before.compass,
            heading_tick: before.heading_tick,
            ..self.start()
        };
        state.rotation.bias = before.rotation.bias;
        state.rest.interrupt();
        state.uncertainty.keep_bias(&before.uncertainty);
    }

    /// Take one sample, `dt_us` microseconds after the sample before; with 0, nothing turns. More
    /// than 30,000 us, or than 1.25 to 10 periods if that is less, are a gap. Only that much of a
    /// gap is integrated, and the gains are a running mean's again. Period and scale determine the
    /// number of periods.
    #[inline]
    pub fn update(&self, state: &mut State, dt_us: u32, counts: &Counts) {
        let gyr = counts.gyr;
        let mut acc = counts.acc.map(i32::from);
        let mut mag = counts.mag.map(|mag| mag.map(i32::from));
        let long = dt_us > self.max_short_dt_us;
        let limit = state.gains.acc_limit;
        if limit != 0 {
            // A mask of all bits or none: the core has no conditional move.
            let size = acc[0].abs() + acc[1].abs() + acc[2].abs();
            let within = (size - limit) >> 31;
            acc = acc.map(|acc| acc & within);
            // The heading may be off by any angle: the last field stands for the fields between a
            // slow magnetometer's samples.
            match mag {
                Some(mag) => state.last_field = LastField { is_known: 1, mag },
                None if state.last_field.is_known != 0 => mag = Some(state.last_field.mag),
                None => {}
            }
        }
        let job =
            if long { rest::NO_JOB } else { self.rest.add(&mut state.rest, &gyr, &counts.acc) };
        let (mut step_us, mut shift) = (dt_us, self.turn_shift);
        if long {
            (step_us, shift) = self.long_step(state, dt_us, &gyr);
        }
        self.turn(state, &gyr, step_us, shift);
        S::keep_rates(&mut state.rates, &gyr, &state.rotation.bias);
        let (acc, mag) = self.sensors.now(&state.rates, (acc, mag));

        // Heading correction is skipped in steps that are long or run housekeeping, to bound the
        // worst-case cycles.
        // [`rest::NO_JOB`], of a long step, wraps to 0.
        let busy = job.wrapping_add(1) <= rest::VERTICAL + 1
            || state.compass.is_due()
            || (state.due != 0 && (mag.is_none() || job::is_turn(job)));
        if busy {
            self.housekeeping(state, job, &gyr, acc[2]);
        }
        let products = state.rotation.products();
        let down = products.down();
        let shift = state.gains.heading.shift & 31;
        let heading = mag.as_ref().filter(|_| !busy).map(|mag| {
            let tick = state.rest.tick();
            let samples = tick.wrapping_sub(state.heading_tick).min(4 << shift) as i32;
            state.heading_tick = tick;
            let compass = &mut state.compass;
            let sine = self.compass.heading(compass, &products, &down, mag, (tick, limit != 0));
            Heading { sine, samples }
        });
        let view =
            View { products: &products, down: &down, acc: &acc, heading, gains: &state.gains };
        let correction = self.filter.correction(&mut state.filter, &view);
        let (tilt, turn) = (correction.tilt, correction.heading);
        let pending = &mut state.rotation.pending;
        pending[0] += tilt[0] + ((turn * down[0]) >> shift);
        pending[1] += tilt[1] + ((turn * down[1]) >> shift);
        pending[2] += tilt[2] + ((turn * down[2]) >> shift);
    }

    /// Take one sample of a body in free flight, `dt_us` after the sample before: the rates alone
    /// turn the estimate. The accelerometer feels thrust and air, which show no vertical, so
    /// neither tilt, heading nor offset is corrected. Of a gap, only as much is integrated as in
    /// [`Estimator::update`].
    #[inline(never)]
    pub fn coast(&self, state: &mut State, dt_us: u32, gyr: &[i16; 3]) {
        let (mut step_us, mut shift) = (dt_us, self.turn_shift);
        if dt_us > self.max_short_dt_us {
            state.gap = 1;
            (step_us, shift) = self.coarse(dt_us.min(self.max_dt_us), gyr);
        }
        self.turn(state, gyr, step_us, shift);
        S::keep_rates(&mut state.rates, gyr, &state.rotation.bias);
        // They keep the norm.
        let _ = state.rotation.products();
        state.rest.interrupt();
        state.uncertainty.lose_tilt();
    }

    /// Integrate the rates over a step. Time and shift of a long step come from [`Self::coarse`].
    #[inline(always)]
    fn turn(&self, state: &mut State, gyr: &[i16; 3], step_us: u32, shift: u32) {
        let product = step_us * self.per_count_us + state.dt_remainder;
        state.dt_remainder = product & ((1 << DT_BITS) - 1);
        let half_angle = (product >> DT_BITS) as i32;
        state.rotation.turn(gyr, PerCount { half_angle, shift });
    }

    /// Runs one job: of the rest detection or the gains, else of the compass, else of the
    /// deviations. A long step runs none.
    #[inline(never)]
    fn housekeeping(&self, state: &mut State, job: u32, gyr: &[i16; 3], acc_z: i32) {
        if job < rest::START_UP {
            self.rest.close(&mut state.rest, job, &mut state.rotation.bias);
        } else if job == rest::START_UP {
            if state.schedule.is_first_block() && acc_z > 0 {
                state.rotation.turn_over();
            }
            state.gap = 0;
            self.schedule.next_block(&mut state.schedule, &mut state.gains);
            state.due = job::CLOSE;
        } else if job == rest::VERTICAL {
            self.check_vertical(state);
        } else if job == rest::NO_JOB {
            // The step is long.
        } else if state.compass.is_due() && (state.due == 0 || !job::is_turn(job)) {
            self.compass.judge(&mut state.compass, gyr);
        } else {
            self.update_uncertainty(state, gyr);
        }
    }

    /// Begins anew where the mean accelerations of blocks have long been less than gravity along
    /// the estimated vertical, as the float filters do (`consistency`). A mean is half a block old:
    /// the mean rate turns it into the axes that the body has now. A block in which the body turns
    /// fast has no vertical, and one of a fall neither.
    #[inline(never)]
    fn check_vertical(&self, state: &mut State) {
        let down = state.rotation.down();
        let [rates, acc] = state.rest.means();
        // Q12.
        let turn = rates.map(|rate| (rate * self.half_block) >> 11);
        let is_low = square(&turn) <= SLOW_TURN2 && square(&acc) >= self.fall2 && {
            let [x, y, z] = cross(&acc, &turn).map(|part| part >> 12);
            let now = [acc[0] + x, acc[1] + y, acc[2] + z];
            -(dot(&down, &now) >> 15) < self.least_up
        };
        if !is_low {
            state.low_blocks = 0;
            return;
        }
        state.low_blocks += 1;
        if state.low_blocks == self.low_blocks {
            state.low_blocks = 0;
            self.level(state);
        }
    }

    /// Runs the next job of the uncertainties.
    #[inline(never)]
    fn update_uncertainty(&self, state: &mut State, gyr: &[i16; 3]) {
        let job = state.due;
        state.due -= 1;
        // A running mean smooths nothing, so nothing pulls.
        if state.due == job::PULL && !state.gains.is_settled() {
            state.due = job::GROW;
            state.uncertainty.end_pull();
        }
        let (own, uncertainty) = (&self.uncertainty, &mut state.uncertainty);
        let (schedule, gain_log2) = (&self.schedule, state.schedule.gain_log2);
        match job {
            job::CLOSE => {
                let good_field = self.rest.is_recent(&state.rest, state.heading_tick)
                    && state.compass.reference().is_some()
                    && !state.compass.is_disturbed();
                own.close(uncertainty, state.rest.is_at_rest(), good_field);
            }
            job::TURN => own.turn(uncertainty, &lag::rates(gyr, &state.rotation.bias)),
            job::TILT => own.correct_tilt(uncertainty, schedule.tilt.raised(gain_log2)),
            job::HEADING => own.correct_heading(uncertainty, schedule.heading.raised(gain_log2)),
            job::PULL => {
                let half = state.filter.half_correction(schedule.tilt.own);
                own.pull(uncertainty, half, self.rest.shift);
            }
            job::GROW => own.grow(uncertainty),
            _ => {}
        }
    }

    /// Large gains could overflow: limits accelerations from now on. The rest under way does not
    /// count.
    #[inline(always)]
    fn expect_large_gains(&self, state: &mut State) {
        self.schedule.limit_acc(&mut state.gains);
        state.rest.interrupt();
    }

    /// A step of more than 1.25 periods: time and shift of its integration, from [`Self::coarse`].
    /// A gap begins the gains anew.
    #[cold]
    #[inline(never)]
    fn long_step(&self, state: &mut State, dt_us: u32, gyr: &[i16; 3]) -> (u32, u32) {
        state.gap = 1;
        let mut dt_us = dt_us;
        if dt_us > self.max_dt_us {
            dt_us = self.max_dt_us;
            self.schedule.restart(&mut state.schedule);
            state.uncertainty.widen();
            self.expect_large_gains(state);
        }
        self.coarse(dt_us, gyr)
    }

    /// A time (us) of more than 1.25 periods, divided by `2^coarse_shift`, and its shift. If the
    /// body turns so fast that the whole time would be too large a rotation, the time is 1.25
    /// periods.
    fn coarse(&self, mut dt_us: u32, gyr: &[i16; 3]) -> (u32, u32) {
        if dt_us * size(gyr) > self.max_rotation {
            dt_us = self.max_short_dt_us;
        }
        (dt_us >> (self.coarse_shift & 31), self.turn_shift - self.coarse_shift)
    }
}

impl<F> Estimator<F, Late> {
    /// The field's lag is known better, s.
    pub(super) fn set_mag_lag_s(&mut self, lag_s: f32) {
        self.sensors.mag = Lag::unit(self.gyr_rad_s).times(lag_s);
    }
}

/// Square of the length of a vector of 16 bits a part.
#[inline(always)]
fn square(v: &[i32; 3]) -> u32 {
    v.iter().map(|part| (part * part) as u32).sum()
}

/// Square of the largest turn in half a block whose mean acceleration shows a vertical, Q24 rad^2:
/// 0.27 rad, at 1.7 rad/s in a block of 0.32 s.
const SLOW_TURN2: u32 = 1_224_000;

/// Largest plausible rate less its offset, counts.
const MOST_RATE: i32 = 1 << 16;

/// Cosine and sine of half the declination; `None` when it is zero.
fn half_declination(declination_rad: f32) -> Result<Option<(Q15, Q15)>, ConfigError> {
    use core::f32::consts::PI;
    in_range(declination_rad, -PI, PI, "declination_rad")?;
    let (sin, cos) = Angles::sin_cos_q30(Angles::from_rad(0.5 * declination_rad));
    Ok((declination_rad != 0.0).then_some((cos >> 15, sin >> 15)))
}

#[cfg(test)]
mod tests;
