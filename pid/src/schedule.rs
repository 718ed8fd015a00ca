//! Gains that follow the plant.

use crate::config::{Config, ConfigError, LARGEST, in_range};
use crate::pid::Coefficients;
use crate::scalar::Scalar;

#[derive(Clone, Copy, Debug)]
struct Point<T> {
    at: T,
    /// One over the distance to the next point.
    inverse_span: T,
    coefficients: Coefficients<T>,
}

/// Gains at `N` values of a variable (time, thrust, inertia), linear in between, constant beyond
/// the ends.
#[derive(Clone, Debug)]
pub struct Schedule<T, const N: usize> {
    points: [Point<T>; N],
}

impl<T: Scalar, const N: usize> Schedule<T, N> {
    /// From values of the variable in rising order, each with its configuration. Only what
    /// [`Coefficients`] hold is scheduled: gains, derivative filter, setpoint weight, tracking
    /// time.
    ///
    /// # Errors
    /// A parameter out of its range by name; `schedule` where the values do not rise by at least
    /// 1/1000, or there are none.
    pub fn new(table: &[(f32, Config); N]) -> Result<Self, ConfigError> {
        let (first_at, first) = table.first().ok_or(ConfigError::OutOfRange("schedule"))?;
        let mut points = [Point {
            at: T::from(*first_at),
            inverse_span: T::ZERO,
            coefficients: Coefficients::new(first)?,
        }; N];
        for (index, ((at, config), point)) in table.iter().zip(&mut points).enumerate() {
            in_range(*at, -LARGEST, LARGEST, "schedule")?;
            point.at = (*at).into();
            point.coefficients = Coefficients::new(config)?;
            if let Some((next, _)) = table.get(index + 1) {
                in_range(next - at, 1e-3, LARGEST, "schedule")?;
                point.inverse_span = (1.0 / (next - at)).into();
            }
        }
        Ok(Self { points })
    }

    /// The coefficients at a value of the variable. What is not a number counts as the first point.
    pub fn at(&self, variable: T) -> Option<Coefficients<T>> {
        let mut points = self.points.iter().rev();
        let mut next = points.next()?;
        if variable >= next.at {
            return Some(next.coefficients);
        }
        for point in points {
            if variable >= point.at {
                let share = (variable - point.at) * point.inverse_span;
                return Some(point.coefficients.towards(&next.coefficients, share));
            }
            next = point;
        }
        Some(next.coefficients)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Gains, Pid, Q16};

    fn config(kp: f32, ki: f32) -> Config {
        Config {
            gains: Gains { kp, ki, kd: 0.0 },
            limit: -100.0..=100.0,
            ..Config::new(0.01)
        }
    }

    fn table() -> [(f32, Config); 3] {
        [
            (0.0, config(1.0, 0.0)),
            (20.0, config(3.0, 2.0)),
            (90.0, config(2.0, 2.0)),
        ]
    }

    fn kp<T: Scalar>(schedule: &Schedule<T, 3>, at: f32) -> f32 {
        schedule.at(at.into()).unwrap().kp.into()
    }

    fn follows_the_table<T: Scalar>(tolerance: f32) {
        let schedule = Schedule::<T, 3>::new(&table()).unwrap();
        for (at, expected) in [
            (-5.0, 1.0),
            (0.0, 1.0),
            (10.0, 2.0),
            (20.0, 3.0),
            (55.0, 2.5),
            (90.0, 2.0),
            (200.0, 2.0),
        ] {
            assert!((kp(&schedule, at) - expected).abs() <= tolerance, "{at}");
        }
    }

    #[test]
    fn is_exact_at_the_points_linear_between_and_constant_beyond() {
        follows_the_table::<f32>(1e-6);
        follows_the_table::<Q16>(2e-3);
        let schedule = Schedule::<f32, 3>::new(&table()).unwrap();
        assert_eq!(kp(&schedule, f32::NAN), 1.0);
        assert_eq!(schedule.at(10.0).unwrap().ki, 0.01);
    }

    #[test]
    fn drives_a_controller() {
        let schedule = Schedule::<f32, 3>::new(&table()).unwrap();
        let mut pid = Pid::new(&config(1.0, 0.0)).unwrap();
        pid.set_coefficients(schedule.at(10.0).unwrap());
        assert!((pid.update(1.0, 0.0, 0.0) - 2.01).abs() < 1e-6);
    }

    #[test]
    fn refuses_values_that_do_not_rise_and_an_empty_table() {
        let mut unordered = table();
        unordered[1].0 = 95.0;
        let refused = Some(ConfigError::OutOfRange("schedule"));
        assert_eq!(Schedule::<f32, 3>::new(&unordered).err(), refused);
        assert_eq!(Schedule::<f32, 0>::new(&[]).err(), refused);
    }
}
