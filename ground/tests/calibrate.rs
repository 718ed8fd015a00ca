//! `tvc calibrate` on recordings of the emulated sensor with large errors, held against what they are.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use nalgebra::{Matrix3, Vector3};
use rig::bno055::{Config, ImuErrors};
use rig::handling::{Hand, Sample, record};
use serde_json::Value;

const MG: f64 = 9.80665e-3;

/// 80 mg, 3 deg/s, 40 uT and soft iron with 20 % of skew; noise of the field 0.6 uT.
fn errors(soft_iron: [[f64; 3]; 3]) -> ImuErrors {
    ImuErrors {
        gyro_bias_rad_s: Some([3.0, -3.0, 3.0].map(f64::to_radians)),
        acc_offset_m_s2: [80.0 * MG, -80.0 * MG, 80.0 * MG],
        acc_scale: [0.02, -0.02, 0.01],
        mag_noise_ut: 0.6,
        hard_iron_ut: [40.0, -40.0, 40.0],
        soft_iron,
        ..ImuErrors::default()
    }
}

const SYMMETRIC: [[f64; 3]; 3] = [[1.1, 0.2, 0.05], [0.2, 0.9, -0.1], [0.05, -0.1, 1.0]];
const SKEWED: [[f64; 3]; 3] = [[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.0]];

fn sensor(errors: ImuErrors, seed: u64) -> Config {
    Config {
        seed,
        errors,
        ..Config::default()
    }
}

fn write(folder: &Path, samples: &[Sample]) -> PathBuf {
    let mut text = "time_us,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,mag_x,mag_y,mag_z\n".to_owned();
    for s in samples {
        let counts = [s.acc, s.gyr, s.mag];
        let counts: Vec<String> = counts.as_flattened().iter().map(i16::to_string).collect();
        writeln!(text, "{},{}", s.time_us, counts.join(",")).unwrap();
    }
    let path = folder.join("log.csv");
    std::fs::write(&path, text).unwrap();
    path
}

fn calibrate(folder: &Path, log: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tvc"))
        .args(["calibrate", "--json", "--from"])
        .arg(log)
        .arg("--out")
        .arg(folder.join("out.parm"))
        .arg("--report")
        .arg(folder.join("out.html"))
        .args(more)
        .output()
        .unwrap()
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_iterator(
        value
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap()),
    )
}

fn matrix(value: &Value) -> Matrix3<f64> {
    let rows: Vec<_> = value.as_array().unwrap().iter().map(vector).collect();
    Matrix3::from_rows(&[
        rows[0].transpose(),
        rows[1].transpose(),
        rows[2].transpose(),
    ])
}

/// Largest error of the level heading, deg, over all of the compass at 70 deg of dip.
fn heading_error_deg(errors: &ImuErrors, mag: &Value) -> f64 {
    let (offset, undo) = (vector(&mag["offset_ut"]), matrix(&mag["matrix"]));
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

fn assert_calibrated(soft_iron: [[f64; 3]; 3], seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let errors = errors(soft_iron);
    let log = write(
        folder.path(),
        &record(sensor(errors, seed), &Hand::default()),
    );
    let output = calibrate(
        folder.path(),
        &log,
        &[
            "--level",
            "5",
            "--place",
            "55.79,12.52",
            "--date",
            "2026-07-01",
        ],
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();

    let bias = vector(&found["gyr"]["offset_deg_s"]);
    let off = (bias - Vector3::new(3.0, -3.0, 3.0)).amax();
    assert!(off <= 0.02, "gyroscope {off} deg/s off");
    // What the corrected accelerometer shows in every direction, against what is there.
    let (offset, scale) = (
        vector(&found["acc"]["offset_mg"]),
        vector(&found["acc"]["scale"]),
    );
    let mut worst: f64 = 0.0;
    for axis in 0..3 {
        for truth in [-1000.0, 0.0, 1000.0] {
            let reading =
                truth * (1.0 + errors.acc_scale[axis]) + errors.acc_offset_m_s2[axis] / MG;
            worst = worst.max(((reading - offset[axis]) * scale[axis] - truth).abs());
        }
    }
    assert!(worst <= 5.0, "accelerometer {worst} mg off");
    let heading = heading_error_deg(&errors, &found["mag"]);
    assert!(
        heading <= 1.5,
        "heading {heading} deg off: {}",
        found["mag"]
    );
    eprintln!("seed {seed}: {off:.4} deg/s, {worst:.2} mg, heading {heading:.2} deg");

    // The whole of it as the firmware's parameters, and as a page.
    let parameters = std::fs::read_to_string(folder.path().join("out.parm")).unwrap();
    for name in [
        "CAL_ACC_OX",
        "CAL_ACC_SZ",
        "CAL_GYR_OY",
        "CAL_MAG_OZ",
        "CAL_MAG_YX",
        "MNT_ROLL_DEG",
        "DECLINATION_DEG",
    ] {
        assert!(parameters.contains(name), "{name} in {parameters}");
        assert!(found["parameters"][name].is_number(), "{name}");
    }
    let page = std::fs::read_to_string(folder.path().join("out.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("Directions of the field"));
}

#[test]
fn large_errors_are_taken_off() {
    assert_calibrated(SYMMETRIC, 1);
    assert_calibrated(SYMMETRIC, 2);
}

#[test]
fn soft_iron_that_is_not_symmetric_is_aligned_with_gravity() {
    assert_calibrated(SKEWED, 3);
}

/// Status 1, the reason on standard error, no parameters written.
fn assert_refused(samples: &[Sample], more: &[&str], part: &str) {
    let folder = tempfile::tempdir().unwrap();
    let log = write(folder.path(), samples);
    let output = calibrate(folder.path(), &log, more);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains(part), "{said}");
    assert!(!folder.path().join("out.parm").exists());
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(!found["refused"].as_array().unwrap().is_empty());
}

#[test]
fn poor_data_are_refused_with_the_reason() {
    let hand = Hand {
        turning_s: 2.0,
        ..Hand::default()
    };
    let short = record(sensor(errors(SYMMETRIC), 4), &hand);
    assert_refused(&short, &[], "of all directions");
    assert_refused(&short[..1200], &["--only", "acc"], "all six faces");
    let trembling = Hand {
        tremble_rad_s: 0.08,
        ..hand
    };
    let moved = record(sensor(errors(SYMMETRIC), 4), &trembling);
    assert_refused(&moved, &["--only", "gyr"], "it moved during the rest");
    let mut mirrored = short;
    for sample in &mut mirrored {
        sample.gyr[1] = -sample.gyr[1];
    }
    assert_refused(&mirrored, &["--only", "gyr,acc"], "disagree about the axes");
}
