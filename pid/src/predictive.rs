//! Proportional-derivative control through a slow actuator.

use crate::config::{ConfigError, LARGEST, PERIOD_S, in_range};
use crate::observer::{Observer, ObserverConfig};
use crate::scalar::Scalar;

/// Configuration of a [`PredictivePd`]. "Output" is the unit of its output, "value" that of what it
/// controls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictiveConfig {
    /// Sample period, s.
    pub period_s: f32,
    /// Output per error near the setpoint.
    pub kp: f32,
    /// Output per rate, s.
    pub kd: f32,
    /// Error beyond which the braking curve is flatter.
    pub knee: f32,
    /// Slope of the braking curve beyond the knee, as a share of its slope before, 0 to 1. 1 is a
    /// plain line.
    pub far_slope: f32,
    /// Acceleration of the value per output, 1/s2, positive.
    pub plant_gain: f32,
    /// How far ahead the plant is predicted, s: the loop's delay from measurement to effect. 0 is
    /// no prediction.
    pub horizon_s: f32,
    /// Time from a sample until the actuator begins to follow its output, s, up to one period.
    pub actuator_delay_s: f32,
    /// Lag of the actuator, s: the time constant with which it follows a small step.
    pub actuator_s: f32,
    /// Greatest rate of the actuator, output per s.
    pub actuator_rate: f32,
    /// Bandwidth of the disturbance observer, rad/s; 0 is no trim.
    pub trim_rad_s: f32,
    /// Largest disturbance that is trimmed away, in units of the output.
    pub trim_limit: f32,
    /// Largest output, either side.
    pub limit: f32,
}

/// Proportional-derivative control of a plant `value'' = gain (output + disturbance)` whose
/// actuator is slow and whose loop has a delay, with the three things that these ask for:
///
/// - **Prediction.** A model of the actuator (delay, lag and greatest rate) gives its position, and
///   with it the value and the rate that the output will meet a horizon ahead: that compensates the
///   phase lag of the delay.
/// - **A braking curve.** `-kp bend(error) / kd` is the rate at which the value should approach.
///   The rate from which an actuator of limited speed can still stop grows less than the distance,
///   so that the line bends at a knee: gains may be high near the setpoint without overshoot from
///   afar. (Time-optimal servos use `sqrt`; two lines are as good over a decade and need neither
///   root nor division. M. L. Workman, Adaptive Proximate Time-Optimal Servomechanisms, 1987.)
/// - **Trim.** An [`Observer`] estimates the disturbance, and the output cancels it.
///
/// ```text
/// a' = actuator model                       position of the actuator
/// d  = observer(rate, a)                    disturbance
/// acceleration = gain (a' + d)
/// e' = setpoint - measured - T rate - T^2/2 acceleration
/// r' = rate + T acceleration
/// u  = kp bend(e') - kd r' - d              within +-limit
/// ```
///
/// Use the prediction with the trim: without it, the prediction takes the output that holds against
/// a disturbance for the beginning of a motion, and the error that is left is larger by the factor
/// `1 + gain T kd`.
///
/// With `horizon_s`, `trim_rad_s` 0 and `far_slope` 1 it is [`Pd`](crate::Pd) with a limit.
///
/// The default has no gains: its output is 0 until it is [retuned](Self::retune).
#[derive(Clone, Debug, Default)]
pub struct PredictivePd<T> {
    coefficients: Coefficients<T>,
    observer: Observer<T>,
    /// Position of the actuator by its model, in units of the output.
    actuator: T,
    /// Output of the last sample.
    output: T,
    /// Output of the sample before that.
    earlier_output: T,
}

#[derive(Clone, Copy, Debug, Default)]
struct Coefficients<T> {
    kp: T,
    kd: T,
    knee: T,
    far_slope: T,
    plant_gain: T,
    horizon: T,
    half_horizon: T,
    /// Share of the way to its input that the actuator goes in a sample: `T / (T + lag)`.
    lag_gain: T,
    /// The most that the actuator moves in a sample.
    max_step: T,
    /// Share of a sample for which the actuator still follows the earlier output.
    delay: T,
    limit: T,
}

impl<T: Scalar> PredictivePd<T> {
    /// A controller whose actuator rests at 0.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    pub fn new(config: &PredictiveConfig) -> Result<Self, ConfigError> {
        Ok(Self {
            coefficients: Coefficients::new(config)?,
            observer: Observer::new(&observer(config))?,
            actuator: T::ZERO,
            output: T::ZERO,
            earlier_output: T::ZERO,
        })
    }

    /// Take other parameters without a bump: actuator and disturbance keep their values.
    ///
    /// # Errors
    /// A parameter out of its range, by name; nothing changes.
    pub fn retune(&mut self, config: &PredictiveConfig) -> Result<(), ConfigError> {
        let coefficients = Coefficients::new(config)?;
        self.observer.retune(&observer(config))?;
        self.coefficients = coefficients;
        Ok(())
    }

    /// One sample: setpoint, measured value and its measured rate. Inputs that are not numbers
    /// change nothing.
    pub fn update(&mut self, setpoint: T, measured: T, rate: T) -> T {
        let error = setpoint - measured;
        if !(error.is_usable() && rate.is_usable()) {
            return self.output;
        }
        let c = &self.coefficients;
        let disturbance = self.observer.update(rate, self.actuator);
        let delayed_output = self.output + c.delay * (self.earlier_output - self.output);
        let step = c.lag_gain * (delayed_output - self.actuator);
        self.actuator = self.actuator + step.clamped(-c.max_step, c.max_step);

        let change = c.horizon * c.plant_gain * (self.actuator + disturbance);
        let error = error - c.horizon * rate - c.half_horizon * change;
        let output = c.kp * c.bend(error) - c.kd * (rate + change) - disturbance;
        self.earlier_output = self.output;
        self.output = output.clamped(-c.limit, c.limit);
        self.output
    }

    /// All that the next outputs depend on besides inputs and configuration, number by number: each
    /// is shown to `each` and becomes what that returns.
    #[inline(never)]
    pub fn memory(&mut self, each: &mut impl FnMut(T) -> T) {
        self.actuator = each(self.actuator);
        self.output = each(self.output);
        self.earlier_output = each(self.earlier_output);
        self.observer.memory(each);
    }

    /// Forget everything, as when the plant is held: the actuator goes to 0.
    pub fn reset(&mut self) {
        self.actuator = T::ZERO;
        self.output = T::ZERO;
        self.earlier_output = T::ZERO;
        self.observer.reset();
    }

    /// The disturbance that the trim cancels, in units of the output.
    pub fn disturbance(&self) -> T {
        self.observer.disturbance()
    }
}

impl<T: Scalar> Coefficients<T> {
    fn new(config: &PredictiveConfig) -> Result<Self, ConfigError> {
        let period = config.period_s;
        in_range(period, *PERIOD_S.start(), *PERIOD_S.end(), "period_s")?;
        // A table, because a call for each would take ten times the flash.
        for (value, most, name) in [
            (config.kp, LARGEST, "kp"),
            (config.kd, LARGEST, "kd"),
            (config.knee, LARGEST, "knee"),
            (config.far_slope, 1.0, "far_slope"),
            (config.plant_gain, LARGEST, "plant_gain"),
            (config.horizon_s, 1.0, "horizon_s"),
            (config.actuator_delay_s, period, "actuator_delay_s"),
            (config.actuator_s, 1000.0, "actuator_s"),
            (config.actuator_rate, LARGEST, "actuator_rate"),
            (config.trim_rad_s * period, 1000.0, "trim_rad_s"),
            (config.trim_limit, LARGEST, "trim_limit"),
            (config.limit, LARGEST, "limit"),
        ] {
            in_range(value, 0.0, most, name)?;
        }
        Ok(Self {
            kp: config.kp.into(),
            kd: config.kd.into(),
            knee: config.knee.into(),
            far_slope: config.far_slope.into(),
            plant_gain: config.plant_gain.into(),
            horizon: config.horizon_s.into(),
            half_horizon: (0.5 * config.horizon_s).into(),
            lag_gain: (period / (period + config.actuator_s)).into(),
            max_step: (period * config.actuator_rate).into(),
            delay: (config.actuator_delay_s / period).into(),
            limit: config.limit.into(),
        })
    }

    /// The braking curve over the error, in units of the error near the setpoint.
    fn bend(&self, error: T) -> T {
        let near = error.clamped(-self.knee, self.knee);
        near + self.far_slope * (error - near)
    }
}

fn observer(config: &PredictiveConfig) -> ObserverConfig {
    ObserverConfig {
        period_s: config.period_s,
        plant_gain: config.plant_gain,
        bandwidth_rad_s: config.trim_rad_s,
        // Its command is the position of the actuator, which has the lag already.
        actuator_s: 0.0,
        limit: config.trim_limit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pd, Q16};
    use proptest::prelude::*;

    /// Pitch of the drone through its servo: gain 31.6, 5.5 rad/s, 50 ms.
    fn config() -> PredictiveConfig {
        PredictiveConfig {
            period_s: 0.01,
            kp: 2.4,
            kd: 0.45,
            knee: 0.25,
            far_slope: 0.5,
            plant_gain: 31.6,
            horizon_s: 0.018,
            actuator_delay_s: 0.0,
            actuator_s: 0.05,
            actuator_rate: 5.5,
            trim_rad_s: 5.0,
            trim_limit: 0.2,
            limit: 1.0,
        }
    }

    fn plain() -> PredictiveConfig {
        PredictiveConfig {
            far_slope: 1.0,
            horizon_s: 0.0,
            trim_rad_s: 0.0,
            limit: 100.0,
            ..config()
        }
    }

    /// Flies `value'' = 31.6 (actuator + push)` from `start`: the values, sample by sample. The
    /// actuator is limited in rate, and each output reaches it a sample late.
    fn fly<T: Scalar>(config: &PredictiveConfig, start: f64, push: f64) -> std::vec::Vec<f64> {
        let mut controller = PredictivePd::<T>::new(config).unwrap();
        let (mut value, mut rate, mut actuator, mut late) = (start, 0.0_f64, 0.0_f64, 0.0_f64);
        (0..300)
            .map(|_| {
                let output =
                    controller.update(T::ZERO, (value as f32).into(), (rate as f32).into());
                for _ in 0..10 {
                    actuator += (1e-3 / 0.03 * (late - actuator)).clamp(-5.5e-3, 5.5e-3);
                    rate += 31.6 * (actuator + push) * 1e-3;
                    value += rate * 1e-3;
                }
                let output: f32 = output.into();
                late = f64::from(output);
                value
            })
            .collect()
    }

    #[test]
    fn is_proportional_derivative_control_without_its_extras() {
        let pd = Pd { kp: 2.4, kd: 0.45 };
        let mut controller = PredictivePd::<f32>::new(&plain()).unwrap();
        for (setpoint, measured, rate) in [(0.0, 0.3, -1.0), (0.2, -0.1, 0.5), (0.0, 0.0, 0.0)] {
            let expected = pd.update(setpoint, measured, rate);
            assert!((controller.update(setpoint, measured, rate) - expected).abs() < 1e-6);
        }
    }

    /// By hand: 0.1 s ahead of rate -1 under an actuator at 0.5 that stays there.
    #[test]
    fn predicts_value_and_rate_with_the_actuator_where_it_is() {
        let config = PredictiveConfig {
            kp: 1.0,
            kd: 1.0,
            knee: 10.0,
            plant_gain: 10.0,
            horizon_s: 0.1,
            actuator_s: 0.0,
            actuator_rate: 0.0,
            ..plain()
        };
        let mut controller = PredictivePd::<f32>::new(&config).unwrap();
        controller.actuator = 0.5;
        // Acceleration 5: rate -0.5, error -(2 - 0.1 + 0.025).
        let output = controller.update(0.0, 2.0, -1.0);
        assert!((output - (-1.925 + 0.5)).abs() < 1e-6, "{output}");
    }

    #[test]
    fn the_braking_curve_bends_at_the_knee_on_both_sides() {
        let config = PredictiveConfig {
            kp: 2.0,
            knee: 0.1,
            far_slope: 0.25,
            ..plain()
        };
        for (error, expected) in [(0.05, 0.1), (0.1, 0.2), (0.5, 0.4), (-0.5, -0.4)] {
            let mut controller = PredictivePd::<f32>::new(&config).unwrap();
            assert!((controller.update(error, 0.0, 0.0) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn the_actuators_model_lags_and_keeps_its_rate() {
        let mut controller = PredictivePd::<f32>::new(&config()).unwrap();
        controller.update(1.0, 0.0, 0.0);
        controller.update(1.0, 0.0, 0.0);
        assert!((controller.actuator - 0.055).abs() < 1e-6);
        controller.actuator = controller.output - 0.06;
        let before = controller.actuator;
        controller.update(1.0, 0.0, 0.0);
        assert!((controller.actuator - before - 0.01).abs() < 1e-6);
    }

    /// From 0.2 and 0.8 without overshoot worth the name, faster than any proportional-derivative
    /// gains do it.
    #[test]
    fn arrives_soon_and_without_overshoot_from_near_and_far() {
        for start in [0.2, 0.8, -0.8] {
            let path: std::vec::Vec<f64> = fly::<f32>(&config(), start, 0.0)
                .iter()
                .map(|value| value / start)
                .collect();
            let settled = path.iter().rposition(|value| value.abs() > 0.05).unwrap();
            let overshoot = path.iter().fold(0.0_f64, |low, value| low.max(-value));
            assert!(
                settled < 60 && overshoot < 0.03,
                "{start}: {settled} {overshoot}"
            );
        }
    }

    #[test]
    fn trims_a_steady_push_away() {
        let droop = |trim_rad_s| {
            let config = PredictiveConfig {
                trim_rad_s,
                ..config()
            };
            fly::<f32>(&config, 0.2, 0.08)[299].abs()
        };
        // Without the observer, the prediction takes the actuator's position for the beginning of a
        // motion: a (1 + gain T kd + gain T^2/2 kp) = kp error.
        let stiff = 2.4 / (1.0 + 31.6 * (0.018 * 0.45 + 0.5 * 0.018 * 0.018 * 2.4));
        assert!((droop(0.0) - 0.08 / stiff).abs() < 2e-3);
        assert!(droop(5.0) < 1e-3);
    }

    #[test]
    fn fixed_point_flies_as_float_does() {
        let (float, fixed) = (
            fly::<f32>(&config(), 0.4, 0.03),
            fly::<Q16>(&config(), 0.4, 0.03),
        );
        for (a, b) in float.iter().zip(fixed) {
            assert!((a - b).abs() < 2e-3, "{a} {b}");
        }
    }

    #[test]
    fn other_gains_come_without_a_bump() {
        let mut controller = PredictivePd::<f32>::new(&config()).unwrap();
        for _ in 0..50 {
            controller.update(0.0, 0.01, 0.02);
        }
        let (actuator, trimmed) = (controller.actuator, controller.disturbance());
        let other = PredictiveConfig {
            trim_rad_s: 4.0,
            kd: 0.4,
            ..config()
        };
        controller.retune(&other).unwrap();
        assert_eq!(controller.actuator, actuator);
        assert_eq!(controller.disturbance(), trimmed);
        let refused = controller.retune(&PredictiveConfig {
            kp: -1.0,
            ..config()
        });
        assert_eq!(refused, Err(ConfigError::OutOfRange("kp")));
        controller.reset();
        assert_eq!((controller.actuator, controller.disturbance()), (0.0, 0.0));
    }

    #[test]
    fn a_configuration_that_cannot_work_is_refused_by_name() {
        let refused = |config| PredictivePd::<f32>::new(&config).err();
        for (config, name) in [
            (
                PredictiveConfig {
                    far_slope: 1.5,
                    ..config()
                },
                "far_slope",
            ),
            (
                PredictiveConfig {
                    plant_gain: 0.0,
                    ..config()
                },
                "plant_gain",
            ),
            (
                PredictiveConfig {
                    trim_rad_s: -1.0,
                    ..config()
                },
                "trim_rad_s",
            ),
            (
                PredictiveConfig {
                    trim_limit: f32::NAN,
                    ..config()
                },
                "trim_limit",
            ),
            (
                PredictiveConfig {
                    horizon_s: f32::NAN,
                    ..config()
                },
                "horizon_s",
            ),
        ] {
            assert_eq!(refused(config), Some(ConfigError::OutOfRange(name)));
        }
    }

    proptest! {
        #[test]
        fn the_output_is_a_number_within_its_limit_whatever_comes_in(
            samples in proptest::collection::vec((proptest::num::f32::ANY, proptest::num::f32::ANY), 1..20)
        ) {
            let mut controller = PredictivePd::<f32>::new(&config()).unwrap();
            for (measured, rate) in samples {
                let output = controller.update(0.0, measured, rate);
                prop_assert!(output.abs() <= 1.0, "{output}");
            }
        }
    }
}
