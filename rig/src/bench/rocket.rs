//! A rocket on its pad, along its rail and in flight, in place of the drone.

use nalgebra::UnitQuaternion;
use plant::Checked;
use plant::ascent::{Ascent, AscentParameters};
use tvc_nano::Axis;

/// A rocket in place of the drone.
#[derive(Clone, Debug, PartialEq)]
pub struct RocketConfig {
    /// Masses, thrust, air, wind, gimbal, rail.
    pub parameters: AscentParameters,
    /// Pitch and roll of the rail at power-on, rad.
    pub start_rad: [f64; Axis::COUNT],
    /// What kicks the rocket in flight, in order of time.
    pub kicks: Vec<Kick>,
    /// Angle of an actuator's shaft for one of the gimbal.
    pub shaft_per_gimbal: f64,
}

/// A kick: the rates about the body's y and x jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kick {
    /// When, s since ignition.
    pub at_s: f64,
    /// By how much, pitch and roll, rad/s.
    pub rates_rad_s: [f64; Axis::COUNT],
}

/// The rocket. Its gimbal's actuators take a servo's pulses.
#[derive(Clone, Debug)]
pub struct Rocket {
    ascent: Ascent,
    /// Those that are still to come.
    kicks: Vec<Kick>,
    shaft_per_gimbal: f64,
}

impl Rocket {
    /// A rocket on its pad, whose rail holds it in an attitude (body to earth).
    ///
    /// # Errors
    /// Parameters out of range.
    pub fn new(config: &RocketConfig, attitude: UnitQuaternion<f64>) -> Checked<Self> {
        Ok(Self {
            ascent: Ascent::new(&config.parameters, attitude)?,
            kicks: config.kicks.clone(),
            shaft_per_gimbal: config.shaft_per_gimbal,
        })
    }

    /// The physics.
    pub fn ascent(&self) -> &Ascent {
        &self.ascent
    }

    /// Turns its rail to an attitude, while it stands.
    pub(super) fn tilt_rail(&mut self, attitude: UnitQuaternion<f64>) {
        if self.ascent.time_s().is_none()
            && let Ok(ascent) = Ascent::new(self.ascent.parameters(), attitude)
        {
            self.ascent = ascent;
        }
    }

    /// Lights the engine.
    pub fn ignite(&mut self) {
        self.ascent.ignite();
    }

    /// Advances by `dt_s` with the actuators' shafts sent to these angles, pitch and roll, rad.
    pub fn step(&mut self, dt_s: f64, shafts_rad: [f64; Axis::COUNT]) {
        self.ascent.step(dt_s, shafts_rad.map(|shaft| shaft / self.shaft_per_gimbal));
        let now_s = self.ascent.time_s().unwrap_or(0.0);
        while let Some(kick) = self.kicks.first().filter(|kick| kick.at_s <= now_s) {
            let inertia = self.ascent.mass_properties().inertia_kg_m2;
            let [pitch, roll] = kick.rates_rad_s.map(|rate| rate * inertia);
            self.ascent.kick([roll, pitch, 0.0]);
            self.kicks.remove(0);
        }
    }

    /// The actuators' shafts where the gimbal is now, pitch and roll, rad.
    pub(super) fn shafts_rad(&self) -> [f64; Axis::COUNT] {
        let gimbal = self.ascent.gimbal_rad();
        gimbal.map(|gimbal| gimbal * self.shaft_per_gimbal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rocket(kicks: &[Kick]) -> Rocket {
        let config = RocketConfig {
            parameters: AscentParameters::SPICA,
            start_rad: [0.0; 2],
            kicks: kicks.to_vec(),
            shaft_per_gimbal: 6.0,
        };
        Rocket::new(&config, UnitQuaternion::identity()).unwrap()
    }

    #[test]
    fn a_kick_comes_once_and_at_its_time() {
        let mut rocket = rocket(&[Kick { at_s: 2.0, rates_rad_s: [0.3, -0.1] }]);
        for _ in 0..1_000 {
            rocket.step(1e-3, [0.0; 2]);
        }
        assert_eq!(rocket.ascent().time_s(), None);
        rocket.ignite();
        for _ in 0..1_990 {
            rocket.step(1e-3, [0.0; 2]);
        }
        assert_eq!(rocket.ascent().rates_rad_s()[1], 0.0);
        for _ in 0..20 {
            rocket.step(1e-3, [0.0; 2]);
        }
        let [roll, pitch, _] = rocket.ascent().rates_rad_s();
        assert!((pitch - 0.3).abs() < 1e-3, "{pitch}");
        assert!((roll + 0.1).abs() < 1e-3, "{roll}");
    }

    /// A shaft at 12 deg brings the gimbal to 2 deg, and one beyond the limit to 5 deg.
    #[test]
    fn the_gimbal_follows_the_shafts_within_its_limit() {
        let mut rocket = rocket(&[]);
        let shafts = [12.0_f64.to_radians(), 60.0_f64.to_radians()];
        for _ in 0..1_000 {
            rocket.step(1e-3, shafts);
        }
        let [pitch, roll] = rocket.ascent().gimbal_rad().map(f64::to_degrees);
        assert!((pitch - 2.0).abs() < 1e-3, "{pitch}");
        assert!((roll - 5.0).abs() < 1e-3, "{roll}");
    }

    #[test]
    fn a_rocket_that_flies_has_no_rail_to_tilt() {
        let mut rocket = rocket(&[]);
        let tilted = UnitQuaternion::from_euler_angles(0.0, 0.1, 0.0);
        rocket.tilt_rail(tilted);
        assert!((rocket.ascent().tilt_rad()[0] - 0.1).abs() < 1e-12);
        rocket.ignite();
        rocket.step(1e-3, [0.0; 2]);
        rocket.tilt_rail(UnitQuaternion::identity());
        assert!((rocket.ascent().tilt_rad()[0] - 0.1).abs() < 1e-9);
    }
}
