//! Proportional and derivative action, and nothing else.

/// Proportional-derivative control with the derivative on the measured rate.
///
/// `u = kp * (setpoint - measured) - kd * rate`. There is no kick when the setpoint moves, and no difference of noisy
/// angles is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pd {
    /// Output per error.
    pub kp: f32,
    /// Output per rate.
    pub kd: f32,
}

impl Pd {
    /// The output for a measured value and its rate of change.
    #[inline]
    pub fn update(&self, setpoint: f32, measured: f32, rate: f32) -> f32 {
        self.kp * (setpoint - measured) - self.kd * rate
    }
}

#[cfg(test)]
mod tests {
    use super::Pd;

    #[test]
    fn error_and_rate_act_against_the_motion() {
        let pd = Pd { kp: 2.0, kd: 0.5 };
        assert_eq!(pd.update(0.0, 0.0, 0.0), 0.0);
        assert_eq!(pd.update(0.0, 0.5, 0.0), -1.0);
        assert_eq!(pd.update(0.25, 0.5, -1.0), 0.0);
    }
}
