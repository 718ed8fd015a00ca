//! From the sensor's counts to SI units in the body frame.
//!
//! The body's axes are x forward, y right, z down; the default mount has the sensor's axes along them. A sensor at
//! rest and level then reads -9.81 m/s2 on z: an accelerometer measures the force that holds it up.

use core::f32::consts::PI;

use bno055_driver::RawSample;
use nalgebra::{Matrix3, Vector3};
use tvc_fusion::{Quaternion, Sample};

use crate::params::Params;

/// m/s2 per accelerometer count (data sheet table 3-17: 100 LSB per m/s2).
pub const ACC_M_S2: f32 = 0.01;
/// rad/s per gyro count (data sheet table 3-22: 16 LSB per deg/s).
pub const GYR_RAD_S: f32 = PI / 180.0 / 16.0;
/// uT per magnetometer count (data sheet table 3-19: 16 LSB per uT).
pub const MAG_UT: f32 = 1.0 / 16.0;

/// What one three-axis sensor's counts mean: `(counts - offset) * scale`, axis by axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Reading at zero input, counts.
    pub offset: Vector3<f32>,
    /// SI units per count.
    pub scale: Vector3<f32>,
}

impl Calibration {
    /// No offset, the same nominal scale on every axis.
    pub fn nominal(scale: f32) -> Self {
        Self {
            offset: Vector3::zeros(),
            scale: Vector3::repeat(scale),
        }
    }

    fn apply(&self, counts: [i16; 3]) -> Vector3<f32> {
        let [x, y, z] = counts.map(f32::from);
        (Vector3::new(x, y, z) - self.offset).component_mul(&self.scale)
    }
}

/// How the sensor sits in the body, and its calibration.
#[derive(Clone, Debug)]
pub struct Mount {
    acc: Calibration,
    gyr: Calibration,
    mag: Calibration,
    /// Sensor to body; `None` where the axes coincide, which saves 27 multiplications a step.
    rotation: Option<Matrix3<f32>>,
}

impl Mount {
    /// A nominal sensor, turned as the `MNT_` parameters say.
    pub fn new(params: &Params) -> Self {
        Self {
            acc: Calibration::nominal(ACC_M_S2),
            gyr: Calibration::nominal(GYR_RAD_S),
            mag: Calibration::nominal(MAG_UT),
            rotation: rotation(params),
        }
    }

    /// Take over changed `MNT_` parameters.
    pub fn configure(&mut self, params: &Params) {
        self.rotation = rotation(params);
    }

    /// Replace the calibration of the accelerometer, gyro and magnetometer, in this order.
    pub fn calibrate(&mut self, acc: Calibration, gyr: Calibration, mag: Calibration) {
        (self.acc, self.gyr, self.mag) = (acc, gyr, mag);
    }

    /// Counts to SI units in the body frame. The field counts as fresh.
    pub fn convert(&self, raw: &RawSample) -> Sample {
        let turn = |v: Vector3<f32>| match &self.rotation {
            Some(rotation) => rotation * v,
            None => v,
        };
        Sample {
            acc: turn(self.acc.apply(raw.acc)),
            gyr: turn(self.gyr.apply(raw.gyr)),
            mag: Some(turn(self.mag.apply(raw.mag))),
        }
    }
}

/// `R = Rz(yaw) Ry(pitch) Rx(roll)`, sensor to body, as autopilots define a sensor's orientation. By quaternions, whose
/// exponential the estimator has anyway: sines of the mathematics library would add 5 KB to the image.
fn rotation(params: &Params) -> Option<Matrix3<f32>> {
    let [roll, pitch, yaw] = [
        params.mnt_roll_deg(),
        params.mnt_pitch_deg(),
        params.mnt_yaw_deg(),
    ]
    .map(|angle_deg| angle_deg * (PI / 180.0));
    if [roll, pitch, yaw] == [0.0; 3] {
        return None;
    }
    let about_x = Quaternion::from_rotation_vector(&Vector3::new(roll, 0.0, 0.0));
    let about_y = Quaternion::from_rotation_vector(&Vector3::new(0.0, pitch, 0.0));
    let about_z = Quaternion::from_rotation_vector(&Vector3::new(0.0, 0.0, yaw));
    let half = about_z.mul(&about_y).mul(&about_x).half_rows();
    let rows = [half.north, half.east, half.down].map(|row| (row * 2.0).transpose());
    Some(Matrix3::from_rows(&rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bno055_driver::Micros;

    fn raw(acc: [i16; 3], gyr: [i16; 3], mag: [i16; 3]) -> RawSample {
        RawSample {
            time: Micros(0),
            acc,
            gyr,
            mag,
        }
    }

    fn mount(roll: f32, pitch: f32, yaw: f32) -> Mount {
        let mut params = Params::default();
        params.set("MNT_ROLL_DEG", roll).unwrap();
        params.set("MNT_PITCH_DEG", pitch).unwrap();
        params.set("MNT_YAW_DEG", yaw).unwrap();
        Mount::new(&params)
    }

    #[test]
    fn counts_become_si_units() {
        let body = mount(0.0, 0.0, 0.0).convert(&raw([0, 0, -981], [16, -160, 0], [800, 0, 16]));
        assert!((body.acc - Vector3::new(0.0, 0.0, -9.81)).norm() < 1e-5);
        assert!((body.gyr - Vector3::new(0.017453, -0.17453, 0.0)).norm() < 1e-5);
        assert_eq!(body.mag.unwrap(), Vector3::new(50.0, 0.0, 1.0));
    }

    fn assert_acc(mount: &Mount, acc: [i16; 3], expected: [f32; 3]) {
        let body = mount.convert(&raw(acc, [0; 3], [0; 3])).acc;
        let expected = Vector3::from(expected);
        assert!((body - expected).norm() < 1e-5, "{body} for {expected}");
    }

    #[test]
    fn a_sensor_upside_down_is_turned_by_180_degrees_of_roll() {
        assert_acc(&mount(180.0, 0.0, 0.0), [1, 2, 981], [0.01, -0.02, -9.81]);
    }

    #[test]
    fn quarter_turns_move_axes_as_the_right_hand_says() {
        let (x, y) = ([100, 0, 0], [0, 100, 0]);
        assert_acc(&mount(0.0, 0.0, 90.0), x, [0.0, 1.0, 0.0]);
        assert_acc(&mount(0.0, 90.0, 0.0), x, [0.0, 0.0, -1.0]);
        assert_acc(&mount(90.0, 0.0, 0.0), y, [0.0, 0.0, 1.0]);
        // Roll first, yaw last: y goes to z by the roll and stays there; x goes to y by the yaw.
        assert_acc(&mount(90.0, 0.0, 90.0), y, [0.0, 0.0, 1.0]);
        assert_acc(&mount(90.0, 0.0, 90.0), x, [0.0, 1.0, 0.0]);
    }

    #[test]
    fn a_mount_is_what_an_independent_library_makes_of_its_angles() {
        let oracle = nalgebra::Rotation3::from_euler_angles(0.3_f64, -0.7, 2.1);
        let expected = oracle * nalgebra::Vector3::new(3.0, -5.0, 8.0);
        let mount = mount(
            0.3_f32.to_degrees(),
            -0.7_f32.to_degrees(),
            2.1_f32.to_degrees(),
        );
        assert_acc(&mount, [300, -500, 800], expected.map(|c| c as f32).into());
    }

    #[test]
    fn any_mount_keeps_lengths() {
        let sample = raw([300, -500, 800], [1, 2, 3], [4, 5, 6]);
        let straight = mount(0.0, 0.0, 0.0).convert(&sample).acc.norm();
        let turned = mount(10.0, -35.0, 120.0).convert(&sample).acc.norm();
        assert!((straight - turned).abs() < 1e-5);
    }

    #[test]
    fn calibration_takes_off_the_offset_and_scales() {
        let mut mount = mount(0.0, 0.0, 0.0);
        let nominal = Calibration::nominal(1.0);
        let acc = Calibration {
            offset: Vector3::new(10.0, 0.0, 0.0),
            scale: Vector3::new(0.02, 0.01, 0.01),
        };
        mount.calibrate(acc, nominal, nominal);
        let body = mount.convert(&raw([110, 100, 100], [0; 3], [0; 3]));
        assert!((body.acc - Vector3::new(2.0, 1.0, 1.0)).norm() < 1e-6);
    }
}
