//! The drone with a prescribed crank: the model that the virtual rig flies.
//!
//! A position servo decides where the crank is; what remains free is the pitch. The momentum
//! `p0 = M00 w0 + M01 v1` obeys `dp0/dt = Q0(th0, th1)` exactly, whatever the crank's acceleration,
//! so that a jump of the crank's rate (backlash taken up, a gear stopping) needs no special case:
//!
//! ```text
//! dth0/dt = (p0 - M01 v1) / M00
//! ```
//!
//! [`Drone::step`] takes the crank at the end of the step and lets it move evenly in between. Only
//! the crank's path enters the pitch, not its rate at the ends; the rate at the end is what the
//! reported pitch rate refers to.

use crate::mechanism::{Configuration, Mechanism};
use crate::parameters::{Checked, Parameters};
use crate::servo::Load;

/// Pitch at which the tether's stops hold the drone, either side, in rad.
pub const TETHER_STOP_RAD: f64 = 1.2;

/// The crank: where it is and how fast it turns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Crank {
    /// Angle `theta1`, in rad.
    pub angle_rad: f64,
    /// Rate relative to the drone, in rad/s.
    pub rate_rad_s: f64,
}

impl Crank {
    /// A crank at an angle (rad) that turns at a rate (rad/s).
    pub fn new(angle_rad: f64, rate_rad_s: f64) -> Self {
        Self { angle_rad, rate_rad_s }
    }

    /// A crank that stands still at an angle (rad).
    pub fn at_rest(angle_rad: f64) -> Self {
        Self::new(angle_rad, 0.0)
    }
}

/// The drone on its pivot.
#[derive(Clone, Debug)]
pub struct Drone {
    mechanism: Mechanism,
    stop_rad: f64,
    held: bool,
    pitch_rad: f64,
    momentum: f64,
    crank: Crank,
    at: Configuration,
}

impl Drone {
    /// A free drone at a pitch (rad) and pitch rate (rad/s), rudder at zero, crank at rest.
    ///
    /// # Errors
    /// As [`Parameters::validate`].
    pub fn new(parameters: &Parameters, pitch_rad: f64, rate_rad_s: f64) -> Checked<Self> {
        let mechanism = Mechanism::new(parameters)?;
        let crank = Crank::at_rest(mechanism.linkage().zero_rudder_crank_rad());
        let at = mechanism.configuration(crank.angle_rad);
        Ok(Self {
            mechanism,
            stop_rad: TETHER_STOP_RAD,
            held: false,
            pitch_rad,
            momentum: at.m00 * rate_rad_s,
            crank,
            at,
        })
    }

    /// Moves the tether's stops to `stop_rad` either side; infinite takes them away.
    pub fn with_tether_stop(mut self, stop_rad: f64) -> Self {
        self.stop_rad = stop_rad;
        self
    }

    /// Clamps the drone at a pitch (rad): it stays there, whatever the rudder does, until it is
    /// released.
    pub fn clamp(&mut self, pitch_rad: f64) {
        self.pitch_rad = pitch_rad;
        self.held = true;
        self.set_rate(0.0);
    }

    /// Lets go of a clamped drone, or pushes a free one, with a pitch rate (rad/s).
    pub fn release(&mut self, rate_rad_s: f64) {
        self.held = false;
        self.set_rate(rate_rad_s);
    }

    /// Adds an angular impulse (N m s) about the pivot: a gust or a knock. A clamp swallows it.
    pub fn kick(&mut self, impulse_n_m_s: f64) {
        if !self.held {
            self.momentum += impulse_n_m_s;
        }
    }

    /// Changes the thrust (N) from now on; motion stays as it is.
    pub fn set_thrust(&mut self, thrust_n: f64) {
        if thrust_n != self.mechanism.parameters().thrust_n {
            self.mechanism = self.mechanism.with_thrust(thrust_n);
            self.at = self.mechanism.configuration(self.crank.angle_rad);
        }
    }

    /// Places the crank without moving the drone, as when the servo is fitted at the start.
    pub fn place_crank(&mut self, angle_rad: f64) {
        let rate = self.rate_rad_s();
        self.crank = Crank::at_rest(angle_rad);
        self.at = self.mechanism.configuration(angle_rad);
        self.set_rate(rate);
    }

    /// Advances by `dt_s` (greater than zero), at whose end the crank stands at `end`.
    ///
    /// Fourth-order Runge-Kutta for pitch and momentum. A tether stop is inelastic: the drone
    /// that reaches it loses its rate at the end of the step, and leaves it when the loads turn
    /// it back.
    pub fn step(&mut self, dt_s: f64, end: Crank) {
        let start = self.crank;
        let middle = self.mechanism.configuration(0.5 * (start.angle_rad + end.angle_rad));
        let finish = self.mechanism.configuration(end.angle_rad);
        if !self.held {
            let mean_rate = (end.angle_rad - start.angle_rad) / dt_s;
            let slope = |at: &Configuration, [pitch, momentum]: [f64; 2]| {
                let rate = (momentum - at.m01 * mean_rate) / at.m00;
                [rate, self.mechanism.pitch_load(at, pitch, rate)]
            };
            let from = [self.pitch_rad, self.momentum];
            let ahead = |k: [f64; 2], h: f64| [from[0] + h * k[0], from[1] + h * k[1]];
            let k1 = slope(&self.at, from);
            let k2 = slope(&middle, ahead(k1, 0.5 * dt_s));
            let k3 = slope(&middle, ahead(k2, 0.5 * dt_s));
            let k4 = slope(&finish, ahead(k3, dt_s));
            let mean = |i: usize| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0;
            self.pitch_rad += dt_s * mean(0);
            self.momentum += dt_s * mean(1);
        }
        self.crank = end;
        self.at = finish;
        if self.held {
            self.set_rate(0.0);
        } else if self.pitch_rad.abs() >= self.stop_rad {
            self.pitch_rad = self.stop_rad.copysign(self.pitch_rad);
            if self.rate_rad_s() * self.pitch_rad > 0.0 {
                self.set_rate(0.0);
            }
        }
    }

    /// Pitch `theta0`, in rad.
    pub fn pitch_rad(&self) -> f64 {
        self.pitch_rad
    }

    /// Pitch rate `w0`, in rad/s.
    pub fn rate_rad_s(&self) -> f64 {
        (self.momentum - self.at.m01 * self.crank.rate_rad_s) / self.at.m00
    }

    /// The crank as last given.
    pub fn crank(&self) -> Crank {
        self.crank
    }

    /// Rudder angle `theta3`, in rad.
    pub fn rudder_rad(&self) -> f64 {
        self.at.linkage.rudder_rad()
    }

    /// Torque of wash and gravity on the crank, in N m.
    pub fn hinge_torque_n_m(&self) -> f64 {
        self.mechanism.hinge_torque(&self.at, self.pitch_rad)
    }

    /// What the servo turns, the drone's own acceleration included: that of the pitch is eliminated
    /// from the equations of both coordinates. Terms with the square of a rate are left out.
    pub fn crank_load(&self) -> Load {
        let (at, hinge) = (&self.at, self.hinge_torque_n_m());
        if self.held {
            return Load { torque_n_m: hinge, inertia_kg_m2: at.m11 };
        }
        let pitch = self.mechanism.pitch_load(at, self.pitch_rad, self.rate_rad_s());
        let share = at.m01 / at.m00;
        Load { torque_n_m: hinge - share * pitch, inertia_kg_m2: at.crank_inertia() }
    }

    /// Whether the clamp holds the drone.
    pub fn held(&self) -> bool {
        self.held
    }

    /// The mechanism, for its linkage and parameters.
    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    fn set_rate(&mut self, rate_rad_s: f64) {
        self.momentum = self.at.m00 * rate_rad_s + self.at.m01 * self.crank.rate_rad_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.5e-3;

    impl Drone {
        /// Pitch acceleration, in rad/s2, with this acceleration of the crank. The push of a tether
        /// stop is left out.
        pub(crate) fn acceleration_rad_s2(&self, crank_rad_s2: f64) -> f64 {
            let (at, rate, v1) = (&self.at, self.rate_rad_s(), self.crank.rate_rad_s);
            let load = self.mechanism.pitch_load(at, self.pitch_rad, rate);
            (load - at.m00_slope * v1 * rate - at.m01_slope * v1 * v1 - at.m01 * crank_rad_s2)
                / at.m00
        }
    }

    fn drone(pitch: f64, rate: f64) -> Drone {
        Drone::new(&Parameters::PHYS, pitch, rate).unwrap()
    }

    #[test]
    fn a_clamped_drone_stays_until_released() {
        let mut drone = drone(0.0, 0.0);
        drone.clamp(0.4);
        for i in 1..200 {
            let angle_rad = 1e-3 * f64::from(i);
            drone.step(DT_S, Crank::new(angle_rad, 2.0));
            assert_eq!(drone.pitch_rad(), 0.4);
            assert!(drone.rate_rad_s().abs() < 1e-15);
        }
        drone.release(0.2);
        assert!((drone.rate_rad_s() - 0.2).abs() < 1e-15);
        let crank = drone.crank();
        drone.step(DT_S, crank);
        assert!(drone.pitch_rad() > 0.4);
    }

    /// Positive rudder turns the drone back with 56.7 1/s2 for each radian of rudder.
    #[test]
    fn rudder_accelerates_the_drone_the_other_way() {
        let mut drone = drone(0.0, 0.0);
        let crank = drone.mechanism().linkage().crank_for_rudder(0.01).unwrap();
        drone.place_crank(crank);
        assert_eq!(drone.rate_rad_s(), 0.0);
        assert!((drone.acceleration_rad_s2(0.0) / 0.01 + 56.7).abs() < 0.1);
        for _ in 0..20 {
            drone.step(DT_S, Crank::at_rest(crank));
        }
        assert!((drone.rate_rad_s() / (0.01 * 20.0 * DT_S) + 56.7).abs() < 0.1);
    }

    #[test]
    fn the_tether_catches_the_drone_and_lets_it_back() {
        let mut drone = drone(1.1, 3.0);
        let crank = drone.crank();
        let mut caught = false;
        for _ in 0..200 {
            drone.step(DT_S, crank);
            assert!(drone.pitch_rad() <= TETHER_STOP_RAD);
            caught |= drone.pitch_rad.abs() >= drone.stop_rad;
        }
        assert!(caught);
        assert!(drone.rate_rad_s().abs() < 0.01);
        for _ in 0..100 {
            drone.step(DT_S, Crank::at_rest(0.4));
        }
        assert!(drone.pitch_rad() < 1.19);
    }

    /// With no wash and no gravity the momentum stays, and a crank that swings out and back
    /// leaves the drone where it was: the pitch depends on the crank's path, not on its timing.
    #[test]
    fn crank_motion_alone_moves_nothing_for_good() {
        let p = Parameters { thrust_n: 0.0, gravity_m_s2: 0.0, ..Parameters::PHYS };
        let mut drone = Drone::new(&p, 0.3, 0.0).unwrap();
        let home = drone.crank().angle_rad;
        let mut lowest = 0.3_f64;
        for i in 1..=400 {
            let phase = std::f64::consts::PI * f64::from(i) / 400.0;
            let angle_rad = home + 0.8 * phase.sin();
            let rate_rad_s = 0.8 * phase.cos() * std::f64::consts::PI / 0.2;
            drone.step(DT_S, Crank::new(angle_rad, rate_rad_s));
            lowest = lowest.min(drone.pitch_rad());
        }
        assert!(lowest < 0.2955, "the reaction is real: {lowest}");
        assert!((drone.pitch_rad() - 0.3).abs() < 1e-9);
        drone.step(DT_S, Crank::at_rest(home));
        assert!(drone.rate_rad_s().abs() < 1e-12);
    }

    #[test]
    fn a_kick_changes_the_rate_by_impulse_over_inertia() {
        let mut drone = drone(0.0, 0.1);
        drone.kick(0.0127);
        assert!((drone.rate_rad_s() - 0.2).abs() < 1e-4);
        drone.clamp(0.0);
        drone.kick(1.0);
        assert_eq!(drone.rate_rad_s(), 0.0);
    }
}
