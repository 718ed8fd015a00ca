//! Proportional and derivative action.

use crate::scalar::Scalar;

/// Proportional-derivative control with the derivative on the measured rate.
///
/// `u = kp * (setpoint - measured) - kd * rate`. A moving setpoint makes no kick, and noisy angles
/// are not differentiated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pd<T = f32> {
    /// Output per error.
    pub kp: T,
    /// Output per rate.
    pub kd: T,
}

impl<T: Scalar> Pd<T> {
    /// The output for a measured value and its rate of change.
    #[inline]
    pub fn update(&self, setpoint: T, measured: T, rate: T) -> T {
        self.kp * (setpoint - measured) - self.kd * rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Q16;

    fn acts_against_the_motion<T: Scalar>() {
        let pd = Pd::<T> { kp: 2.0.into(), kd: 0.5.into() };
        for ([setpoint, measured, rate], expected) in
            [([0.0, 0.0, 0.0], 0.0), ([0.0, 0.5, 0.0], -1.0), ([0.25, 0.5, -1.0], 0.0)]
        {
            let output = pd.update(setpoint.into(), measured.into(), rate.into());
            assert_eq!(output.into(), expected);
        }
    }

    #[test]
    fn error_and_rate_act_against_the_motion() {
        acts_against_the_motion::<f32>();
        acts_against_the_motion::<Q16>();
    }
}
