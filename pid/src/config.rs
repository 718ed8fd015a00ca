//! Settings in SI units, and their errors.

use core::fmt;
use core::ops::RangeInclusive;

/// The three gains, in output units per error, per error and second, and per rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gains {
    /// Proportional.
    pub kp: f32,
    /// Integral, 1/s.
    pub ki: f32,
    /// Derivative, s.
    pub kd: f32,
}

/// Where the derivative comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Derivative {
    /// A measured rate, such as a gyroscope's: the best where there is one.
    Rate,
    /// Differences of the measurement: no kick when the setpoint moves.
    Measurement,
    /// Differences of `weight * setpoint - measurement`: 1 is the derivative of the error.
    Error {
        /// Share of the setpoint, 0 to 1.
        weight: f32,
    },
}

/// Bound of the integral while the output is limited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AntiWindup {
    /// The part that the limits cut off draws the integral back, with this time constant (s).
    BackCalculation {
        /// Tracking time, s, at least the sample period. Around `sqrt(kd / ki)` or `kp / ki` is
        /// usual.
        time_s: f32,
    },
    /// The integral stands still while the output is limited and the error would drive it further.
    Conditional,
}

/// Configuration of a [`Pid`](crate::Pid).
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Sample period, s.
    pub period_s: f32,
    /// Gains.
    pub gains: Gains,
    /// Source of the derivative.
    pub derivative: Derivative,
    /// Time constant of the derivative's low-pass filter, s; 0 is no filter.
    pub derivative_filter_s: f32,
    /// Share of the setpoint in the proportional action, 0 to 1. Less than 1 reduces the overshoot
    /// of steps without changing the response to disturbances.
    pub setpoint_weight: f32,
    /// Least and greatest output.
    pub limit: RangeInclusive<f32>,
    /// Greatest change of the output per second; infinite is none.
    pub slew_per_s: f32,
    /// Treatment of the integral while the output is limited.
    pub anti_windup: AntiWindup,
}

impl Config {
    /// No gains, output limited to -1..1 without slew limit, derivative of a measured rate without
    /// filter.
    pub fn new(period_s: f32) -> Self {
        Self {
            period_s,
            gains: Gains::default(),
            derivative: Derivative::Rate,
            derivative_filter_s: 0.0,
            setpoint_weight: 1.0,
            limit: -1.0..=1.0,
            slew_per_s: f32::INFINITY,
            anti_windup: AntiWindup::Conditional,
        }
    }
}

/// A configuration that cannot work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// The named parameter is not finite or outside its range.
    OutOfRange(&'static str),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange(name) => write!(f, "{name} is out of range"),
        }
    }
}

impl core::error::Error for ConfigError {}

/// `value` is in `low..=high`.
pub(crate) fn in_range(
    value: f32,
    low: f32,
    high: f32,
    name: &'static str,
) -> Result<(), ConfigError> {
    let is_right = (low..=high).contains(&value);
    is_right.then_some(()).ok_or(ConfigError::OutOfRange(name))
}

/// Largest accepted gain or limit: Q16's range.
pub(crate) const LARGEST: f32 = 32_000.0;

/// Shortest and longest sample period, s.
pub(crate) const PERIOD_S: RangeInclusive<f32> = 1e-5..=10.0;
