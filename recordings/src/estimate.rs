//! Runs any filter in any arithmetic: a sample in, an orientation out.

use std::ops::RangeInclusive;

use tvc_fusion::filter::Real;
use tvc_fusion::{Config, ConfigError, Estimator, Filter, Quaternion, Sample, fixed};

use crate::score::unit;
use crate::settings::{self, Gains};
use crate::{Choice, Facts, FilterName, Mode, RecordedSample, Scalar};

/// Most steps that a sampling period is divided into in fixed point.
const MOST_PARTS: f64 = 1000.0;

/// Calls a function of the filter that has this name, in floating point of this kind.
macro_rules! by_name {
    ($name:expr, $real:ty, $run:ident($($given:expr),+)) => {
        match $name {
            FilterName::Gyro => $run::<tvc_fusion::Gyro<$real>>($($given),+),
            FilterName::Complementary => $run::<tvc_fusion::Complementary<$real>>($($given),+),
            FilterName::Mahony => $run::<tvc_fusion::Mahony<$real>>($($given),+),
            FilterName::Madgwick => $run::<tvc_fusion::Madgwick<$real>>($($given),+),
            FilterName::Vqf => $run::<tvc_fusion::Vqf<$real>>($($given),+),
            FilterName::Kalman => $run::<tvc_fusion::Kalman<$real>>($($given),+),
        }
    };
}
pub(crate) use by_name;

/// A filter that runs on a recording.
pub struct Estimate {
    engine: Box<dyn Engine>,
    magnetometer: bool,
    period_s: f64,
    last_s: Option<f64>,
}

trait Engine {
    /// Takes a sample `dt_s` after the one before; sensor to north-east-down, `[w, x, y, z]`, of
    /// unit length within 1e-4.
    fn update(&mut self, dt_s: f64, sample: &RecordedSample, mag_ut: Option<[f64; 3]>) -> [f64; 4];
}

impl Estimate {
    /// A filter that waits for its first sample.
    ///
    /// # Errors
    /// A setting that is not there or out of range, a filter without fixed point.
    pub fn new(choice: &Choice, facts: &Facts) -> Result<Self, String> {
        let engine = match (choice.scalar, choice.filter) {
            (Scalar::F32, filter) => by_name!(filter, f32, in_float(choice, facts)),
            (Scalar::F64, filter) => by_name!(filter, f64, in_float(choice, facts)),
            (Scalar::Fixed, FilterName::Mahony) => in_fixed::<fixed::Mahony>(choice, facts),
            (Scalar::Fixed, FilterName::Vqf) => in_fixed::<fixed::Vqf>(choice, facts),
            (Scalar::Fixed, FilterName::Madgwick) => in_fixed::<fixed::Madgwick>(choice, facts),
            (Scalar::Fixed, FilterName::Complementary) => {
                in_fixed::<fixed::Complementary>(choice, facts)
            }
            (Scalar::Fixed, other @ (FilterName::Gyro | FilterName::Kalman)) => Err(format!(
                "{other} has no fixed-point form; complementary, mahony, madgwick and vqf have one"
            )),
        }?;
        Ok(Self {
            engine,
            magnetometer: choice.mode == Mode::NineD,
            period_s: facts.period_s,
            last_s: None,
        })
    }

    /// Takes the next sample; the orientation, sensor to north-east-down, `[w, x, y, z]`, of unit
    /// length. The time step is the difference of the samples' times.
    pub fn update(&mut self, sample: &RecordedSample) -> [f64; 4] {
        let last_s = self.last_s.replace(sample.time_s);
        let dt_s = last_s.map_or(self.period_s, |last_s| sample.time_s - last_s);
        unit(self.step(dt_s, sample))
    }

    /// Takes a sample `dt_s` after the one before; the orientation, sensor to north-east-down,
    /// `[w, x, y, z]`, just as the filter has it: of unit length within 1e-4 in fixed point.
    pub fn step(&mut self, dt_s: f64, sample: &RecordedSample) -> [f64; 4] {
        let mag_ut = sample.mag_ut.filter(|_| self.magnetometer);
        self.engine.update(dt_s, sample, mag_ut)
    }
}

fn in_float<F>(choice: &Choice, facts: &Facts) -> Result<Box<dyn Engine>, String>
where
    F: Filter<Gains: Gains> + 'static,
{
    let config = config::<F::Gains>(choice, facts)?;
    let estimator = Estimator::<F>::new(&config).map_err(|error| refused(choice, error))?;
    Ok(Box::new(estimator))
}

fn in_fixed<F>(choice: &Choice, facts: &Facts) -> Result<Box<dyn Engine>, String>
where
    F: fixed::Filter<Gains: Gains> + 'static,
{
    let config = config::<F::Gains>(choice, facts)?;
    let scale = fixed::Scale {
        gyr_rad_s: within(facts.scale.gyr_rad_s, &fixed::Scale::GYR_RAD_S),
        acc_m_s2: within(facts.scale.acc_m_s2, &fixed::Scale::ACC_M_S2),
        mag_ut: within(facts.scale.mag_ut, &fixed::Scale::MAG_UT),
    };
    let period_us = facts.period_s * 1e6;
    // A rate in single precision may make the period half a microsecond too long.
    let parts = ((period_us - 0.5) / f64::from(*fixed::PERIOD_US.end())).ceil().max(1.0);
    let refused = |error| refused(choice, error);
    // Else a header that says 1e-30 Hz would take for ever, a step at a time.
    if parts > MOST_PARTS {
        return Err(refused(ConfigError::OutOfRange("period_us")));
    }
    let step_us = (period_us / parts).round() as u32;
    let estimator = fixed::Estimator::<F>::new(&config, &scale, step_us).map_err(refused)?;
    Ok(Box::new(Counted {
        lag: fixed::FieldLag::new(&config).map_err(refused)?,
        state: estimator.start(),
        estimator,
        scale,
        parts: parts as u32,
        owed_us: 0.0,
    }))
}

pub(crate) fn config<G: Gains>(choice: &Choice, facts: &Facts) -> Result<Config<G>, String> {
    settings::config(choice.filter, facts.gyro_range_rad_s, &choice.settings)
}

pub(crate) fn refused(choice: &Choice, error: ConfigError) -> String {
    let ConfigError::OutOfRange(name) = error;
    let set = choice.settings.iter().rev().find(|set| set.key == name);
    let what = match set {
        Some(set) => set.to_string(),
        None if name == "period_us" => "the recording's sampling period".to_owned(),
        None => name.to_owned(),
    };
    format!("{what} is out of range for {} in {}", choice.filter, choice.scalar)
}

fn within(value: f32, range: &RangeInclusive<f32>) -> f32 {
    value.clamp(*range.start(), *range.end())
}

impl<F: Filter> Engine for Estimator<F> {
    fn update(&mut self, dt_s: f64, sample: &RecordedSample, mag_ut: Option<[f64; 3]>) -> [f64; 4] {
        let attitude = self.update(dt_s as f32, &self::sample(sample, mag_ut));
        let Quaternion { w, x, y, z } = attitude.orientation;
        [w, x, y, z].map(double)
    }
}

/// A recorded sample, with this field, for the float filters.
pub(crate) fn sample(recorded: &RecordedSample, mag_ut: Option<[f64; 3]>) -> Sample {
    let single = |v: [f64; 3]| v.map(|c| c as f32);
    Sample {
        gyr: single(recorded.gyr_rad_s),
        acc: single(recorded.acc_m_s2),
        mag: mag_ut.map(single),
    }
}

pub(crate) fn double<T: Real>(value: T) -> f64 {
    // The remainder of the conversion to single precision fits into single precision again.
    let high = value.to_f32();
    f64::from(high) + f64::from((value - T::from_f32(high)).to_f32())
}

/// An estimator in fixed point: SI values are turned back into the counts that they came from.
struct Counted<F> {
    estimator: fixed::Estimator<F>,
    state: fixed::State,
    lag: fixed::FieldLag,
    scale: fixed::Scale,
    /// Number of equal steps that a sampling period is divided into.
    parts: u32,
    /// Time that is left over because steps are whole microseconds, us.
    owed_us: f64,
}

impl<F: fixed::Filter> Engine for Counted<F> {
    fn update(&mut self, dt_s: f64, sample: &RecordedSample, mag_ut: Option<[f64; 3]>) -> [f64; 4] {
        // NaN becomes zero, as does time that goes backwards.
        let counts = |v: [f64; 3], unit: f32| v.map(|c| (c / f64::from(unit)).round() as i16);
        let gyr = counts(sample.gyr_rad_s, self.scale.gyr_rad_s);
        let acc = counts(sample.acc_m_s2, self.scale.acc_m_s2);
        let mag = mag_ut.map(|mag| counts(mag, self.scale.mag_ut));
        for part in 1..=self.parts {
            let mag = mag.filter(|_| part == self.parts);
            self.owed_us += dt_s.max(0.0) * 1e6 / f64::from(self.parts);
            let whole_us = self.owed_us.round();
            self.owed_us -= whole_us;
            let counts = fixed::Counts { gyr, acc, mag };
            self.estimator.update(&mut self.state, whole_us as u32, &counts);
            self.lag.learn(&mut self.estimator, &self.state, whole_us as u32, &counts);
        }
        let orientation = self.estimator.orientation(&self.state);
        orientation.wxyz_q30.map(f64::from)
    }
}
