//! A path to the setpoint that a plant can follow.

use crate::config::{ConfigError, LARGEST, PERIOD_S, double_pole, in_range};
use crate::scalar::Scalar;

/// Where the setpoint's path is now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaped<T> {
    /// Value to follow.
    pub value: T,
    /// Its rate, per second: what to add to a rate command, or to weigh in as feed-forward.
    pub rate: T,
}

/// The second half of two-degree-of-freedom control: steps of the setpoint become the critically
/// damped path `w^2 / (s + w)^2` with limited rate, so that the feedback can be tuned for
/// disturbances alone.
#[derive(Clone, Debug)]
pub struct Reference<T> {
    period: T,
    /// Gain from the distance to the change of the rate in a sample.
    pull: T,
    /// Gain from the rate to its decrease in a sample.
    brake: T,
    rate_limit: T,
    state: Shaped<T>,
}

impl<T: Scalar> Reference<T> {
    /// With bandwidth `w` and greatest rate, starting at rest in `value`.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    pub fn new(
        period_s: f32,
        bandwidth_rad_s: f32,
        rate_limit_per_s: f32,
        value: T,
    ) -> Result<Self, ConfigError> {
        in_range(period_s, *PERIOD_S.start(), *PERIOD_S.end(), "period_s")?;
        in_range(bandwidth_rad_s * period_s, 1e-3, 1000.0, "bandwidth_rad_s")?;
        in_range(
            rate_limit_per_s,
            f32::MIN_POSITIVE,
            LARGEST,
            "rate_limit_per_s",
        )?;
        let (brake, pull) = double_pole(bandwidth_rad_s, period_s);
        Ok(Self {
            period: period_s.into(),
            pull: (pull / period_s).into(),
            brake: brake.into(),
            rate_limit: rate_limit_per_s.into(),
            state: Shaped {
                value,
                rate: T::ZERO,
            },
        })
    }

    /// One sample on the way to `setpoint`.
    pub fn update(&mut self, setpoint: T) -> Shaped<T> {
        if setpoint.is_usable() {
            let Shaped { value, rate } = self.state;
            let rate = rate + self.pull * (setpoint - value) - self.brake * rate;
            let rate = rate.clamped(-self.rate_limit, self.rate_limit);
            self.state = Shaped {
                value: value + rate * self.period,
                rate,
            };
        }
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Q16;

    /// Steps 0 to 1 at 5 rad/s and 1 kHz: the path after each sample.
    fn path<T: Scalar>(rate_limit: f32, samples: usize) -> std::vec::Vec<Shaped<f32>> {
        let mut reference = Reference::<T>::new(1e-3, 5.0, rate_limit, T::ZERO).unwrap();
        (0..samples)
            .map(|_| {
                let Shaped { value, rate } = reference.update(T::ONE);
                Shaped {
                    value: value.into(),
                    rate: rate.into(),
                }
            })
            .collect()
    }

    #[test]
    fn is_the_critically_damped_path() {
        for (index, shaped) in path::<f32>(100.0, 2000).into_iter().enumerate() {
            let t = (index + 1) as f32 * 5e-3;
            let exact = 1.0 - (1.0 + t) * (-t).exp();
            assert!(
                (shaped.value - exact).abs() < 5e-3,
                "{index}: {shaped:?} {exact}"
            );
            assert!(shaped.value <= 1.0 + 1e-6);
        }
    }

    #[test]
    fn keeps_its_rate_limit_and_still_arrives() {
        let path = path::<f32>(0.5, 5000);
        assert!(
            path.iter()
                .all(|shaped| shaped.rate <= 0.5 && shaped.value < 1.01)
        );
        assert!((path[4999].value - 1.0).abs() < 1e-3);
    }

    #[test]
    fn fixed_point_follows_the_float() {
        for (fixed, float) in path::<Q16>(100.0, 2000)
            .iter()
            .zip(path::<f32>(100.0, 2000))
        {
            assert!((fixed.value - float.value).abs() < 0.02);
        }
    }

    #[test]
    fn refuses_what_cannot_work_and_ignores_what_is_no_number() {
        assert!(Reference::<f32>::new(0.0, 5.0, 1.0, 0.0).is_err());
        assert!(Reference::<f32>::new(0.01, 0.0, 1.0, 0.0).is_err());
        assert!(Reference::<f32>::new(0.01, 5.0, f32::NAN, 0.0).is_err());
        let mut reference = Reference::<f32>::new(0.01, 5.0, 1.0, 0.25).unwrap();
        assert_eq!(reference.update(f32::NAN).value, 0.25);
    }
}
