//! Gains that follow the plant.

use crate::config::{Config, ConfigError, LARGEST, in_range};
use crate::pid::Coefficients;
use crate::scalar::Scalar;

#[derive(Clone, Copy, Debug, Default)]
struct Point<T> {
    at: T,
    /// One over the distance to the next point.
    inverse_span: T,
    coefficients: Coefficients<T>,
}

/// Gains at up to `N` values of a variable (time, thrust, inertia), linear in between, constant
/// beyond the ends. The default has none.
#[derive(Clone, Debug)]
pub struct Schedule<T, const N: usize> {
    points: [Point<T>; N],
    /// Number of rows.
    len: usize,
}

impl<T: Scalar, const N: usize> Default for Schedule<T, N> {
    fn default() -> Self {
        Self { points: [Point::default(); N], len: 0 }
    }
}

impl<T: Scalar, const N: usize> Schedule<T, N> {
    /// From values of the variable in rising order, each with its configuration. Only the
    /// [`Coefficients`] are scheduled: gains, derivative filter, setpoint weight, tracking time.
    ///
    /// # Errors
    /// As [`Schedule::set`].
    pub fn new<R>(rows: R) -> Result<Self, ConfigError>
    where
        R: IntoIterator<Item = (f32, Config), IntoIter: Clone>,
    {
        let mut schedule = Self::default();
        schedule.set(rows)?;
        Ok(schedule)
    }

    /// Take other rows.
    ///
    /// # Errors
    /// The name of a parameter out of range; `schedule` if the values do not rise by at least
    /// 1/1000, or if there are more than `N`. The old rows stay.
    pub fn set<R>(&mut self, rows: R) -> Result<(), ConfigError>
    where
        R: IntoIterator<Item = (f32, Config), IntoIter: Clone>,
    {
        let rows = rows.into_iter();
        let mut least = -LARGEST;
        let mut len = 0;
        for (at, config) in rows.clone() {
            in_range(at, least, LARGEST, "schedule")?;
            Coefficients::<T>::new(&config)?;
            least = at + 1e-3;
            len += 1;
        }
        if len > N {
            return Err(ConfigError::OutOfRange("schedule"));
        }
        self.len = len;
        let mut last: Option<(f32, &mut Point<T>)> = None;
        for (point, (at, config)) in self.points.iter_mut().zip(rows) {
            if let Some((before, last)) = last {
                last.inverse_span = (1.0 / (at - before)).into();
            }
            point.at = at.into();
            point.coefficients = Coefficients::new(&config)?;
            last = Some((at, point));
        }
        Ok(())
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The coefficients at a value of the variable; none without rows. A NaN gives the first row.
    pub fn at(&self, variable: T) -> Option<Coefficients<T>> {
        let mut points = self.points.iter().take(self.len).rev();
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
    use crate::{Controller, Gains, Law, Pid, Q16};

    fn config(kp: f32, ki: f32) -> Config {
        Config { gains: Gains { kp, ki, kd: 0.0 }, limit: -100.0..=100.0, ..Config::new(0.01) }
    }

    fn table() -> [(f32, Config); 3] {
        [(0.0, config(1.0, 0.0)), (20.0, config(3.0, 2.0)), (90.0, config(2.0, 2.0))]
    }

    fn kp<T: Scalar>(schedule: &Schedule<T, 3>, at: f32) -> f32 {
        schedule.at(at.into()).unwrap().kp.into()
    }

    fn follows_the_table<T: Scalar>(tolerance: f32) {
        let schedule = Schedule::<T, 3>::new(table()).unwrap();
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
        let schedule = Schedule::<f32, 3>::new(table()).unwrap();
        assert_eq!(kp(&schedule, f32::NAN), 1.0);
        assert_eq!(schedule.at(10.0).unwrap().ki, 0.01);
    }

    /// Unused places do not count.
    #[test]
    fn fewer_rows_than_places_are_constant_beyond_their_last() {
        let schedule = Schedule::<f32, 6>::new(table().into_iter().take(2)).unwrap();
        for (at, expected) in [(-1.0, 1.0), (10.0, 2.0), (20.0, 3.0), (500.0, 3.0)] {
            assert_eq!(schedule.at(at).unwrap().kp, expected, "{at}");
        }
        assert!(Schedule::<f32, 6>::default().is_empty());
        assert_eq!(Schedule::<f32, 6>::default().at(1.0), None);
    }

    #[test]
    fn drives_a_controller() {
        let schedule = Schedule::<f32, 3>::new(table()).unwrap();
        let mut pid = Controller::<f32, Pid<f32>>::new(&config(1.0, 0.0)).unwrap();
        pid.law.set_gains(&schedule.at(10.0).unwrap());
        assert!((pid.update(1.0, 0.0, 0.0) - 2.01).abs() < 1e-6);
    }

    #[test]
    fn refuses_values_that_do_not_rise_and_too_many_and_keeps_the_old_ones() {
        let mut unordered = table();
        unordered[1].0 = 95.0;
        let refused = Some(ConfigError::OutOfRange("schedule"));
        assert_eq!(Schedule::<f32, 3>::new(unordered.clone()).err(), refused);
        assert_eq!(Schedule::<f32, 2>::new(table()).err(), refused);
        let mut schedule = Schedule::<f32, 3>::new(table()).unwrap();
        assert_eq!(schedule.set(unordered).err(), refused);
        assert_eq!(kp(&schedule, 10.0), 2.0);
    }
}
