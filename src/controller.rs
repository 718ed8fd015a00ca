//! The control law as the parameters configure it.
//!
//! Angles are the crank's, in servo radians from zero rudder. Positive ones pitch the nose down, so
//! that the crank is the negative of what [`PredictivePd`] puts out.

use core::f32::consts::PI;

use tvc_pid::{PredictiveConfig, PredictivePd};

use crate::config::TRIM_LIMIT_RAD;
use crate::memory::float;
use crate::params::Params;

/// Pitch control: what is measured becomes a crank angle.
#[derive(Clone, Debug)]
pub struct Controller {
    law: PredictivePd<f32>,
    setpoint_rad: f32,
}

impl Controller {
    /// A controller whose crank rests at zero rudder, with commands up to `travel_rad` either side.
    pub fn new(params: &Params, travel_rad: f32) -> Self {
        let mut controller = Self {
            law: PredictivePd::default(),
            setpoint_rad: 0.0,
        };
        controller.configure(params, travel_rad);
        controller
    }

    /// Take over changed parameters, without a bump. Parameters within their ranges always make a
    /// law, to which a test holds them; did they not, the old law would stay.
    pub fn configure(&mut self, params: &Params, travel_rad: f32) {
        self.setpoint_rad = params.pitch_set_deg() * (PI / 180.0);
        let _ = self.law.retune(&law(params, travel_rad));
    }

    /// One sample: pitch (rad) and pitch rate (rad/s), nose up positive, give the crank angle
    /// (rad).
    pub fn update(&mut self, pitch_rad: f32, rate_rad_s: f32) -> f32 {
        -self.law.update(self.setpoint_rad, pitch_rad, rate_rad_s)
    }

    /// See [`Flight::memory`](crate::Flight::memory).
    pub(crate) fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        self.law.memory(&mut |value| float(value, each));
    }

    /// The drone is held or the rudder is neutral for another reason: start afresh.
    pub fn reset(&mut self) {
        self.law.reset();
    }
}

fn law(params: &Params, travel_rad: f32) -> PredictiveConfig {
    let period_s = params.control_period_us() as f32 * 1.0e-6;
    PredictiveConfig {
        period_s,
        kp: params.pid_kp(),
        kd: params.pid_kd(),
        knee: params.pid_knee_rad(),
        far_slope: params.pid_far(),
        plant_gain: params.pitch_gain(),
        horizon_s: params.pid_ahead_s(),
        actuator_delay_s: params.srv_delay_s().min(period_s),
        actuator_s: params.srv_lag_s(),
        actuator_rate: params.srv_rad_s(),
        trim_rad_s: params.pid_trim_rad_s(),
        trim_limit: TRIM_LIMIT_RAD,
        limit: travel_rad,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{Range, TABLE};
    use proptest::prelude::*;

    #[test]
    fn nose_up_and_rising_ask_for_positive_crank_angles() {
        let mut controller = Controller::new(&Params::default(), 1.0);
        assert!(controller.update(0.1, 0.0) > 0.0);
        controller.reset();
        assert!(controller.update(0.0, 0.5) > 0.0);
        controller.reset();
        assert_eq!(controller.update(0.0, 0.0), 0.0);
    }

    #[test]
    fn the_setpoint_is_where_the_crank_rests() {
        let mut params = Params::default();
        params.set("PITCH_SET_DEG", 10.0).unwrap();
        let mut controller = Controller::new(&params, 1.0);
        assert!(controller.update(10.0_f32.to_radians(), 0.0).abs() < 1e-6);
    }

    proptest! {
        /// Whatever the parameters are within their ranges, they make a law.
        #[test]
        fn every_set_of_parameters_is_possible(
            shares in proptest::collection::vec(prop_oneof![Just(0.0_f32), Just(1.0), 0.0_f32..=1.0], TABLE.len()),
            travel_rad in 0.0_f32..2.0,
        ) {
            let mut params = Params::default();
            for (info, share) in TABLE.iter().zip(shares) {
                let value = match info.range {
                    Range::Between(low, high) => (low + share * (high - low)).min(high),
                    Range::OneOf(allowed) => allowed[0],
                };
                params.set(info.name, value).unwrap();
            }
            prop_assert!(PredictivePd::<f32>::new(&law(&params, travel_rad)).is_ok());
        }
    }
}
