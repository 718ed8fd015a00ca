//! `tvc calibrate` finds the large errors of the emulated sensor in its recordings.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Output;

use rig::bno055::Config;
use rig::inertial::ImuErrors;
use serde_json::Value;

use crate::running;
use recording::{MotionPlan, Sample, record};

#[cfg(unix)]
mod guided;
mod recording;
mod truth;

fn errors(soft_iron: [[f64; 3]; 3]) -> ImuErrors {
    ImuErrors { soft_iron, ..ImuErrors::LARGEST }
}

const SYMMETRIC: [[f64; 3]; 3] = ImuErrors::LARGEST.soft_iron;
const SKEWED: [[f64; 3]; 3] = [[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.0]];

fn sensor(errors: ImuErrors, seed: u64) -> Config {
    Config { seed, errors, ..Config::default() }
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
    running::command(&["calibrate", "--json", "--from"])
        .arg(log)
        .arg("--out")
        .arg(folder.join("out.parm"))
        .arg("--report")
        .arg(folder.join("out.html"))
        .args(more)
        .output()
        .unwrap()
}

fn assert_calibrated(soft_iron: [[f64; 3]; 3], seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let errors = errors(soft_iron);
    let log = write(folder.path(), &record(sensor(errors, seed), &MotionPlan::default()));
    let output = calibrate(
        folder.path(),
        &log,
        &["--level", "5", "--place", "55.79,12.52", "--date", "2026-07-01"],
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();

    truth::assert_near(&errors, &found["parameters"]);

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
    let hand = MotionPlan { turning_s: 2.0, ..MotionPlan::default() };
    let short = record(sensor(errors(SYMMETRIC), 4), &hand);
    assert_refused(&short, &[], "of all directions");
    assert_refused(&short[..1200], &["--only", "acc"], "all six faces");
    let trembling = MotionPlan { tremble_rad_s: 0.08, ..hand };
    let moved = record(sensor(errors(SYMMETRIC), 4), &trembling);
    assert_refused(&moved, &["--only", "gyr"], "it moved during the rest");
    let mut mirrored = short;
    for sample in &mut mirrored {
        sample.gyr[1] = -sample.gyr[1];
    }
    assert_refused(&mirrored, &["--only", "gyr,acc"], "disagree about the axes");
}
