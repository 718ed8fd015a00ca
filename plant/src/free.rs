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
}
