//! The part that all filters share: from samples to attitude.
//!
//! # The equations
//! With the measured rates `g`, their offset `b`, the time step `dt`, half the correction `c` from
//! the step before, the specific force `a` and the field `m`:
//!
//! ```text
//! w = g - b                               the rotation rate, body frame
//! h = w dt / 2 + c                        half the rotation vector of the step, body frame
//! q = q (cos |h|, h sin|h| / |h|)         the orientation, body to earth
//! n, e, d = rows of R(q)                  north, east and down in the body frame
//! a' = a + a x (lag w) + ...              as it is now, and m' likewise: `lag`
//! c = filter(a', d; heading error of m')  half a rotation vector, body frame
//! ```
//!
//! The rates count as constant within a step. The correction of a sample comes with the next step,
//! so it costs no rotation of its own. The output is ahead of `q` by the lag of the gyroscope,
//! `q (1, lag w / 2)`.
//!
//! # The gains at the start and after trouble
//! Of `n` equally good samples, the mean is the best estimate. The `k`-th sample moves the mean by
//! `1/k` of the difference, a gain of `1 / age` with the age in seconds. So a filter's gain is the
//! larger of its own and `1 / age`. The age grows up to [`SETTLED_S`], where a running mean is as
//! slow as the slowest filter.
//!
//! In a Kalman filter with the variance `V` of the attitude and the density `r` of the
//! measurements' noise, the gain is `V / r`, so the age is `r / V`. A gap in the samples or a
//! clipped rate adds a variance `v`:
//!
//! ```text
//! 1 / age' = 1 / age + v / r
//! ```
//!
//! # Where the rest is derived
//!
//! | file | what |
//! |---|---|
//! | `quaternion` | the series of the rotation, rows, norm |
//! | `mahony` and the other filters | the correction |
//! | `field` | the heading error, and which fields to trust |
//! | `rest`, `motion_bias` | the offset, at rest and from motion |
//! | `lag` | samples that are older than the rates |
//! | `range`, `recovery` | the rotation that a clipped gyroscope hides |
//! | `consistency` | whether the estimated vertical can be right |
//! | `quality` | how far the estimate may be off |

mod attitude;
mod state;

use core::mem::take;

use crate::config::{Config, GRAVITY};
use crate::consistency::Consistency;
use crate::error::{ConfigError, in_range, positive, require};
use crate::field::{Field, HeadingError, plausible};
use crate::filter::{Filter, View};
use crate::lag;
use crate::motion_bias::MotionBias;
use crate::quality::{Evidence, Quality, Uncertainty};
use crate::quaternion::{HalfRows, Quaternion};
use crate::range::{Hidden, Range};
use crate::real::Real;
use crate::recovery::{Recovery, Seen};
use crate::rest::Rest;
use crate::vector::{add, add_scaled, difference, dot, scaled, within, zero};

pub use attitude::{Attitude, Flags, Sample};
pub use state::{FieldReference, State};

/// Shortest step, s. Far shorter ones would divide by zero.
const SHORTEST_S: f32 = 1e-6;

/// An acceleration whose components are all below this, m/s^2, shows no vertical: free fall, an
/// absent sensor, or one that tells parts of g.
const MIN_ACC: f32 = 2.0;

/// Largest plausible acceleration component, m/s^2: a thousand g.
const MAX_ACC: f32 = 10_000.0;

/// Standard deviation of the attitude after a gap in the samples, rad.
const GAP_SIGMA: f32 = 0.5;

/// Steps between corrections of the quaternion's norm. A step changes the norm by less than 1e-7.
const NORM_STEPS: u8 = 8;

/// Half angle of the gyroscope's lag, about each axis, for which first order is enough, rad. Norm
/// and angle are then within 6e-6 and 1e-8.
const SHORT_TURN: f32 = 2e-3;

/// Steps between two updates of the deviations.
const UNCERTAINTY_STEPS: u8 = 64;

/// The same of a filter that tells the pull of the accelerations, which grows faster.
const PULL_STEPS: u8 = 32;

/// Steps between two looks at the acceleration along the vertical, while it is gravity or more.
const VERTICAL_STEPS: u8 = 64;

/// Age at which a running mean has become as slow as the slowest filter, s.
pub(crate) const SETTLED_S: f32 = 10.0;

/// An attitude estimator around a [`Filter`].
#[derive(Clone, Debug)]
pub struct Estimator<F: Filter> {
    filter: F,
    field: Field<F::Real>,
    rest: Rest<F::Real>,
    /// Finds the offset until a rest shows it.
    motion_bias: Option<MotionBias<F::Real>>,
    range: Range<F::Real>,
    recovery: Recovery<F::Real>,
    consistency: Consistency<F::Real>,
    uncertainty: Uncertainty<F::Real>,
    orientation: Quaternion<F::Real>,
    steps: u8,
    /// Correction found in the last update, applied with the next integration (half rotation
    /// vector).
    pending: [F::Real; 3],
    rate: [F::Real; 3],
    bias: [F::Real; 3],
    flags: Flags,
    phase: Phase,
    /// Averaging time of the corrections, s. A running mean's gain is `1 / age`; in a Kalman
    /// filter, `age` is the density of the measurement noise over the variance.
    age: F::Real,
    mag_dt: F::Real,
    /// The last time step and its half.
    last_dt: F::Real,
    half_dt: F::Real,
    /// Least and largest square of the specific force, (m/s^2)^2.
    acc_gate2: Option<(F::Real, F::Real)>,
    acc_density: F::Real,
    /// Half of the gyroscope's lag, s.
    half_gyr_lag_s: F::Real,
    /// Lag of the accelerometer behind the gyroscope, s.
    acc_lag_s: F::Real,
    gap_s: f32,
    start_up_s: F::Real,
    /// Time of the skipped samples since the last sample that was used, s.
    skipped_s: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No sample with a vertical yet.
    Blank,
    /// The corrections are a running mean.
    Settling,
    /// The corrections have the filter's own gains.
    Running,
}

impl<F: Filter> Estimator<F> {
    /// An estimator that waits for its first sample.
    ///
    /// # Errors
    /// The name of a parameter that is not finite or out of range.
    pub fn new(config: &Config<F::Gains>) -> Result<Self, ConfigError> {
        require(config.acc_gate > 0.0, "acc_gate")?;
        in_range(config.gyro_range_rad_s, 0.1, 200.0, "gyro_range_rad_s")?;
        positive(config.recovery_rad2_s, "recovery_rad2_s")?;
        in_range(config.gap_s, 0.001, 10.0, "gap_s")?;
        in_range(config.start_up_s, 0.0, SETTLED_S, "start_up_s")?;
        let real = F::Real::from_f32;
        let acc_gate2 = config.acc_gate.is_finite().then(|| {
            let low = (GRAVITY * (1.0 - config.acc_gate)).max(0.0);
            let high = (GRAVITY * (1.0 + config.acc_gate)).min(2.0 * MAX_ACC);
            (real(low * low), real(high * high))
        });
        Ok(Self {
            filter: F::new(&config.gains)?,
            field: Field::new(config)?,
            rest: Rest::new(&config.rest)?,
            motion_bias: MotionBias::new(&config.rest).filter(|_| F::CORRECTS && !F::FINDS_BIAS),
            range: Range::new(config.gyro_range_rad_s),
            recovery: Recovery::default(),
            consistency: Consistency::new(),
            uncertainty: Uncertainty::new(),
            orientation: Quaternion::IDENTITY,
            steps: 0,
            pending: zero(),
            rate: zero(),
            bias: zero(),
            flags: Flags::default(),
            phase: Phase::Blank,
            age: F::Real::ZERO,
            mag_dt: F::Real::ZERO,
            last_dt: F::Real::ZERO,
            half_dt: F::Real::ZERO,
            acc_gate2,
            acc_density: real(config.recovery_rad2_s),
            half_gyr_lag_s: lag::checked::<F::Real>(config.gyr_lag_s, "gyr_lag_s")? * F::Real::HALF,
            acc_lag_s: lag::checked(config.acc_lag_s, "acc_lag_s")?,
            gap_s: config.gap_s,
            start_up_s: real(config.start_up_s),
            skipped_s: 0.0,
        })
    }

    /// The present estimate.
    pub fn attitude(&self) -> Attitude<F::Real> {
        Attitude {
            orientation: self.present(),
            rate: self.rate,
            bias: self.bias,
            flags: self.flags,
        }
    }

    /// The orientation now, ahead of the rates by the gyroscope's lag.
    #[inline(always)]
    fn present(&self) -> Quaternion<F::Real> {
        let mut now = self.orientation;
        if self.half_gyr_lag_s != F::Real::ZERO {
            now.turn_from(&scaled(&self.rate, self.half_gyr_lag_s), SHORT_TURN);
        }
        now
    }

    /// Standard deviations of the estimate, renewed every 64 steps, and of the VQF class every 32.
    pub fn quality(&self) -> Quality<F::Real> {
        let (steepness, bias) = (self.field.steepness(), self.rest.bias_state());
        self.uncertainty.quality(steepness, bias)
    }

    /// Lag of the field behind the rates, s, as configured or as learned since.
    pub fn mag_lag_s(&self) -> F::Real {
        self.field.lag_s()
    }

    /// Take one sample, `dt_s` seconds after the sample before (any number for the first).
    ///
    /// Never fails: the update leaves out unusable values, and the flags say so. If `dt_s` is below
    /// a microsecond or not finite, or a rate is not finite, the sample is skipped. The next sample
    /// counts for the time of the skipped ones, too; together they may be a gap.
    #[inline]
    pub fn update(&mut self, dt_s: f32, sample: &Sample) -> Attitude<F::Real> {
        self.flags.gap = false;
        let has_time =
            dt_s.to_bits() as i32 >= SHORTEST_S.to_bits() as i32 && dt_s.within(f32::MAX);
        self.flags.skipped = !has_time || !within(&sample.gyr, f32::MAX);
        if self.phase == Phase::Blank {
            self.start(sample);
        } else if self.flags.skipped {
            self.skip(if has_time { dt_s } else { 0.0 });
        } else {
            let is_next = self.skipped_s.to_bits() == 0;
            let dt_s = if is_next { dt_s } else { take(&mut self.skipped_s) + dt_s };
            self.step(dt_s, sample);
        }
        self.attitude()
    }

    /// A sample is skipped, `dt_s` after the one before.
    #[cold]
    fn skip(&mut self, dt_s: f32) {
        let before_s = self.skipped_s;
        self.skipped_s = before_s + dt_s;
        if !self.skipped_s.within(self.gap_s) {
            if before_s.within(self.gap_s) {
                self.gap();
            }
            self.flags.gap = true;
        }
    }

    #[inline(always)]
    fn step(&mut self, dt_s: f32, sample: &Sample) {
        let real = F::Real::from_f32;
        let dt = if dt_s.within(self.gap_s) { real(dt_s) } else { self.gap() };

        let mut gyr = sample.gyr.map(real);
        let mut hidden = None;
        if !self.range.is_quiet(&gyr) {
            hidden = Some(self.range.examine(dt, &mut gyr));
        }
        let acc = sample.acc.map(real);
        let acc_valid = within(&sample.acc, MAX_ACC);
        if acc_valid {
            self.rest.update(dt, &gyr, &acc, &mut self.bias);
        } else {
            self.rest.interrupt();
        }
        self.flags.at_rest = self.rest.is_at_rest();

        self.rate = difference(&gyr, &self.bias);
        let half_dt = self.half(dt);
        let mut half_angle = self.pending;
        add_scaled(&mut half_angle, &self.rate, half_dt);
        self.orientation.turn(&half_angle);
        self.steps = self.steps.wrapping_add(1);
        let is_eighth = self.steps.is_multiple_of(NORM_STEPS);
        if is_eighth {
            self.orientation.restore_norm();
        }
        let rows = self.orientation.half_rows();

        let acc =
            (acc_valid && self.passes(&acc)).then(|| lag::now(&acc, &self.rate, self.acc_lag_s));
        self.flags.acc_rejected = acc.is_none();
        // If every sample has a field, there is nothing to add up.
        self.mag_dt = if self.mag_dt.within(F::Real::ZERO) { dt } else { self.mag_dt + dt };
        let mag_dt = self.mag_dt;
        let heading = sample.mag.and_then(|mag| self.heading(&rows, &mag));
        let floor = self.floor(dt);
        let view = View {
            dt,
            rate: self.rate,
            rows,
            acc,
            heading,
            mag_dt,
            floor,
            starting: !self.flags.initialised,
        };
        self.pending = self.filter.correction(&view, &mut self.bias);
        if is_eighth && F::IS_SECOND_ORDER {
            let share = const { NORM_STEPS as f32 / PULL_STEPS as f32 };
            self.uncertainty.add_pull(self.filter.pull(), F::Real::from_f32(share));
        }
        self.update_uncertainty(&view);
        if hidden.is_some() || self.recovery.is_active() {
            self.recover(&view, hidden, sample);
        }
        if self.motion_bias.is_some() && self.rest.has_moved() {
            self.find_bias(&view);
        }
        let is_impossible = F::FINDS_BIAS && !self.rest.allows(&self.bias);
        if is_impossible || F::CORRECTS && self.is_wrong(&view) {
            self.begin_anew();
        }
    }

    /// Whether the accelerations along the vertical have long been less than gravity.
    #[inline(always)]
    fn is_wrong(&mut self, view: &View<F::Real>) -> bool {
        (self.steps.is_multiple_of(VERTICAL_STEPS) || self.consistency.is_in_doubt())
            && !self.consistency.holds(view.dt, &view.rows.down, view.acc.as_ref())
    }

    /// The estimate is wrong: garbage has turned it.
    #[cold]
    fn begin_anew(&mut self) {
        self.reset();
        self.field.forget();
        if F::FINDS_BIAS {
            self.bias = zero();
            self.filter.forget();
        }
    }

    /// The offset from motion, until a rest has shown it.
    #[cold]
    #[inline(never)]
    fn find_bias(&mut self, view: &View<F::Real>) {
        if self.rest.is_bias_known() {
            self.motion_bias = None;
        } else if let Some(motion_bias) = &mut self.motion_bias
            && motion_bias.step(view, &self.pending, &mut self.bias)
        {
            self.uncertainty.narrow_bias(motion_bias.variance());
        }
    }

    /// Renews the deviations every few steps.
    #[inline(always)]
    fn update_uncertainty(&mut self, view: &View<F::Real>) {
        let good = view.heading.as_ref().is_some_and(|seen| seen.undisturbed);
        self.uncertainty.pass(view.dt, good);
        let steps = if F::IS_SECOND_ORDER { PULL_STEPS } else { UNCERTAINTY_STEPS };
        if self.steps.is_multiple_of(steps) {
            let evidence = Evidence {
                acc: view.acc.is_some(),
                pull: F::IS_SECOND_ORDER,
                floor: view.floor,
                clipped: self.flags.over_range,
                rest: self.flags.at_rest,
            };
            self.uncertainty.update(&self.rate, &evidence);
        }
    }

    /// Half the time step. It mostly equals the last one, and without an FPU a comparison is
    /// cheaper.
    #[inline(always)]
    fn half(&mut self, dt: F::Real) -> F::Real {
        if dt != self.last_dt {
            self.last_dt = dt;
            self.half_dt = dt * F::Real::HALF;
        }
        self.half_dt
    }

    /// The first sample sets tilt and heading.
    #[cold]
    fn start(&mut self, sample: &Sample) {
        let real = F::Real::from_f32;
        let mag = sample.mag.map(|mag| mag.map(real)).filter(plausible);
        let acc = sample.acc.map(real);
        let is_valid = within(&sample.acc, MAX_ACC) && self.passes(&acc);
        let seen = is_valid && self.align(&acc, mag.as_ref());
        self.flags.acc_rejected = !seen;
        if seen {
            self.uncertainty.restart();
            self.phase = Phase::Settling;
        }
    }

    /// Set the orientation from the sensors; false if they show no vertical.
    fn align(&mut self, up: &[F::Real; 3], mag: Option<&[F::Real; 3]>) -> bool {
        let Some(magnetic) = Quaternion::from_up_and_north(up, mag) else {
            return false;
        };
        self.orientation = match (mag, self.field.declination_rad()) {
            (Some(_), Some(declination)) => {
                let about_down = [F::Real::ZERO, F::Real::ZERO, declination];
                Quaternion::from_rotation_vector(&about_down).mul(&magnetic)
            }
            _ => magnetic,
        };
        true
    }

    /// Samples are missing, so the attitude is uncertain. Returns the time to integrate over, s.
    #[cold]
    fn gap(&mut self) -> F::Real {
        self.flags.gap = true;
        self.rest.interrupt();
        self.motion_bias.iter_mut().for_each(MotionBias::interrupt);
        self.unsettle(F::Real::from_f32(GAP_SIGMA * GAP_SIGMA));
        F::Real::from_f32(self.gap_s)
    }

    /// The attitude's variance has grown (rad^2): corrections become faster.
    #[cold]
    fn unsettle(&mut self, variance: F::Real) {
        self.uncertainty.widen(variance);
        if self.phase == Phase::Running {
            self.age = F::Real::from_f32(SETTLED_S);
        }
        self.phase = Phase::Settling;
        // 1/age' = 1/age + variance / density
        self.age = self.age * self.acc_density * (self.acc_density + self.age * variance).recip();
    }

    /// A rate is clipped, or clipped within the last seconds: adds the recovery's correction.
    #[cold]
    fn recover(
        &mut self,
        view: &View<F::Real>,
        hidden: Option<[Hidden<F::Real>; 3]>,
        sample: &Sample,
    ) {
        let mag = sample.mag.map(|mag| mag.map(F::Real::from_f32));
        let seen = Seen {
            acc: view.acc.filter(|_| F::CORRECTS),
            acc_density: self.acc_density,
            field: mag.filter(|mag| F::CORRECTS && plausible(mag)).zip(self.field.expected()),
            field_lag_s: self.field.lag_s(),
        };
        let hidden = hidden.unwrap_or([Hidden::Nothing; 3]);
        let (half_angle, heading_variance) = self.recovery.step(view, &hidden, &seen);
        add(&mut self.pending, &half_angle);
        if heading_variance > F::Real::ZERO {
            self.unsettle(heading_variance);
        }
        self.flags.over_range = self.recovery.is_active();
    }

    #[inline(always)]
    fn passes(&self, acc: &[F::Real; 3]) -> bool {
        let min = F::Real::from_f32(MIN_ACC);
        !within(acc, min)
            && self.acc_gate2.is_none_or(|(low, high)| {
                let n = dot(acc, acc);
                n.within(high) && !n.within(low)
            })
    }

    #[inline(always)]
    fn heading(
        &mut self,
        rows: &HalfRows<F::Real>,
        mag: &[f32; 3],
    ) -> Option<HeadingError<F::Real>> {
        let mag = mag.map(F::Real::from_f32);
        let dt = core::mem::replace(&mut self.mag_dt, F::Real::ZERO);
        if !self.field.is_known() && plausible(&mag) {
            self.first_heading(&mag);
            return None;
        }
        let error = if plausible(&mag) {
            let trusted = !self.recovery.is_active();
            self.field.heading(dt, rows, &mag, &self.rate, trusted)
        } else {
            None
        };
        self.flags.mag_disturbed = error.as_ref().is_none_or(|error| !error.undisturbed);
        error
    }

    /// The first field sets the heading.
    #[cold]
    fn first_heading(&mut self, mag: &[F::Real; 3]) {
        let up = self.orientation.up();
        self.motion_bias.iter_mut().for_each(MotionBias::interrupt);
        self.align(&up, Some(mag));
        self.unsettle(F::Real::from_f32(GAP_SIGMA * GAP_SIGMA));
        let rows = self.orientation.half_rows();
        self.field.begin(&rows, mag);
    }

    /// The gain of a running mean over the age, while that is young.
    #[inline(always)]
    fn floor(&mut self, dt: F::Real) -> F::Real {
        if self.phase == Phase::Running {
            return F::Real::ZERO;
        }
        self.age += dt;
        if !self.age.within(self.start_up_s) {
            self.flags.initialised = true;
        }
        if !self.age.within(F::Real::from_f32(SETTLED_S)) {
            self.phase = Phase::Running;
        }
        self.age.recip()
    }
}
