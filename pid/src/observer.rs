//! The disturbance observer.

use crate::config::{ConfigError, LARGEST, PERIOD_S, double_pole, in_range};
use crate::scalar::Scalar;

/// Configuration of an [`Observer`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverConfig {
    /// Sample period, s.
    pub period_s: f32,
    /// Acceleration per unit of command, with its sign.
    pub plant_gain: f32,
    /// How fast the estimate follows, rad/s: both poles of the observer. Keep it below the
    /// actuator's bandwidth; with 0 the disturbance stays 0.
    pub bandwidth_rad_s: f32,
    /// Lag of the actuator, s, between command and effect.
    pub actuator_s: f32,
    /// Largest disturbance that is estimated, in units of the command.
    pub limit: f32,
}

/// Estimates a constant or slow disturbance `d` of a plant `rate' = gain (u + d)` from its measured
/// rate and its commands `u`. Add `-d` to the command, and an off-centre mass or a bent rudder is
/// trimmed away faster than any integral could without overshoot: the observer sees an
/// acceleration, not an error that has already grown.
///
/// ```text
/// u = u + T / (T + actuator) (command - u)  the command as it arrives
/// r = r + T gain (u + d)                    the rate expected
/// e = rate - r
/// r = r + (1 - z^2) e
/// d = d + (1 - z)^2 / (T gain) e            both poles of the error at z = 1 / (1 + w T)
/// ```
///
/// The default estimates nothing until it is [retuned](Self::retune).
#[derive(Clone, Debug, Default)]
pub struct Observer<T> {
    /// Change of the rate in a sample per unit of command: `T gain`.
    rate_step: T,
    /// Gain from the error of the rate to the rate.
    rate_gain: T,
    /// Gain from the error of the rate to the disturbance.
    disturbance_gain: T,
    /// Share of the way to the command that the actuator goes in a sample: `T / (T + lag)`.
    lag_gain: T,
    limit: T,
    /// The command as it arrives at the plant.
    arrived: T,
    /// The estimated rate; nothing before the first sample.
    rate: Option<T>,
    disturbance: T,
}

impl<T: Scalar> Observer<T> {
    /// An observer whose disturbance is 0.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    pub fn new(config: &ObserverConfig) -> Result<Self, ConfigError> {
        let period = config.period_s;
        in_range(period, *PERIOD_S.start(), *PERIOD_S.end(), "period_s")?;
        in_range(
            (period * config.plant_gain).abs(),
            1e-3,
            LARGEST,
            "plant_gain",
        )?;
        in_range(
            config.bandwidth_rad_s * period,
            0.0,
            1000.0,
            "bandwidth_rad_s",
        )?;
        in_range(config.actuator_s, 0.0, 1000.0, "actuator_s")?;
        in_range(config.limit, 0.0, LARGEST, "limit")?;
        let (rate_gain, disturbance_gain) = double_pole(config.bandwidth_rad_s, period);
        Ok(Self {
            rate_step: (period * config.plant_gain).into(),
            rate_gain: rate_gain.into(),
            disturbance_gain: (disturbance_gain / (period * config.plant_gain)).into(),
            lag_gain: (period / (period + config.actuator_s)).into(),
            limit: config.limit.into(),
            arrived: T::ZERO,
            rate: None,
            disturbance: T::ZERO,
        })
    }

    /// One sample: the rate measured now and the command given after the sample before. Returns the
    /// disturbance in units of the command.
    pub fn update(&mut self, rate: T, command: T) -> T {
        if !(rate.is_usable() && command.is_usable()) {
            return self.disturbance;
        }
        self.arrived = self.arrived + self.lag_gain * (command - self.arrived);
        let expected = match self.rate {
            Some(before) => before + self.rate_step * (self.arrived + self.disturbance),
            None => rate,
        };
        let error = rate - expected;
        self.rate = Some(expected + self.rate_gain * error);
        let disturbance = self.disturbance + self.disturbance_gain * error;
        self.disturbance = disturbance.clamped(-self.limit, self.limit);
        self.disturbance
    }

    /// Take other parameters; the estimates stay.
    ///
    /// # Errors
    /// A parameter out of its range, by name; nothing changes.
    pub fn retune(&mut self, config: &ObserverConfig) -> Result<(), ConfigError> {
        let Self {
            arrived,
            rate,
            disturbance,
            ..
        } = *self;
        let fresh = Self::new(config)?;
        *self = Self {
            arrived,
            rate,
            disturbance: disturbance.clamped(-fresh.limit, fresh.limit),
            ..fresh
        };
        Ok(())
    }

    /// See [`PredictivePd::memory`](crate::PredictivePd::memory).
    pub(crate) fn memory(&mut self, each: &mut impl FnMut(T) -> T) {
        self.arrived = each(self.arrived);
        let known = each(if self.rate.is_some() { T::ONE } else { T::ZERO }) != T::ZERO;
        let rate = each(self.rate.unwrap_or_default());
        self.rate = known.then_some(rate);
        self.disturbance = each(self.disturbance);
    }

    /// Forget everything, as when the drone is held again.
    pub fn reset(&mut self) {
        self.arrived = T::ZERO;
        self.rate = None;
        self.disturbance = T::ZERO;
    }

    /// The disturbance, in units of the command.
    pub fn disturbance(&self) -> T {
        self.disturbance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pd, Q16};

    const PERIOD: f64 = 0.01;

    fn config() -> ObserverConfig {
        ObserverConfig {
            period_s: PERIOD as f32,
            plant_gain: -31.6,
            bandwidth_rad_s: 5.0,
            actuator_s: 0.0,
            limit: 0.5,
        }
    }

    /// `rate' = -31.6 (u + 0.1)` from rest under no command: how much of the disturbance is seen
    /// after each sample.
    fn seen<T: Scalar>(samples: usize) -> f64 {
        let mut observer = Observer::<T>::new(&config()).unwrap();
        let mut rate = 0.0_f64;
        for _ in 0..samples {
            observer.update((rate as f32).into(), T::ZERO);
            rate += -31.6 * 0.1 * PERIOD;
        }
        let disturbance: f32 = observer.disturbance().into();
        f64::from(disturbance)
    }

    #[test]
    fn finds_a_constant_disturbance_at_its_bandwidth() {
        // A double pole at 5 rad/s: 1 - (1 + wt) exp(-wt) is 59 % after 0.4 s and 96 % after 1 s.
        for (samples, share) in [(40, 0.594), (100, 0.96), (300, 1.0)] {
            assert!(
                (seen::<f32>(samples) - 0.1 * share).abs() < 0.004,
                "{samples}"
            );
            assert!(
                (seen::<Q16>(samples) - 0.1 * share).abs() < 0.005,
                "{samples}"
            );
        }
    }

    #[test]
    fn commands_are_not_taken_for_disturbances_even_through_a_lag() {
        for lag in [0.0, 0.05] {
            let mut observer = Observer::<f32>::new(&ObserverConfig {
                actuator_s: lag,
                ..config()
            })
            .unwrap();
            let (mut rate, mut arrived) = (0.0_f64, 0.0_f64);
            for sample in 0..300_u32 {
                let command = if sample / 25 % 2 == 0 { 0.4 } else { -0.4 };
                arrived += PERIOD / (PERIOD + f64::from(lag)) * (command - arrived);
                let before = rate;
                rate += -31.6 * arrived * PERIOD;
                if sample == 0 {
                    observer.update(before as f32, 0.0);
                }
                observer.update(rate as f32, command as f32);
                assert!(observer.disturbance().abs() < 1e-3, "{sample}");
            }
        }
    }

    #[test]
    fn never_believes_more_than_its_limit_and_forgets_on_reset() {
        let mut observer = Observer::<f32>::new(&config()).unwrap();
        for sample in 0..1000 {
            observer.update(sample as f32, 0.0);
        }
        assert_eq!(observer.disturbance(), -0.5);
        assert_eq!(observer.update(f32::NAN, 0.0), -0.5);
        observer.reset();
        assert_eq!(observer.disturbance(), 0.0);
    }

    #[test]
    fn takes_the_droop_off_a_proportional_derivative_loop() {
        let settle = |trimmed: bool| {
            let pd = Pd {
                kp: -1.6,
                kd: -0.35,
            };
            let mut observer = Observer::<f32>::new(&config()).unwrap();
            let (mut angle, mut rate, mut command) = (0.2_f64, 0.0_f64, 0.0_f32);
            for _ in 0..500 {
                let disturbance = observer.update(rate as f32, command);
                let trim = if trimmed { disturbance } else { 0.0 };
                command = pd.update(0.0, angle as f32, rate as f32) - trim;
                rate += -31.6 * (f64::from(command) + 0.08) * PERIOD;
                angle += rate * PERIOD;
            }
            angle
        };
        assert!((settle(false) + 0.05).abs() < 1e-3, "droop is d / kp");
        assert!(settle(true).abs() < 1e-4);
    }

    #[test]
    fn a_configuration_that_cannot_work_is_refused_by_name() {
        let refused = |config: ObserverConfig| Observer::<f32>::new(&config).err();
        let name = |name| Some(ConfigError::OutOfRange(name));
        assert_eq!(
            refused(ObserverConfig {
                plant_gain: 0.0,
                ..config()
            }),
            name("plant_gain")
        );
        assert_eq!(
            refused(ObserverConfig {
                period_s: 0.0,
                ..config()
            }),
            name("period_s")
        );
        assert_eq!(
            refused(ObserverConfig {
                limit: f32::NAN,
                ..config()
            }),
            name("limit")
        );
    }
}
