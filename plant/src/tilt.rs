//! The tilt of a body whose axis z points down.

use nalgebra::{UnitQuaternion, Vector3};

/// The tilt of the body's vertical against the earth's as a vector (the reduced attitude), rad: its
/// parts about the body's y and x. Upside down, one of the shortest ways is taken.
pub(crate) fn tilt_rad(attitude: &UnitQuaternion<f64>) -> [f64; 2] {
    let down = attitude.inverse() * Vector3::z();
    let across = down.x.hypot(down.y);
    let angle = across.atan2(down.z);
    if across > 0.0 { [-down.x / across * angle, down.y / across * angle] } else { [angle, 0.0] }
}
