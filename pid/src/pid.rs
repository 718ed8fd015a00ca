//! The PID controller.

use crate::config::{AntiWindup, Config, ConfigError, Derivative, LARGEST, PERIOD_S, in_range};
use crate::law::{Law, Reading};
use crate::scalar::Scalar;
use crate::state::state;

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
        in_range(config.derivative_filter_s, 0.0, 1000.0, "derivative_filter_s")?;
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

    /// The gains at `share` (0 to 1) of the way to `other`.
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
        in_range(config.slew_per_s, f32::MIN_POSITIVE, f32::INFINITY, "slew_per_s")?;
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

state! {
    /// The inputs of a sample, kept for the bumpless change of gains.
    struct Inputs {
        setpoint: T,
        measured: T,
        slope: T,
    }
}

state! {
    /// The memory of a [`Pid`].
    pub struct PidState {
        /// Integral action, in output units: gain included.
        integral: T,
        /// Derivative action after its filter, gain included.
        derivative: T,
        output: T,
        /// The input of the derivative's differences in the last sample. `None` before the first,
        /// which prevents a kick.
        previous: Option<T>,
        last: Option<Inputs<T>>,
    }
}

impl<T: Scalar> PidState<T> {
    /// The last output.
    pub fn output(&self) -> T {
        self.output
    }

    /// The integral action, in output units.
    pub fn integral(&self) -> T {
        self.integral
    }
}

/// A PID controller with output limits, slew limit and anti-windup. The crate's page has the law.
#[derive(Clone, Debug)]
pub struct Pid<T> {
    coefficients: Coefficients<T>,
    limits: Limits<T>,
    /// Setpoint's share in the derivative; `None` for a measured rate.
    derivative_weight: Option<T>,
}

impl<T: Scalar> Law<T> for Pid<T> {
    type Config = Config;
    type State = PidState<T>;

    fn new(config: &Config) -> Result<Self, ConfigError> {
        Ok(Self {
            limits: Limits::new(config)?,
            coefficients: Coefficients::new(config)?,
            derivative_weight: derivative_weight(config.derivative)?.map(T::from),
        })
    }

    fn at_rest(&self) -> PidState<T> {
        PidState {
            output: T::ZERO.clamped(self.limits.low, self.limits.high),
            ..PidState::default()
        }
    }

    /// The rate counts only with [`Derivative::Rate`].
    #[inline]
    fn update(&self, state: &mut PidState<T>, setpoint: T, reading: &Reading<T>, _: bool) -> T {
        let Reading { value: measured, rate, .. } = *reading;
        if !(setpoint.is_usable() && measured.is_usable() && rate.is_usable()) {
            return state.output;
        }
        let k = &self.coefficients;
        let slope = self.slope(state, setpoint, measured, rate);
        state.last = Some(Inputs { setpoint, measured, slope });
        state.derivative = k.decay * state.derivative + k.kd * slope;
        let immediate = k.proportional(setpoint, measured) + state.derivative;

        let growth = k.ki * (setpoint - measured);
        let wanted = immediate + state.integral + growth;
        state.output = self.limits.apply(wanted, state.output);
        let cut = state.output - wanted;
        let integral = if k.tracking > T::ZERO {
            state.integral + growth + k.tracking * cut
        } else if cut == T::ZERO || (cut > T::ZERO) == (growth > T::ZERO) {
            // Not limited, or the error leads back from the limit.
            state.integral + growth
        } else {
            state.integral
        };
        state.integral = integral.clamped(T::from(-LARGEST), T::from(LARGEST));
        state.output
    }

    fn reset(&self, state: &mut PidState<T>, setpoint: T) {
        self.begin(state, T::ZERO, setpoint, setpoint);
    }

    /// The integral absorbs the change of the other gains. Without integral gain, only the slew
    /// limit softens the change. An integral gain of zero leaves the integral as it is.
    fn retune(&mut self, state: &mut PidState<T>, config: &Config) -> Result<(), ConfigError> {
        let before = core::mem::replace(self, Self::new(config)?);
        if self.derivative_weight != before.derivative_weight {
            state.previous = None;
            state.last = None;
            state.derivative = T::ZERO;
        }
        if let Some(last) = state.last
            && self.coefficients.ki != T::ZERO
        {
            let action = |k: &Coefficients<T>| {
                let derivative = k.decay * state.derivative + k.kd * last.slope;
                k.proportional(last.setpoint, last.measured) + derivative
            };
            state.integral =
                state.integral + action(&before.coefficients) - action(&self.coefficients);
        }
        Ok(())
    }

    fn set_gains(&mut self, gains: &Coefficients<T>) {
        self.coefficients = *gains;
    }
}

impl<T: Scalar> Pid<T> {
    /// Start again from a known output, for a handover of control. With integral action, the next
    /// output differs from it by one sample's integral and derivative alone, at any error.
    pub fn begin(&self, state: &mut PidState<T>, output: T, setpoint: T, measured: T) {
        let output = output.clamped(self.limits.low, self.limits.high);
        *state = PidState { output, ..PidState::default() };
        if self.coefficients.ki != T::ZERO && measured.is_usable() && setpoint.is_usable() {
            state.integral = output - self.coefficients.proportional(setpoint, measured);
        }
    }

    /// Factor of the derivative gain, with its sign: a rate, or a difference since the last sample.
    fn slope(&self, state: &mut PidState<T>, setpoint: T, measured: T, rate: T) -> T {
        match self.derivative_weight {
            None => -rate,
            Some(weight) => {
                let followed = weight * setpoint - measured;
                let last = state.previous.replace(followed).unwrap_or(followed);
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
