//! What every filter shares: from samples to attitude.

use nalgebra::Vector3;

use crate::config::{Config, ConfigError, in_range, positive};
use crate::field::{Field, HeadingError, plausible};
use crate::quaternion::{HalfRows, Quaternion, dot};
use crate::real::Real;
use crate::rest::Rest;

/// Standard gravity, m/s^2.
pub const GRAVITY: f32 = 9.806_65;

/// Shortest acceleration that has a direction, m/s^2: free fall and an absent sensor are below it.
const LEAST_ACC: f32 = 0.5;

/// Largest acceleration component taken for one, m/s^2: a thousand g.
const MOST_ACC: f32 = 10_000.0;

/// One sample of the sensors, all in the same body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Rotation rate, rad/s: mean over the time since the last sample, right-handed about each axis.
    pub gyr: Vector3<f32>,
    /// Specific force, m/s^2: at rest 9.81 along the axis that points up, so (0, 0, -9.81) in a level
    /// forward-right-down frame.
    pub acc: Vector3<f32>,
    /// Magnetic field, uT, when there is a fresh one; `None` for 6D operation and between the samples of a
    /// slower magnetometer.
    pub mag: Option<Vector3<f32>>,
}

/// The estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude<T = f32> {
    /// Body to earth (north, east, down); without a magnetometer north is where the estimate started.
    pub orientation: Quaternion<T>,
    /// Rotation rate less the offset, body frame, rad/s.
    pub rate: Vector3<T>,
    /// Gyroscope offset, rad/s.
    pub bias: Vector3<T>,
    /// How far the estimate is to be believed.
    pub flags: Flags,
}

/// Health of an estimate. All about the last update but `initialised`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// Gravity (and, with a magnetometer, the field) has been averaged for the start-up time.
    pub initialised: bool,
    /// The body is at rest; its offset is being learned.
    pub at_rest: bool,
    /// The accelerometer was passed over: free fall, impact, hard acceleration, or not a number.
    pub acc_rejected: bool,
    /// The last field sample was disturbed, or not a number.
    pub mag_disturbed: bool,
    /// A rate has clipped lately: corrections are faster, and errors larger, than usual.
    pub over_range: bool,
    /// The time step was not positive, or the rate not a number: the update was skipped.
    pub skipped: bool,
    /// Samples were missing for longer than the configured gap before this update.
    pub gap: bool,
}

/// What a filter sees after the rates have been integrated up to the present sample.
#[derive(Clone, Debug)]
pub struct View<T> {
    /// Time step, s.
    pub dt: T,
    /// The earth's axes in the body frame, at half length.
    pub rows: HalfRows<T>,
    /// Specific force, m/s^2, when it has passed the gate.
    pub acc: Option<Vector3<T>>,
    /// Heading error, when there is a fresh and undisturbed field.
    pub heading: Option<HeadingError<T>>,
    /// Time since the last field sample, s.
    pub mag_dt: T,
    /// Least correction rate, 1/s: above 0 while starting up and after trouble.
    pub floor: T,
}

impl<T: Real> View<T> {
    /// A filter's gain, or while starting up the faster one of a running mean, in the filter's unit.
    #[inline(always)]
    pub fn gain(&self, gain: T, unit: T) -> T {
        if self.floor == T::ZERO {
            return gain;
        }
        let floor = self.floor * unit;
        if floor > gain { floor } else { gain }
    }
}

/// A filter is its answer to one question: by how much is the estimate to be turned, given what is seen?
/// Integration, start-up, gates, offset at rest and recovery are the [`Estimator`]'s.
pub trait Filter: Sized {
    /// The scalar it runs on.
    type Real: Real;
    /// Its gains, in SI units.
    type Gains: Copy;

    /// Build the coefficients.
    fn new(gains: &Self::Gains) -> Result<Self, ConfigError>;

    /// The correction, a rotation vector in the body frame **at half its length** (rad). A filter that
    /// estimates the gyroscope's offset (rad/s) corrects it.
    fn correction(
        &mut self,
        view: &View<Self::Real>,
        bias: &mut Vector3<Self::Real>,
    ) -> Vector3<Self::Real>;
}

/// An attitude estimator around a [`Filter`].
#[derive(Clone, Debug)]
pub struct Estimator<F: Filter> {
    filter: F,
    field: Field<F::Real>,
    rest: Rest<F::Real>,
    orientation: Quaternion<F::Real>,
    /// Correction found in the last update, applied with the next integration (half rotation vector).
    pending: Vector3<F::Real>,
    rate: Vector3<F::Real>,
    bias: Vector3<F::Real>,
    flags: Flags,
    phase: Phase,
    /// Time, s, that the corrections have been averaging for; they slow down with it.
    age: F::Real,
    mag_dt: F::Real,
    acc_low2: F::Real,
    acc_high2: F::Real,
    gyro_range: F::Real,
    recovery_s: F::Real,
    gap_s: f32,
    start_up_s: F::Real,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing seen yet.
    Blank,
    /// Averaging: the corrections are a running mean.
    Settling,
    /// The filter's own gains.
    Running,
}

/// Age at which the running mean is slower than any useful gain, s.
const SETTLED_S: f32 = 20.0;

impl<F: Filter> Estimator<F> {
    /// An estimator that waits for its first sample.
    pub fn new(config: &Config<F::Gains>) -> Result<Self, ConfigError> {
        if config.acc_gate.is_nan() || config.acc_gate <= 0.0 {
            return Err(ConfigError::OutOfRange("acc_gate"));
        }
        in_range(config.gyro_range_rad_s, 0.1, 200.0, "gyro_range_rad_s")?;
        positive(config.recovery_s, "recovery_s")?;
        in_range(config.gap_s, 0.001, 10.0, "gap_s")?;
        in_range(config.start_up_s, 0.0, SETTLED_S, "start_up_s")?;
        let real = F::Real::from_f32;
        let zero = Vector3::new(F::Real::ZERO, F::Real::ZERO, F::Real::ZERO);
        let low = (GRAVITY * (1.0 - config.acc_gate)).max(LEAST_ACC);
        let high = (GRAVITY * (1.0 + config.acc_gate)).min(2.0 * MOST_ACC);
        Ok(Self {
            filter: F::new(&config.gains)?,
            field: Field::new(&config.field, config.declination_rad)?,
            rest: Rest::new(&config.rest)?,
            orientation: Quaternion::IDENTITY,
            pending: zero,
            rate: zero,
            bias: zero,
            flags: Flags::default(),
            phase: Phase::Blank,
            age: F::Real::ZERO,
            mag_dt: F::Real::ZERO,
            acc_low2: real(low * low),
            acc_high2: real(high * high),
            gyro_range: real(config.gyro_range_rad_s),
            recovery_s: real(config.recovery_s),
            gap_s: config.gap_s,
            start_up_s: real(config.start_up_s),
        })
    }

    /// The present estimate.
    pub fn attitude(&self) -> Attitude<F::Real> {
        Attitude {
            orientation: self.orientation,
            rate: self.rate,
            bias: self.bias,
            flags: self.flags,
        }
    }

    /// Take one sample, `dt_s` seconds after the one before (of the first, any value does).
    ///
    /// Never fails: what cannot be used is left out, and the flags say so. With a `dt_s` that is zero,
    /// negative or not a number, or a rate that is not a number, nothing but the flags changes.
    #[inline]
    pub fn update(&mut self, dt_s: f32, sample: &Sample) -> Attitude<F::Real> {
        let real = F::Real::from_f32;
        let finite =
            |v: &Vector3<f32>, most: f32| v.x.within(most) && v.y.within(most) && v.z.within(most);
        let gyr_valid = finite(&sample.gyr, f32::MAX);
        self.flags.skipped = !gyr_valid || dt_s.to_bits() as i32 <= 0 || !dt_s.within(f32::MAX);
        self.flags.gap = false;
        if self.phase == Phase::Blank {
            if gyr_valid {
                self.flags.skipped = false;
                self.start(sample);
            }
            return self.attitude();
        }
        if self.flags.skipped {
            return self.attitude();
        }
        let mut dt = real(dt_s);
        if !dt_s.within(self.gap_s) {
            self.flags.gap = true;
            self.rest.interrupt();
            dt = real(self.gap_s);
            self.unsettle();
        }

        let (gyr, clipped) = self.in_range(&sample.gyr);
        if clipped {
            self.flags.over_range = true;
            self.unsettle();
        }
        let acc = Vector3::new(real(sample.acc.x), real(sample.acc.y), real(sample.acc.z));
        let acc_valid = finite(&sample.acc, MOST_ACC);
        if acc_valid {
            self.rest.update(dt, &gyr, &acc, &mut self.bias);
        } else {
            self.rest.interrupt();
        }
        self.flags.at_rest = self.rest.is_at_rest();

        self.rate = Vector3::new(
            gyr.x - self.bias.x,
            gyr.y - self.bias.y,
            gyr.z - self.bias.z,
        );
        let half_dt = dt * F::Real::HALF;
        self.orientation.advance(&Vector3::new(
            self.rate.x * half_dt + self.pending.x,
            self.rate.y * half_dt + self.pending.y,
            self.rate.z * half_dt + self.pending.z,
        ));

        let rows = self.orientation.half_rows();
        let acc = (acc_valid && self.passes(&acc)).then_some(acc);
        self.flags.acc_rejected = acc.is_none();
        self.mag_dt += dt;
        let mag_dt = self.mag_dt;
        let heading = sample.mag.and_then(|mag| self.heading(&rows, &mag));
        let floor = self.floor(dt);
        let view = View {
            dt,
            rows,
            acc,
            heading,
            mag_dt,
            floor,
        };
        self.pending = self.filter.correction(&view, &mut self.bias);
        self.attitude()
    }

    /// The first sample: tilt and heading as they are seen.
    #[cold]
    fn start(&mut self, sample: &Sample) {
        let real = F::Real::from_f32;
        let up = sample.acc.map(real);
        let mag = sample.mag.map(|mag| mag.map(real)).filter(plausible);
        self.flags.acc_rejected = !self.align(&up, mag.as_ref());
        if !self.flags.acc_rejected {
            self.phase = Phase::Settling;
        }
    }

    /// Set the orientation to what is seen now; false when there is no vertical to be seen.
    fn align(&mut self, up: &Vector3<F::Real>, mag: Option<&Vector3<F::Real>>) -> bool {
        let Some(magnetic) = Quaternion::from_up_and_north(up, mag) else {
            return false;
        };
        self.orientation = match (mag, self.field.declination_rad()) {
            (Some(_), Some(declination)) => {
                let zero = F::Real::ZERO;
                Quaternion::from_rotation_vector(&Vector3::new(zero, zero, declination))
                    .mul(&magnetic)
            }
            _ => magnetic,
        };
        true
    }

    /// Corrections become faster: the attitude has been lost to some degree.
    #[cold]
    fn unsettle(&mut self) {
        self.phase = Phase::Settling;
        if self.age > self.recovery_s {
            self.age = self.recovery_s;
        }
    }

    /// Rates clamped to the sensor's range, and whether one has reached it.
    #[inline(always)]
    fn in_range(&self, gyr: &Vector3<f32>) -> (Vector3<F::Real>, bool) {
        let real = F::Real::from_f32;
        let gyr = Vector3::new(real(gyr.x), real(gyr.y), real(gyr.z));
        let range = self.gyro_range;
        if gyr.x.within(range) && gyr.y.within(range) && gyr.z.within(range) {
            return (gyr, false);
        }
        let clamp = |rate: F::Real| match (rate.within(range), rate < F::Real::ZERO) {
            (true, _) => rate,
            (false, true) => -range,
            (false, false) => range,
        };
        (Vector3::new(clamp(gyr.x), clamp(gyr.y), clamp(gyr.z)), true)
    }

    #[inline(always)]
    fn passes(&self, acc: &Vector3<F::Real>) -> bool {
        let n = dot(acc, acc);
        n.within(self.acc_high2) && !n.within(self.acc_low2)
    }

    #[inline(always)]
    fn heading(
        &mut self,
        rows: &HalfRows<F::Real>,
        mag: &Vector3<f32>,
    ) -> Option<HeadingError<F::Real>> {
        let real = F::Real::from_f32;
        let mag = Vector3::new(real(mag.x), real(mag.y), real(mag.z));
        let dt = core::mem::take(&mut self.mag_dt);
        let error = if plausible(&mag) {
            if !self.field.is_known() {
                return self.first_heading(&mag);
            }
            let earth = Vector3::new(
                dot(&rows.north, &mag),
                dot(&rows.east, &mag),
                dot(&rows.down, &mag),
            );
            self.field.judge(dt, &earth, &self.rate)
        } else {
            None
        };
        self.flags.mag_disturbed = error
            .as_ref()
            .is_none_or(|error| error.weight != F::Real::ONE);
        error
    }

    /// The first field after a start without one: the heading is taken from it as it is.
    #[cold]
    fn first_heading(&mut self, mag: &Vector3<F::Real>) -> Option<HeadingError<F::Real>> {
        let up = self.orientation.up();
        self.align(&up, Some(mag));
        self.unsettle();
        let rows = self.orientation.half_rows();
        let earth = Vector3::new(
            dot(&rows.north, mag),
            dot(&rows.east, mag),
            dot(&rows.down, mag),
        );
        self.field.judge(F::Real::ZERO, &earth, &self.rate);
        None
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
            self.flags.over_range = false;
        }
        self.age.recip()
    }
}
