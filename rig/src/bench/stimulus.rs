//! The physical quantities at a sensor, from gravity, its motion and the magnetic field.

use super::EarthField;
use crate::inertial::Stimulus;
use nalgebra::{UnitQuaternion, Vector3};
use plant::ascent::Ascent;
use std::f64::consts::FRAC_1_SQRT_2;

/// For a sensor at `lever_m` (body axes) from the pivot of a drone; along the sensor's axes, which
/// are the body's. The drone turns about the pivot with a rate (rad/s, nose up) and an acceleration
/// (rad/s^2), and its nose points to `heading_rad` from true north. `gravity` in m/s^2.
///
/// The drone turns with `w = (0, q, 0)`, and the pivot stands still, so that a point `r` has the
/// acceleration `dw/dt x r + w x (w x r) = (q' z - q^2 x, 0, -q' x - q^2 z)`: the first terms are
/// tangential, the second point to the axis.
pub(super) fn on_drone(
    pitch_rad: f64,
    (rate_rad_s, tangential): (f64, f64),
    [x, _, z]: [f64; 3],
    heading_rad: f64,
    field: &EarthField,
    gravity: f64,
) -> Stimulus {
    let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
    let centripetal = rate_rad_s * rate_rad_s;
    let (sin_heading, cos_heading) = heading_rad.sin_cos();
    let [north, east, down] = field.north_east_down();
    let ahead = cos_heading * north + sin_heading * east;
    let right = -sin_heading * north + cos_heading * east;
    Stimulus {
        specific_force_m_s2: [
            gravity * sin_pitch + (tangential * z - centripetal * x),
            0.0,
            -gravity * cos_pitch + (-tangential * x - centripetal * z),
        ],
        rate_rad_s: [0.0, rate_rad_s, 0.0],
        field_ut: [
            cos_pitch * ahead - sin_pitch * down,
            right,
            sin_pitch * ahead + cos_pitch * down,
        ],
        attitude: attitude(pitch_rad, heading_rad - field.declination_rad),
    }
}

/// Body to east-north-up with magnetic north: `(i + j) / sqrt 2` takes north-east-down there.
fn attitude(pitch_rad: f64, magnetic_heading_rad: f64) -> [f64; 4] {
    let (sin_p, cos_p) = (0.5 * pitch_rad).sin_cos();
    let (sin_h, cos_h) = (0.5 * magnetic_heading_rad).sin_cos();
    let [w, x, y, z] = [cos_h * cos_p, -sin_h * sin_p, cos_h * sin_p, sin_h * cos_p];
    [-x - y, w + z, w - z, y - x].map(|c| c * FRAC_1_SQRT_2)
}

/// For a sensor at `lever_m` from the pivot of a drone that turns at `rate` (rad/s) and
/// `acceleration` (rad/s^2), along the sensor's axes, which are the body's. `attitude` takes them
/// to north-east-down; `gravity` in m/s^2.
pub(super) fn in_joint(
    attitude: &UnitQuaternion<f64>,
    (rate, acceleration): (Vector3<f64>, Vector3<f64>),
    lever_m: [f64; 3],
    field: &EarthField,
    gravity: f64,
) -> Stimulus {
    let lever = Vector3::from(lever_m);
    let moved = acceleration.cross(&lever) + rate.cross(&rate.cross(&lever));
    let mut felt = in_hand(attitude, rate, field, gravity);
    for axis in 0..3 {
        felt.specific_force_m_s2[axis] += moved[axis];
    }
    felt
}

/// For a sensor at its place in a rocket that turns at `rate` (rad/s), along the body's axes.
pub(super) fn in_ascent(ascent: &Ascent, rate: Vector3<f64>, field: &EarthField) -> Stimulus {
    Stimulus {
        specific_force_m_s2: ascent.specific_force_m_s2(),
        ..in_hand(&ascent.attitude(), rate, field, 0.0)
    }
}

/// For a sensor in a hand that turns in place at `rate` (rad/s, sensor axes). `attitude` takes the
/// sensor's axes to north-east-down; `gravity` in m/s^2.
pub(super) fn in_hand(
    attitude: &UnitQuaternion<f64>,
    rate: Vector3<f64>,
    field: &EarthField,
    gravity: f64,
) -> Stimulus {
    let to_sensor = attitude.inverse();
    Stimulus {
        specific_force_m_s2: (to_sensor * Vector3::new(0.0, 0.0, -gravity)).into(),
        rate_rad_s: rate.into(),
        field_ut: (to_sensor * Vector3::from(field.north_east_down())).into(),
        // Only the fusion modes show it.
        attitude: [1.0, 0.0, 0.0, 0.0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURNING: (f64, f64) = (3.0, 20.0);

    fn felt(pitch_rad: f64, lever_m: [f64; 3]) -> [f64; 3] {
        on_drone(pitch_rad, TURNING, lever_m, 0.0, &EarthField::COPENHAGEN, 9.81)
            .specific_force_m_s2
    }

    fn near(a: [f64; 3], b: [f64; 3]) {
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() < 1e-9, "{a} instead of {b}");
        }
    }

    /// Nose up with 3 rad/s and 20 rad/s2. 10 cm ahead of the pivot the sensor swings up, along -z,
    /// with 2 m/s2 and is pulled back with 0.9 m/s2. 10 cm below it swings ahead with 2 m/s2 and is
    /// pulled up with 0.9 m/s2. To the right, on the axis, it feels nothing.
    #[test]
    fn off_the_pivot_the_motion_itself_is_felt() {
        near(felt(0.0, [0.0; 3]), [0.0, 0.0, -9.81]);
        near(felt(0.0, [0.1, 0.0, 0.0]), [-0.9, 0.0, -11.81]);
        near(felt(0.0, [0.0, 0.0, 0.1]), [2.0, 0.0, -10.71]);
        near(felt(0.0, [0.0, 0.1, 0.0]), [0.0, 0.0, -9.81]);
    }

    /// The formula against the second difference of where the sensor is in the earth's axes.
    #[test]
    fn it_is_the_acceleration_of_the_place_where_the_sensor_is() {
        let lever_m = [0.05, 0.02, -0.12];
        let (rate, acceleration) = TURNING;
        let body = |t: f64| {
            let pitch = 0.4 + rate * t + 0.5 * acceleration * t * t;
            UnitQuaternion::from_euler_angles(0.0, pitch, 0.0)
        };
        let place = |t: f64| body(t) * Vector3::from(lever_m);
        let h = 1e-4;
        let acceleration = (place(h) - 2.0 * place(0.0) + place(-h)) / (h * h);
        let expected = body(0.0).inverse() * (acceleration - Vector3::new(0.0, 0.0, 9.81));
        let felt = Vector3::from(felt(0.4, lever_m));
        assert!((felt - expected).norm() < 1e-5, "{felt} {expected}");
    }
}
