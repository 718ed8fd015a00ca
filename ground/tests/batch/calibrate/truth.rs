//! What a calibration should have found, out of the emulated sensor's errors.

use nalgebra::{Matrix3, Vector3};
use rig::inertial::ImuErrors;
use serde_json::Value;

const MG: f64 = 9.80665e-3;

fn value(parameters: &Value, name: &str) -> f64 {
    parameters[name].as_f64().unwrap_or_else(|| panic!("{name} in {parameters}"))
}

fn vector(parameters: &Value, prefix: &str) -> Vector3<f64> {
    Vector3::from(["X", "Y", "Z"].map(|axis| value(parameters, &format!("{prefix}{axis}"))))
}

/// Largest error of the level heading, deg, over all of the compass at 70 deg of dip.
fn heading_error_deg(errors: &ImuErrors, parameters: &Value) -> f64 {
    let offset = vector(parameters, "CAL_MAG_O");
    let undo = Matrix3::from_rows(
        &["X", "Y", "Z"].map(|row| vector(parameters, &format!("CAL_MAG_{row}")).transpose()),
    );
    let soft = Matrix3::from_fn(|r, c| errors.soft_iron[r][c]);
    let (sin_dip, cos_dip) = 70.0_f64.to_radians().sin_cos();
    (0..360)
        .map(|deg| {
            let heading = f64::from(deg).to_radians();
            let field =
                Vector3::new(cos_dip * heading.cos(), -cos_dip * heading.sin(), sin_dip) * 50.0;
            let reading = soft * field + Vector3::from(errors.hard_iron_ut);
            let found = undo * (reading - offset);
            let error = (-found.y).atan2(found.x) - heading;
            error.sin().atan2(error.cos()).to_degrees().abs()
        })
        .fold(0.0, f64::max)
}

/// The firmware's parameters take off the sensor's errors: to 0.02 deg/s, 5 mg, and 1.5 deg of
/// heading all round.
pub(crate) fn assert_near(errors: &ImuErrors, parameters: &Value) {
    let bias = errors.gyro_bias_rad_s.unwrap().map(f64::to_degrees);
    let rate_deg_s = (vector(parameters, "CAL_GYR_O") - Vector3::from(bias)).amax();
    // What the corrected accelerometer shows in every direction, against what is there.
    let (offset, scale) = (vector(parameters, "CAL_ACC_O") / MG, vector(parameters, "CAL_ACC_S"));
    let mut force_mg: f64 = 0.0;
    for axis in 0..3 {
        for truth in [-1000.0, 0.0, 1000.0] {
            let reading =
                truth * (1.0 + errors.acc_scale[axis]) + errors.acc_offset_m_s2[axis] / MG;
            force_mg = force_mg.max(((reading - offset[axis]) * scale[axis] - truth).abs());
        }
    }
    let heading_deg = heading_error_deg(errors, parameters);
    eprintln!("off by {rate_deg_s:.4} deg/s, {force_mg:.2} mg, heading {heading_deg:.2} deg");
    assert!(rate_deg_s <= 0.02, "gyroscope {rate_deg_s} deg/s off");
    assert!(force_mg <= 5.0, "accelerometer {force_mg} mg off");
    assert!(heading_deg <= 1.5, "heading {heading_deg} deg off: {parameters}");
}
