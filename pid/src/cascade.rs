//! An angle loop around a rate loop.

use crate::config::{Config, ConfigError, LARGEST, in_range};
use crate::law::{Law, Reading};
use crate::pid::{Coefficients, Pid, PidState};
use crate::scalar::Scalar;

/// Configuration of a [`Cascade`].
#[derive(Clone, Debug, PartialEq)]
pub struct CascadeConfig {
    /// Rate commanded per angle error, 1/s: the bandwidth of the angle loop.
    pub angle_gain: f32,
    /// Greatest rate commanded.
    pub rate_limit: f32,
    /// The rate loop.
    pub rate: Config,
}

/// Outer loop: angle error to a limited rate command. Inner loop: a [`Pid`] on the rate. The limit
/// bounds the speed at which large errors are corrected.
#[derive(Clone, Debug)]
pub struct Cascade<T> {
    angle_gain: T,
    rate_limit: T,
    rate: Pid<T>,
}

impl<T: Scalar> Cascade<T> {
    /// As [`Law::update`], with the angular acceleration for a rate loop that has a derivative.
    pub fn update_with(
        &self,
        state: &mut PidState<T>,
        setpoint: T,
        reading: &Reading<T>,
        acceleration: T,
    ) -> T {
        let error = setpoint - reading.value;
        if !error.is_usable() {
            return state.output();
        }
        let wanted = (self.angle_gain * error).clamped(-self.rate_limit, self.rate_limit);
        let rate = Reading { value: reading.rate, rate: acceleration, ..*reading };
        self.rate.update(state, wanted, &rate, true)
    }
}

/// The state is that of the rate loop.
impl<T: Scalar> Law<T> for Cascade<T> {
    type Config = CascadeConfig;
    type State = PidState<T>;

    fn new(config: &CascadeConfig) -> Result<Self, ConfigError> {
        in_range(config.angle_gain, 0.0, LARGEST, "angle_gain")?;
        in_range(config.rate_limit, 0.0, LARGEST, "rate_limit")?;
        Ok(Self {
            angle_gain: config.angle_gain.into(),
            rate_limit: config.rate_limit.into(),
            rate: Pid::new(&config.rate)?,
        })
    }

    fn at_rest(&self) -> PidState<T> {
        self.rate.at_rest()
    }

    fn update(&self, state: &mut PidState<T>, setpoint: T, reading: &Reading<T>, _: bool) -> T {
        self.update_with(state, setpoint, reading, T::ZERO)
    }

    fn reset(&self, state: &mut PidState<T>, _setpoint: T) {
        self.rate.reset(state, T::ZERO);
    }

    fn retune(
        &mut self,
        state: &mut PidState<T>,
        config: &CascadeConfig,
    ) -> Result<(), ConfigError> {
        let Self { angle_gain, rate_limit, .. } = Self::new(config)?;
        self.rate.retune(state, &config.rate)?;
        (self.angle_gain, self.rate_limit) = (angle_gain, rate_limit);
        Ok(())
    }

    /// Gains of the rate loop.
    fn set_gains(&mut self, gains: &Coefficients<T>) {
        self.rate.set_gains(gains);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AntiWindup, Controller, Gains, Q16};

    fn config() -> CascadeConfig {
        CascadeConfig {
            angle_gain: 4.0,
            rate_limit: 1.5,
            rate: Config {
                gains: Gains { kp: 0.5, ki: 1.0, kd: 0.0 },
                limit: -1.0..=1.0,
                anti_windup: AntiWindup::BackCalculation { time_s: 0.3 },
                ..Config::new(0.01)
            },
        }
    }

    /// From 2 rad, against a steady push of 0.1: greatest speed, and where it ends.
    fn fly<T: Scalar>() -> (f64, f64) {
        let mut cascade = Controller::<T, Cascade<T>>::new(&config()).unwrap();
        let (mut angle, mut rate, mut fastest) = (2.0_f64, 0.0_f64, 0.0_f64);
        for _ in 0..600 {
            let u = cascade.update(T::ZERO, (angle as f32).into(), (rate as f32).into());
            let u: f32 = u.into();
            rate += 31.6 * (f64::from(u) + 0.1) * 0.01;
            angle += rate * 0.01;
            fastest = fastest.max(rate.abs());
        }
        (fastest, angle)
    }

    #[test]
    fn takes_a_large_error_back_at_the_limited_rate_and_ends_without_droop() {
        for (fastest, angle) in [fly::<f32>(), fly::<Q16>()] {
            assert!(fastest < 1.8, "{fastest}");
            assert!(angle.abs() < 0.01, "{angle}");
        }
    }

    /// A restarted law acts like a new law, and a changed law like a law with the new
    /// configuration. A refused configuration changes nothing.
    #[test]
    fn takes_another_configuration_and_begins_anew() {
        let mut cascade = Controller::<f32, Cascade<f32>>::new(&config()).unwrap();
        let first = cascade.update(0.0, 0.4, 0.0);
        for _ in 0..50 {
            cascade.update(0.0, 0.4, 0.1);
        }
        cascade.reset(0.0);
        assert_eq!(cascade.update(0.0, 0.4, 0.0), first);
        let faster = CascadeConfig { angle_gain: 2.0, rate_limit: 3.0, ..config() };
        let bad = CascadeConfig { rate_limit: -1.0, ..faster.clone() };
        cascade.reset(0.0);
        assert!(cascade.retune(&bad).is_err());
        assert_eq!(cascade.clone().update(0.0, 0.4, 0.0), first);
        cascade.retune(&faster).unwrap();
        let mut other = Controller::<f32, Cascade<f32>>::new(&faster).unwrap();
        assert_eq!(cascade.update(0.0, 0.4, 0.0), other.update(0.0, 0.4, 0.0));
    }

    #[test]
    fn refuses_a_negative_limit() {
        let bad = CascadeConfig { rate_limit: -1.0, ..config() };
        assert_eq!(
            Controller::<f32, Cascade<f32>>::new(&bad).err(),
            Some(ConfigError::OutOfRange("rate_limit"))
        );
    }

    #[test]
    fn an_angle_that_is_no_number_leaves_the_output() {
        let mut cascade = Controller::<f32, Cascade<f32>>::new(&config()).unwrap();
        let before = cascade.update(0.0, 0.4, 0.1);
        assert_eq!(cascade.update(0.0, f32::NAN, 0.1), before);
    }
}
