//! Gains, campaigns and identification from the command line.

use std::path::Path;
use std::process::Output;

use plant::pitch_loop::{Pd, PitchLoop, Timing};
use plant::{Parameters, ServoModel};
use serde_json::Value;

use crate::running;

fn tvc(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = running::command(arguments);
    command.current_dir(folder).output().unwrap()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    running::json(&tvc(folder, arguments))
}

/// Whatever the number of threads and shards, a seed gives the same runs; the worst fly again as
/// they were.
#[test]
fn campaigns_are_the_same_in_one_piece_and_in_shards() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let campaign = ["montecarlo", "-n", "20", "--seed", "3", "--lateral-mm", "5", "--json"];
    let with = |more: &[&'static str]| json(here, &[&campaign[..], more].concat());
    let whole = with(&["--jobs", "1", "--out", "whole.csv"]);
    with(&["--jobs", "3", "--shard", "1/2", "--out", "one.csv", "--worst", "one"]);
    with(&["--jobs", "2", "--shard", "2/2", "--out", "two.csv", "--worst", "two"]);
    let merged =
        json(here, &["montecarlo", "merge", "two.csv", "one.csv", "--out", "merged.csv", "--json"]);
    let read = |name: &str| std::fs::read_to_string(here.join(name)).unwrap();
    assert_eq!(read("merged.csv"), read("whole.csv"));
    assert_eq!(read("whole.csv").lines().count(), 21);
    for key in ["runs", "pass_rate", "pass_rate_low", "pass_rate_high", "overshoot_p95_pct"] {
        assert_eq!(merged[key], whole[key], "{key}");
    }
    let (low, rate, high) =
        (&whole["pass_rate_low"], &whole["pass_rate"], &whole["pass_rate_high"]);
    assert!(low.as_f64() <= rate.as_f64() && rate.as_f64() <= high.as_f64());

    let worst = &whole["worst"][0];
    let again = json(here, &["montecarlo", "replay", worst["file"].as_str().unwrap(), "--json"]);
    for key in ["run", "overshoot_pct", "settling_5pct_s"] {
        assert_eq!(again[key], worst[key], "{key}");
    }
    std::fs::write(here.join("other.csv"), read("one.csv").replace("\n3,s3003", "\n4,s3003"))
        .unwrap();
    let mixed = tvc(here, &["montecarlo", "merge", "one.csv", "other.csv"]);
    assert_eq!(mixed.status.code(), Some(2));
}

/// The analytic start alone, whose figures need no search, as a file that a campaign takes.
#[test]
fn gains_go_from_a_parameter_file_to_a_file_that_campaigns_take() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::write(here.join("heavy.toml"), "[drone]\nbody_inertia_kg_m2 = 0.12\n").unwrap();
    let output = tvc(
        here,
        &[
            &["tune", "--params", "heavy.toml", "--generations", "0", "--flights", "1"][..],
            &["--out", "g.param", "--anyway", "--json"],
        ]
        .concat(),
    );
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["gains"], report["analytic"]);
    assert!(report["gains"]["PITCH_GAIN"].as_f64().unwrap() < 28.0);
    for flights in ["runs", "flown"] {
        assert_eq!(report[flights].as_array().unwrap().len(), 3);
    }
    assert!(report["margins"]["gain_db"].as_f64().unwrap() > 0.0);
    assert_eq!(output.status.success(), report["met"].as_bool().unwrap());
    json(here, &["montecarlo", "-n", "3", "--params", "g.param", "--json"]);
}

/// A drone with 20 % less thrust, flown by the model, is found again.
#[test]
fn a_recorded_release_tells_the_pitch_gain() {
    let folder = tempfile::tempdir().unwrap();
    let drone = Parameters { thrust_n: 24.0, ..Parameters::PHYS };
    let timing = Timing::NANO_50HZ;
    let mut law = Pd::new(1.0, 0.3, &drone.linkage(), timing.control_s);
    let mut flight = PitchLoop::new(&drone, ServoModel::S3003, timing, 0.4, 0.2).unwrap();
    let mut text = String::from("time_s,pitch_rad,rate_rad_s,pulse_us\n");
    for step in 0..2000 {
        let begin_s = 0.5e-3 * f64::from(step);
        let sample = flight.step(|measurement| law.update(measurement));
        // The frame begins with a pulse; readings come 3 ms late.
        if step % 40 == 0 {
            let width = ServoModel::S3003.width_for_crank(sample.command_rad);
            text += &format!("{begin_s},,,{width}\n");
        }
        if step % 20 == 0 {
            let (time_s, pitch, rate) = (sample.time_s + 3e-3, sample.pitch_rad, sample.rate_rad_s);
            text += &format!("{time_s},{pitch},{rate},\n");
        }
    }
    std::fs::write(folder.path().join("log.csv"), text).unwrap();
    let found = json(folder.path(), &["identify", "log.csv", "--out", "found.toml", "--json"]);
    let gain = |key: &str| found["pitch_gain"][key].as_f64().unwrap();
    let truth = 0.8 * gain("nominal");
    assert!((gain("value") / truth - 1.0).abs() < 0.05, "{found}");
    assert!(gain("deviation") > 0.0 && gain("deviation") < gain("prior"));
    let file = std::fs::read_to_string(folder.path().join("found.toml")).unwrap();
    assert!(plant::Setup::parse(&file).is_ok());
}
