//! `lab experiment`: the thesis' figures are explained, and ours meet the requirements.

use std::fs;

use crate::running::keys::assert_keys;
use crate::running::{assert_refused, tvc};

/// The object that is printed, with the status that goes with it, and the report.
fn run(arguments: &[&str]) -> (serde_json::Value, Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.html");
    let output =
        tvc(&[&["experiment"], arguments, &["--json", "--report", report.to_str().unwrap()]]
            .concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let object =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let report = fs::read_to_string(report).unwrap();
    (object, output.status.code(), report)
}

fn number(row: &serde_json::Value, axis: &str, figure: &str) -> f64 {
    row[axis][figure].as_f64().unwrap_or_else(|| panic!("{axis}.{figure} in {row}"))
}

fn combined(object: &serde_json::Value, name: &str) -> f64 {
    let rows = object["estimators"].as_array().unwrap();
    let row = rows.iter().find(|row| row["name"] == name);
    row.unwrap()["combined_rmse_deg"].as_f64().unwrap()
}

#[test]
fn at_rest_ours_stay_and_an_uncorrected_offset_drifts_as_in_the_thesis() {
    let (object, status, report) = run(&["static"]);
    assert_keys("experiment-static", &object);
    assert_eq!((status, &object["met"]), (Some(0), &true.into()), "{object}");
    for row in object["estimators"].as_array().unwrap() {
        let sum: f64 = ["roll", "pitch", "yaw"]
            .iter()
            .map(|axis| {
                let (mean, std) = (number(row, axis, "mean_deg"), number(row, axis, "std_deg"));
                assert!((number(row, axis, "rmse_deg") - mean.hypot(std)).abs() < 1e-9);
                mean * mean + std * std
            })
            .sum();
        let combined = row["combined_rmse_deg"].as_f64().unwrap();
        assert!((combined - sum.sqrt()).abs() < 1e-9, "{row}");
        if row["required"] == true {
            assert!(combined <= 0.4, "{row}");
        }
    }
    // 0.0174 deg/s for 600 s are 10.4 deg, 6 deg rms.
    for name in ["integrated gyro", "complementary, thesis"] {
        let rmse = combined(&object, name);
        assert!((4.5..8.0).contains(&rmse), "{name}: {rmse}");
    }
    assert!(report.contains("3.480") && report.matches("<svg").count() > 40);
}

#[test]
fn in_motion_ours_stay_within_the_goal_and_a_late_reference_makes_the_figures_of_the_thesis() {
    let (object, status, _) = run(&["motion", "--gyro-bias", "typical", "--seed", "2"]);
    assert_eq!((status, &object["met"]), (Some(0), &true.into()), "{object}");
    let (late, status, _) = run(&["motion", "--reference-lag", "150"]);
    assert_eq!((status, &late["met"]), (Some(1), &false.into()));
    let rmse = combined(&late, "Mahony");
    assert!((3.8..4.8).contains(&rmse), "{rmse}");
    assert!(!late["missed"].as_array().unwrap().is_empty());
}

#[test]
fn every_option_has_its_effect_and_the_same_seed_the_same_figures() {
    let of = |arguments: &[&str]| run(&[&["motion"], arguments].concat()).0;
    let plain = of(&[]);
    assert_eq!(plain, of(&[]));
    for option in [
        &["--seed", "5"][..],
        &["--gyro-bias", "0.5,-0.5,0.5"],
        &["--gyro-scale", "2"],
        &["--acc-offset", "20,0,0"],
        &["--hard-iron", "5,0,0"],
        &["--soft-iron", "1.1,1,1"],
        &["--vibration", "2"],
        &["--no-noise"],
        &["--warm-up", "0"],
    ] {
        assert_ne!(of(option)["estimators"], plain["estimators"], "{option:?}");
    }
}

#[test]
fn unusable_options_are_refused_in_one_line() {
    for (arguments, part) in [
        (&["static", "--gyro-bias", "1,2"][..], "three numbers"),
        (&["static", "--hard-iron", "a,0,0"], "not a number"),
        (&["motion", "--reference-lag", "5000"], "1000"),
        (&["moving"], "moving"),
        (&[], "a command is missing"),
    ] {
        assert_refused(&[&["experiment"], arguments].concat(), part);
    }
}
