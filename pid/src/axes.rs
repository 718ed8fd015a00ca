//! The same controller on several axes that do not disturb one another.

use crate::config::{Config, ConfigError};
use crate::pid::Pid;
use crate::scalar::Scalar;

/// `N` decoupled controllers: pitch today, pitch and yaw tomorrow.
#[derive(Clone, Debug)]
pub struct Axes<T, const N: usize>([Pid<T>; N]);

impl<T: Scalar, const N: usize> Axes<T, N> {
    /// One controller for each configuration.
    ///
    /// # Errors
    /// The first parameter out of its range by name; `axes` where there are none.
    pub fn new(configs: &[Config; N]) -> Result<Self, ConfigError> {
        let [first, ..] = configs.as_slice() else {
            return Err(ConfigError::OutOfRange("axes"));
        };
        let first = Pid::new(first)?;
        let mut axes = core::array::from_fn(|_| first.clone());
        for (axis, config) in axes.iter_mut().zip(configs) {
            *axis = Pid::new(config)?;
        }
        Ok(Self(axes))
    }

    /// One sample of all axes: setpoints, measurements, rates.
    pub fn update(&mut self, setpoint: [T; N], measured: [T; N], rate: [T; N]) -> [T; N] {
        let mut inputs = setpoint.into_iter().zip(measured).zip(rate);
        self.0.each_mut().map(|pid| match inputs.next() {
            Some(((setpoint, measured), rate)) => pid.update(setpoint, measured, rate),
            None => pid.output(),
        })
    }

    /// The controllers.
    pub fn controllers(&mut self) -> &mut [Pid<T>; N] {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Gains;

    fn config(kp: f32, kd: f32) -> Config {
        Config {
            gains: Gains { kp, ki: 0.0, kd },
            ..Config::new(0.01)
        }
    }

    #[test]
    fn each_axis_is_its_own_controller() {
        let configs = [config(1.0, 0.1), config(2.0, 0.2)];
        let mut axes = Axes::<f32, 2>::new(&configs).unwrap();
        let mut alone = configs.map(|config| Pid::<f32>::new(&config).unwrap());
        for (y, rate) in [(0.1, 0.0), (0.2, 1.0), (-0.3, -2.0)] {
            let together = axes.update([0.0, 0.1], [y, -y], [rate, 0.5 * rate]);
            let [pitch, yaw] = &mut alone;
            assert_eq!(
                together,
                [pitch.update(0.0, y, rate), yaw.update(0.1, -y, 0.5 * rate)]
            );
        }
        assert_eq!(axes.controllers()[1].output(), alone[1].output());
    }

    #[test]
    fn refuses_a_bad_axis_and_no_axes() {
        let bad = [config(1.0, 0.0), config(f32::NAN, 0.0)];
        assert_eq!(
            Axes::<f32, 2>::new(&bad).err(),
            Some(ConfigError::OutOfRange("gains.kp"))
        );
        assert_eq!(
            Axes::<f32, 0>::new(&[]).err(),
            Some(ConfigError::OutOfRange("axes"))
        );
    }
}
