//! What stands on the bench: the drone on a pivot, with one rudder, or in a joint, with two; or a
//! rocket on its pad.

use nalgebra::{UnitQuaternion, Vector3};
use plant::rocket::GRAVITY_M_S2;
use plant::servo::Load;
use plant::two_axis::TwoAxisDrone;
use plant::{Crank, Drone};
use tvc_nano::Axis;

use super::rocket::Rocket;

/// A vehicle with a rudder, or a gimbal's actuator, for each axis about which it is steered. Lists
/// name pitch first, then roll, which is 0 throughout where the drone only pitches.
#[derive(Clone, Debug)]
pub enum Vehicle {
    /// A drone that pitches.
    Pivot(Box<Drone>),
    /// A drone that pitches, rolls and spins.
    Joint(Box<TwoAxisDrone>),
    /// A rocket.
    Rocket(Box<Rocket>),
}

impl Vehicle {
    /// Pitch, or the part of the tilt about the body's y, rad, nose up positive.
    pub fn pitch_rad(&self) -> f64 {
        self.tilt_rad()[0]
    }

    /// The tilt as a vector in the body's axes, rad: its parts about y and x.
    pub fn tilt_rad(&self) -> [f64; Axis::COUNT] {
        match self {
            Self::Pivot(drone) => [drone.pitch_rad(), 0.0],
            Self::Joint(drone) => drone.tilt_rad(),
            Self::Rocket(rocket) => rocket.ascent().tilt_rad(),
        }
    }

    /// Body to north-east-down; a drone on a pivot has the heading of the bench, rad.
    pub(super) fn attitude(&self, heading_rad: f64) -> UnitQuaternion<f64> {
        match self {
            Self::Pivot(drone) => {
                UnitQuaternion::from_euler_angles(0.0, drone.pitch_rad(), heading_rad)
            }
            Self::Joint(drone) => drone.attitude(),
            Self::Rocket(rocket) => rocket.ascent().attitude(),
        }
    }

    /// Gravity where it is, m/s2.
    pub(super) fn gravity_m_s2(&self) -> f64 {
        match self {
            Self::Pivot(drone) => drone.mechanism().parameters().gravity_m_s2,
            Self::Joint(drone) => drone.mechanism().parameters().gravity_m_s2,
            Self::Rocket(_) => GRAVITY_M_S2,
        }
    }

    /// The rates about the body's x, y and z, rad/s: roll, pitch and spin.
    pub fn rates_rad_s(&self) -> [f64; 3] {
        match self {
            Self::Pivot(drone) => [0.0, drone.rate_rad_s(), 0.0],
            Self::Joint(drone) => drone.rates_rad_s(),
            Self::Rocket(rocket) => rocket.ascent().rates_rad_s(),
        }
    }

    /// The rates that a gyroscope on it turns with, rad/s: with those of a rocket's bending.
    pub(super) fn sensed_rates_rad_s(&self) -> [f64; 3] {
        match self {
            Self::Rocket(rocket) => rocket.ascent().sensed_rates_rad_s(),
            _ => self.rates_rad_s(),
        }
    }

    /// The tilt as [`Self::tilt_rad`] has it, rad, in axes that have the heading of the bench and
    /// do not spin with the drone.
    pub fn level_tilt_rad(&self, heading_rad: f64) -> [f64; Axis::COUNT] {
        match self {
            Self::Pivot(_) => self.tilt_rad(),
            Self::Joint(_) | Self::Rocket(_) => {
                let [pitch, roll] = self.tilt_rad();
                let turned = self::heading_rad(&self.attitude(heading_rad)) - heading_rad;
                let (sin, cos) = turned.sin_cos();
                [cos * pitch + sin * roll, cos * roll - sin * pitch]
            }
        }
    }

    /// Rudder or gimbal angles, rad.
    pub fn rudders_rad(&self) -> [f64; Axis::COUNT] {
        match self {
            Self::Pivot(drone) => [drone.rudder_rad(), 0.0],
            Self::Joint(drone) => drone.rudder_rad(),
            Self::Rocket(rocket) => rocket.ascent().gimbal_rad(),
        }
    }

    /// What the servos turn. A rocket's gimbal has actuators of its own.
    pub(super) fn crank_loads(&self) -> [Load; Axis::COUNT] {
        match self {
            Self::Pivot(drone) => [drone.crank_load(), Load::default()],
            Self::Joint(drone) => drone.crank_loads(),
            Self::Rocket(_) => [Load::default(); Axis::COUNT],
        }
    }

    /// Whether the clamp or its pad holds it.
    pub fn held(&self) -> bool {
        match self {
            Self::Pivot(drone) => drone.held(),
            Self::Joint(drone) => drone.held(),
            Self::Rocket(rocket) => rocket.ascent().time_s().is_none(),
        }
    }

    /// Clamps it at a tilt, rad, with the heading that it has.
    pub(super) fn clamp(&mut self, tilt_rad: [f64; Axis::COUNT]) {
        match self {
            Self::Pivot(drone) => drone.clamp(tilt_rad[0]),
            Self::Joint(drone) => {
                drone.clamp(attitude(tilt_rad, heading_rad(&drone.attitude())));
            }
            Self::Rocket(rocket) => {
                rocket.tilt_rail(attitude(tilt_rad, heading_rad(&rocket.ascent().attitude())));
            }
        }
    }

    /// Lets go of it with a rate in the direction of its tilt, upwards in pitch where it has none,
    /// and about its own vertical, rad/s. A rocket is ignited.
    pub(super) fn release(&mut self, rate_rad_s: f64, spin_rad_s: f64) {
        match self {
            Self::Pivot(drone) => drone.release(rate_rad_s),
            Self::Joint(drone) => {
                let [pitch, roll] = drone.tilt_rad();
                let angle = pitch.hypot(roll);
                let [along_pitch, along_roll] =
                    if angle > 0.0 { [pitch / angle, roll / angle] } else { [1.0, 0.0] };
                drone.release([rate_rad_s * along_roll, rate_rad_s * along_pitch, spin_rad_s]);
            }
            Self::Rocket(rocket) => rocket.ignite(),
        }
    }

    /// Gives a drone an angular impulse about the body's y, N m s.
    pub(super) fn kick(&mut self, impulse_n_m_s: f64) {
        match self {
            Self::Pivot(drone) => drone.kick(impulse_n_m_s),
            Self::Joint(drone) => drone.kick([0.0, impulse_n_m_s, 0.0]),
            Self::Rocket(_) => {}
        }
    }

    /// Changes a drone's thrust, N.
    pub(super) fn set_thrust(&mut self, thrust_n: f64) {
        match self {
            Self::Pivot(drone) => drone.set_thrust(thrust_n),
            Self::Joint(drone) => drone.set_thrust(thrust_n),
            Self::Rocket(_) => {}
        }
    }

    /// Advances by `dt_s`, at whose end the servos' cranks stand there, and which the newest pulses
    /// send to `targets_rad`: a gimbal's actuators have a motion of their own.
    pub(super) fn step(
        &mut self,
        dt_s: f64,
        cranks: [Crank; Axis::COUNT],
        targets_rad: [f64; Axis::COUNT],
    ) {
        match self {
            Self::Pivot(drone) => drone.step(dt_s, cranks[0]),
            Self::Joint(drone) => drone.step(dt_s, cranks),
            Self::Rocket(rocket) => rocket.step(dt_s, targets_rad),
        }
    }
}

/// Body to north-east-down of a drone that is turned by a heading and then tilted, rad.
pub(super) fn attitude(tilt_rad: [f64; Axis::COUNT], heading_rad: f64) -> UnitQuaternion<f64> {
    let [pitch, roll] = tilt_rad;
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad)
        * UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0))
}

/// The heading of such an attitude, rad.
fn heading_rad(attitude: &UnitQuaternion<f64>) -> f64 {
    2.0 * attitude.k.atan2(attitude.w)
}
