//! The physical quantities at a sensor, from gravity, its motion and the magnetic field.

use super::EarthField;
use crate::bno055::Stimulus;
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::FRAC_1_SQRT_2;

/// For a sensor at the pivot of a drone whose nose points to `heading_rad` from true north, along
/// the sensor's axes, which are the body's. `gravity` in m/s^2.
pub(super) fn on_drone(
    pitch_rad: f64,
    rate_rad_s: f64,
    heading_rad: f64,
    field: &EarthField,
    gravity: f64,
) -> Stimulus {
    let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
    let (sin_heading, cos_heading) = heading_rad.sin_cos();
    let [north, east, down] = field.north_east_down();
    let ahead = cos_heading * north + sin_heading * east;
    let right = -sin_heading * north + cos_heading * east;
    Stimulus {
        specific_force_m_s2: [gravity * sin_pitch, 0.0, -gravity * cos_pitch],
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
