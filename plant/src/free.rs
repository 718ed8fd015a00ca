//! Free motion of the two degrees of freedom: pitch and crank, driven by a torque on the crank.
//!
//! Lagrange's equations of the inertia in [`mechanism`](crate::mechanism):
//!
//! ```text
//! [M00 M01] [th0'']   [ Q0       - M00' w0 v1 - M01' v1^2          ]
//! [M01 M11] [th1''] = [ Q1 + tau - M11' v1^2 / 2 + M00' w0^2 / 2   ]
//! ```

use crate::mechanism::{Configuration, Mechanism};

/// Pitch and crank with their rates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Pitch `theta0`, in rad.
    pub pitch_rad: f64,
    /// Crank angle `theta1`, relative to the drone, in rad.
    pub crank_rad: f64,
    /// Pitch rate, in rad/s.
    pub pitch_rate_rad_s: f64,
    /// Crank rate relative to the drone, in rad/s.
    pub crank_rate_rad_s: f64,
}

impl State {
    /// As a vector `[th0, th1, w0, v1]` for an integrator.
    pub fn to_array(self) -> [f64; 4] {
        [self.pitch_rad, self.crank_rad, self.pitch_rate_rad_s, self.crank_rate_rad_s]
    }

    /// From a vector `[th0, th1, w0, v1]`.
    pub fn from_array(
        [pitch_rad, crank_rad, pitch_rate_rad_s, crank_rate_rad_s]: [f64; 4],
    ) -> Self {
        Self { pitch_rad, crank_rad, pitch_rate_rad_s, crank_rate_rad_s }
    }
}

impl Mechanism {
    /// Accelerations of pitch and crank under a servo torque (N m), in rad/s2.
    pub fn accelerations(&self, state: &State, torque_n_m: f64) -> [f64; 2] {
        self.accelerations_under(state, torque_n_m, 0.0)
    }

    /// Accelerations of pitch and crank under a servo torque and an external pitch moment on body
    /// 0 (both N m), in rad/s2.
    pub fn accelerations_under(
        &self,
        state: &State,
        torque_n_m: f64,
        pitch_moment_n_m: f64,
    ) -> [f64; 2] {
        let at = self.configuration(state.crank_rad);
        let w0 = state.pitch_rate_rad_s;
        let pitch = self.pitch_drive(&at, state, pitch_moment_n_m);
        let crank = self.crank_drive(&at, state, torque_n_m) + 0.5 * at.m00_slope * w0 * w0;
        let det = at.m00 * at.m11 - at.m01 * at.m01;
        [(at.m11 * pitch - at.m01 * crank) / det, (at.m00 * crank - at.m01 * pitch) / det]
    }

    /// Derivative of `[th0, th1, w0, v1]` under a servo torque (N m), for an integrator.
    pub fn derivative(&self, state: &[f64; 4], torque_n_m: f64) -> [f64; 4] {
        let [pitch, crank] = self.accelerations(&State::from_array(*state), torque_n_m);
        [state[2], state[3], pitch, crank]
    }

    /// Acceleration of the crank under a servo torque (N m) while body 0 is held still, in rad/s2.
    pub fn crank_acceleration_held(&self, state: &State, torque_n_m: f64) -> f64 {
        let at = self.configuration(state.crank_rad);
        self.crank_drive(&at, state, torque_n_m) / at.m11
    }

    /// Acceleration of the pitch when the crank is made to accelerate by `crank_rad_s2` under an
    /// external pitch moment on body 0 (N m), in rad/s2.
    pub fn pitch_acceleration(
        &self,
        state: &State,
        crank_rad_s2: f64,
        pitch_moment_n_m: f64,
    ) -> f64 {
        let at = self.configuration(state.crank_rad);
        (self.pitch_drive(&at, state, pitch_moment_n_m) - at.m01 * crank_rad_s2) / at.m00
    }

    /// Right-hand side of the pitch's equation under an external moment on body 0, in N m.
    fn pitch_drive(&self, at: &Configuration, state: &State, pitch_moment_n_m: f64) -> f64 {
        let (w0, v1) = (state.pitch_rate_rad_s, state.crank_rate_rad_s);
        self.pitch_load(at, state.pitch_rad, w0) + pitch_moment_n_m
            - at.m00_slope * w0 * v1
            - at.m01_slope * v1 * v1
    }

    /// Right-hand side of the crank's equation under a servo torque with body 0 held still, in N m.
    fn crank_drive(&self, at: &Configuration, state: &State, torque_n_m: f64) -> f64 {
        let v1 = state.crank_rate_rad_s;
        self.crank_load(at, state.pitch_rad, v1) + torque_n_m - 0.5 * at.m11_slope * v1 * v1
    }

    /// Kinetic and potential energy, in J; the potential is zero with the centre of mass at the
    /// pivot's height.
    pub fn energy_j(&self, state: &State) -> (f64, f64) {
        let at = self.configuration(state.crank_rad);
        let (w0, v1) = (state.pitch_rate_rad_s, state.crank_rate_rad_s);
        let (sin, cos) = state.pitch_rad.sin_cos();
        let [x, y] = at.first_moment;
        (
            0.5 * at.m00 * w0 * w0 + at.m01 * w0 * v1 + 0.5 * at.m11 * v1 * v1,
            self.parameters().gravity_m_s2 * (sin * x + cos * y),
        )
    }

    /// Angular momentum of all bodies about the pivot, in kg m2/s.
    pub fn momentum_kg_m2_s(&self, state: &State) -> f64 {
        let at = self.configuration(state.crank_rad);
        at.m00 * state.pitch_rate_rad_s + at.m01 * state.crank_rate_rad_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::Adaptive;
    use crate::parameters::Parameters;

    fn tumbling() -> State {
        State { pitch_rad: 0.4, crank_rad: -0.3, pitch_rate_rad_s: 1.5, crank_rate_rad_s: -4.0 }
    }

    #[test]
    fn energy_is_kept_without_thrust() {
        let p =
            Parameters { thrust_n: 0.0, crank_cm_m: 0.01, rudder_cm_m: -0.02, ..Parameters::PHYS };
        let mechanism = Mechanism::new(&p).unwrap();
        let times: Vec<f64> = (0..=50).map(|i| 0.1 * f64::from(i)).collect();
        let states = Adaptive::default()
            .sample(|_, x| mechanism.derivative(x, 0.0), &times, [], tumbling().to_array())
            .unwrap();
        let (kinetic, potential) = mechanism.energy_j(&tumbling());
        for state in states {
            let (k, v) = mechanism.energy_j(&State::from_array(state));
            let drift = (k + v - kinetic - potential) / kinetic;
            assert!(drift.abs() < 1e-9, "{drift}");
        }
    }

    #[test]
    fn angular_momentum_is_kept_without_gravity_and_thrust() {
        let p = Parameters { thrust_n: 0.0, gravity_m_s2: 0.0, ..Parameters::PHYS };
        let mechanism = Mechanism::new(&p).unwrap();
        // The servo's torque is internal: it must not change the momentum.
        let states = Adaptive::default()
            .sample(
                |t, x| mechanism.derivative(x, 0.02 * (5.0 * t).sin()),
                &[0.0, 1.0, 5.0],
                [],
                tumbling().to_array(),
            )
            .unwrap();
        let before = mechanism.momentum_kg_m2_s(&tumbling());
        for state in states {
            let after = mechanism.momentum_kg_m2_s(&State::from_array(state));
            assert!((after - before).abs() < 1e-11, "{after} {before}");
        }
    }

    #[test]
    fn zero_force_is_exactly_zero_motion() {
        let p = Parameters { thrust_n: 0.0, gravity_m_s2: 0.0, ..Parameters::PHYS };
        let mechanism = Mechanism::new(&p).unwrap();
        let still = State { pitch_rad: 0.7, crank_rad: 0.2, ..State::default() };
        assert_eq!(mechanism.accelerations(&still, 0.0), [0.0, 0.0]);
    }
}
