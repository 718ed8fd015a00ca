//! The mount's rotation out of a rest with the body level.

use nalgebra::Vector3;

/// Roll and pitch of the mount, rad, out of the corrected accelerometer's reading, m/s2, with the
/// body level: the angles of `R = Rz(yaw) Ry(pitch) Rx(roll)`, sensor to body, that turn the
/// sensor's down to the body's z. Gravity does not show the yaw.
pub fn mount(acc: &Vector3<f64>) -> (f64, f64) {
    let down = -acc;
    let roll = libm::atan2(down.y, down.z);
    let pitch = libm::atan2(-down.x, libm::hypot(down.y, down.z));
    (roll, pitch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn the_mount_turns_the_reading_upright() {
        for acc in [
            Vector3::new(0.0, 0.0, -9.81),
            Vector3::new(1.0, -2.0, -9.0),
            Vector3::new(-3.0, 5.0, 7.0),
            Vector3::new(9.0, 1.0, 0.5),
        ] {
            let (roll, pitch) = mount(&acc);
            let body = Rotation3::from_euler_angles(roll, pitch, 0.0) * acc;
            assert!((body - Vector3::new(0.0, 0.0, -acc.norm())).norm() < 1e-9, "{body}");
        }
        assert_eq!(mount(&Vector3::new(0.0, 0.0, -9.81)).1, 0.0);
    }
}
