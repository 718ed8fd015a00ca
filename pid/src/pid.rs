//! The PID controller.

use crate::config::{AntiWindup, Config, ConfigError, Derivative, LARGEST, PERIOD_S, in_range};
use crate::scalar::Scalar;

/// Gains as the loop uses them, for one sample period. They can be interpolated
/// ([`crate::Schedule`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficients<T> {
    /// Proportional gain.
    pub(crate) kp: T,
    /// `ki T`.
    pub(crate) ki: T,
    /// `kd / (Tf + T)` on differences, `kd T / (Tf + T)` on a rate.
    pub(crate) kd: T,
    /// `Tf / (Tf + T)`.
    pub(crate) decay: T,
    /// Setpoint's share in the proportional action.
    pub(crate) weight: T,
    /// `T / Tt`, or zero for conditional integration.
    pub(crate) tracking: T,
}

impl<T: Scalar> Coefficients<T> {
    /// From a configuration in SI units.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        let (gains, period) = (&config.gains, config.period_s);
        in_range(period, *PERIOD_S.start(), *PERIOD_S.end(), "period_s")?;
        in_range(gains.kp, -LARGEST, LARGEST, "gains.kp")?;
        in_range(gains.ki * period, -LARGEST, LARGEST, "gains.ki")?;
        in_range(
            config.derivative_filter_s,
            0.0,
            1000.0,
            "derivative_filter_s",
        )?;
        in_range(config.setpoint_weight, 0.0, 1.0, "setpoint_weight")?;
        let smoothing = 1.0 / (config.derivative_filter_s + period);
        let kd = match config.derivative {
            Derivative::Rate => gains.kd * period * smoothing,
            Derivative::Measurement | Derivative::Error { .. } => gains.kd * smoothing,
        };
        in_range(kd, -LARGEST, LARGEST, "gains.kd")?;
        let tracking = match config.anti_windup {
            AntiWindup::Conditional => 0.0,
            AntiWindup::BackCalculation { time_s } => {
                in_range(time_s, period, f32::MAX, "anti_windup.time_s")?;
                period / time_s
            }
        };
        Ok(Self {
            kp: gains.kp.into(),
            ki: (gains.ki * period).into(),
            kd: kd.into(),
            decay: (config.derivative_filter_s * smoothing).into(),
            weight: config.setpoint_weight.into(),
            tracking: tracking.into(),
        })
    }

    fn proportional(&self, setpoint: T, measured: T) -> T {
        self.kp * (self.weight * setpoint - measured)
    }

    /// The point at `share` (0 to 1) of the way from these to `other`.
    pub(crate) fn towards(&self, other: &Self, share: T) -> Self {
        let mix = |a: T, b: T| a + (b - a) * share;
        Self {
            kp: mix(self.kp, other.kp),
            ki: mix(self.ki, other.ki),
            kd: mix(self.kd, other.kd),
            decay: mix(self.decay, other.decay),
            weight: mix(self.weight, other.weight),
            tracking: mix(self.tracking, other.tracking),
        }
    }
}

/// Output limits and slew.
#[derive(Clone, Copy, Debug)]
struct Limits<T> {
    low: T,
    high: T,
    /// Largest change a sample; `None` without a slew limit.
    max_step: Option<T>,
}

impl<T: Scalar> Limits<T> {
    fn new(config: &Config) -> Result<Self, ConfigError> {
        let (low, high) = (*config.limit.start(), *config.limit.end());
        in_range(low, -LARGEST, LARGEST, "limit")?;
        in_range(high, low, LARGEST, "limit")?;
        in_range(
            config.slew_per_s,
            f32::MIN_POSITIVE,
            f32::INFINITY,
            "slew_per_s",
        )?;
        let max_step = config.slew_per_s * config.period_s;
        Ok(Self {
            low: low.into(),
            high: high.into(),
            max_step: (max_step < high - low).then(|| max_step.into()),
        })
    }

    fn apply(&self, wanted: T, last: T) -> T {
        let wanted = wanted.clamped(self.low, self.high);
        match self.max_step {
            Some(step) => wanted.clamped(last - step, last + step),
            None => wanted,
        }
    }
}

/// The inputs of a sample, kept for the bumpless change of gains.
#[derive(Clone, Copy, Debug, Default)]
struct Inputs<T> {
    setpoint: T,
    measured: T,
    slope: T,
}

/// A PID controller with output limits, slew limit and anti-windup. The crate's page has the law.
#[derive(Clone, Debug)]
pub struct Pid<T> {
    coefficients: Coefficients<T>,
    limits: Limits<T>,
    /// Setpoint's share in the derivative; `None` where a measured rate gives it.
    derivative_weight: Option<T>,
    /// Integral action, in output units: gain included.
    integral: T,
    /// Derivative action after its filter, gain included.
    derivative: T,
    /// What the derivative takes differences of, in the last sample. Nothing before the first: no
    /// kick.
    previous: Option<T>,
    last: Option<Inputs<T>>,
    output: T,
}

impl<T: Scalar> Pid<T> {
    /// A controller at rest: no integral, output zero or the nearest limit.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        let limits = Limits::new(config)?;
        Ok(Self {
            coefficients: Coefficients::new(config)?,
            limits,
            derivative_weight: derivative_weight(config.derivative)?.map(T::from),
            integral: T::ZERO,
            derivative: T::ZERO,
            previous: None,
            last: None,
            output: T::ZERO.clamped(limits.low, limits.high),
        })
    }

    /// One sample: setpoint, measurement and its rate to output. The rate counts only with
    /// [`Derivative::Rate`].
    ///
    /// Inputs that are not numbers leave everything as it was.
    #[inline]
    pub fn update(&mut self, setpoint: T, measured: T, rate: T) -> T {
        if !(setpoint.is_usable() && measured.is_usable() && rate.is_usable()) {
            return self.output;
        }
        let k = self.coefficients;
        let slope = self.slope(setpoint, measured, rate);
        self.last = Some(Inputs {
            setpoint,
            measured,
            slope,
        });
        self.derivative = k.decay * self.derivative + k.kd * slope;
        let immediate = k.proportional(setpoint, measured) + self.derivative;

        let growth = k.ki * (setpoint - measured);
        let wanted = immediate + self.integral + growth;
        self.output = self.limits.apply(wanted, self.output);
        let cut = self.output - wanted;
        let integral = if k.tracking > T::ZERO {
            self.integral + growth + k.tracking * cut
        } else if cut == T::ZERO || (cut > T::ZERO) == (growth > T::ZERO) {
            // Not limited, or the error leads back from the limit.
            self.integral + growth
        } else {
            self.integral
        };
        self.integral = integral.clamped(T::from(-LARGEST), T::from(LARGEST));
        self.output
    }

    /// Change the configuration without moving the output: the integral absorbs what the other
    /// gains would change. Without integral gain nothing absorbs it, and only the slew limit
    /// softens the change; an integral gain set to zero leaves the integral as it is.
    ///
    /// # Errors
    /// A parameter out of its range, by name; everything stays as it was.
    pub fn set_config(&mut self, config: &Config) -> Result<(), ConfigError> {
        let limits = Limits::new(config)?;
        let weight = derivative_weight(config.derivative)?.map(T::from);
        let coefficients = Coefficients::new(config)?;
        self.limits = limits;
        if self.derivative_weight != weight {
            self.derivative_weight = weight;
            self.previous = None;
            self.last = None;
            self.derivative = T::ZERO;
        }
        if let Some(last) = self.last
            && coefficients.ki != T::ZERO
        {
            let action = |k: &Coefficients<T>| {
                let derivative = k.decay * self.derivative + k.kd * last.slope;
                k.proportional(last.setpoint, last.measured) + derivative
            };
            self.integral = self.integral + action(&self.coefficients) - action(&coefficients);
        }
        self.coefficients = coefficients;
        Ok(())
    }

    /// Change the gains to prepared ones, as a schedule does every sample. The integral absorbs
    /// nothing: a schedule's steps are small, and intended.
    pub fn set_coefficients(&mut self, coefficients: Coefficients<T>) {
        self.coefficients = coefficients;
    }

    /// Start again from a known output, as when control is handed over: with integral action the
    /// next output is that one, whatever the error then is.
    pub fn reset(&mut self, output: T, setpoint: T, measured: T) {
        self.output = output.clamped(self.limits.low, self.limits.high);
        self.derivative = T::ZERO;
        self.previous = None;
        self.last = None;
        self.integral = if self.coefficients.ki == T::ZERO {
            T::ZERO
        } else {
            self.output - self.coefficients.proportional(setpoint, measured)
        };
    }

    /// All that the next outputs depend on besides inputs and configuration, number by number: each
    /// is shown to `each` and becomes what that returns.
    #[inline(never)]
    pub fn memory(&mut self, each: &mut impl FnMut(T) -> T) {
        self.integral = each(self.integral);
        self.derivative = each(self.derivative);
        self.output = each(self.output);
        let known = |known: bool| if known { T::ONE } else { T::ZERO };
        let is_known = each(known(self.previous.is_some())) != T::ZERO;
        let previous = each(self.previous.unwrap_or_default());
        self.previous = is_known.then_some(previous);
        let is_known = each(known(self.last.is_some())) != T::ZERO;
        let last = self.last.unwrap_or_default();
        let last = Inputs {
            setpoint: each(last.setpoint),
            measured: each(last.measured),
            slope: each(last.slope),
        };
        self.last = is_known.then_some(last);
    }

    /// The last output.
    pub fn output(&self) -> T {
        self.output
    }

    /// The integral action, in output units.
    pub fn integral(&self) -> T {
        self.integral
    }

    /// What the derivative gain multiplies, with its sign: a rate, or a difference since the last
    /// sample.
    fn slope(&mut self, setpoint: T, measured: T, rate: T) -> T {
        match self.derivative_weight {
            None => -rate,
            Some(weight) => {
                let followed = weight * setpoint - measured;
                let last = self.previous.replace(followed).unwrap_or(followed);
                followed - last
            }
        }
    }
}

fn derivative_weight(derivative: Derivative) -> Result<Option<f32>, ConfigError> {
    match derivative {
        Derivative::Rate => Ok(None),
        Derivative::Measurement => Ok(Some(0.0)),
        Derivative::Error { weight } => {
            in_range(weight, 0.0, 1.0, "derivative.weight")?;
            Ok(Some(weight))
        }
    }
}

#[cfg(test)]
mod tests;
