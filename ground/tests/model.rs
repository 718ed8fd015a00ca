//! `tvc model` as scripts and people meet it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn tvc(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tvc"))
        .arg("model")
        .args(arguments)
        .output()
        .unwrap()
}

fn at_root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Columns and rows of a CSV file.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head = lines.next().unwrap().split(',').map(String::from).collect();
    let rows = lines
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
        .collect();
    (head, rows)
}

/// Simulates a shipped scenario and compares every row of its reference trajectory: all nine
/// columns, or the first `columns` of them.
fn reproduces(name: &str, dt: &str, columns: usize, tolerance: f64) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run.csv");
    let scenario = at_root(&format!("scenarios/{name}.toml"));
    let output = tvc(&["simulate", text(&scenario), "--out", text(&out), "--dt", dt]);
    assert!(output.status.success(), "{output:?}");
    assert!(output.stdout.is_empty());
    let (head, rows) = table(&out);
    assert_eq!(head.join(","), "t,theta0,theta1,theta2,theta3,w0,w1,w2,w3");
    assert_eq!(rows[0][0], 0.0);
    let (_, reference) = table(&at_root(&format!("plant/tests/data/{name}.csv")));
    assert!(reference.len() > 60);
    let dt: f64 = dt.parse().unwrap();
    for expected in reference {
        let row = &rows[(expected[0] / dt).round() as usize];
        for (column, (value, expected)) in row.iter().zip(&expected).take(columns).enumerate() {
            assert!(
                (value - expected).abs() <= tolerance,
                "{name}: {} at {} s is {value}, not {expected}",
                head[column],
                row[0]
            );
        }
    }
}

#[test]
fn shipped_scenarios_reproduce_the_reference_trajectories() {
    // The sweep's file has ten digits; the equations are compared to 1e-12 in the model's tests.
    reproduces("constraint_sweep", "0.005", 9, 6e-11);
    reproduces("gravity_only_pendulum", "0.005", 9, 1e-6);
    reproduces("pd_ideal_servo", "0.005", 9, 1e-7);
    // Time, pitch, crank, link and rudder; the reference's first row stands at 0.5 ms.
    reproduces("pd_nominal_S3003_02", "0.0005", 5, 3e-3);
}

#[test]
fn every_shipped_scenario_runs() {
    let mut count = 0;
    for entry in std::fs::read_dir(at_root("scenarios")).unwrap() {
        let path = entry.unwrap().path();
        let output = tvc(&["simulate", text(&path), "--json"]);
        assert!(output.status.success(), "{output:?}");
        let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(object["rows"].as_u64().unwrap() > 100);
        for part in ["first", "last", "least", "most"] {
            assert!(object[part]["theta3"].is_number());
        }
        count += 1;
    }
    assert!(count >= 5);
}

#[test]
fn without_out_the_trajectory_goes_to_standard_output() {
    let output = tvc(&[
        "simulate",
        text(&at_root("scenarios/thrust_and_torque.toml")),
        "--dt",
        "0.5",
    ]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("t,theta0,") && text.lines().count() == 6);
}

/// Status 2, nothing on standard output, one line that names file and key, and no file.
#[test]
fn mistakes_name_the_key_and_the_file_and_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mistake.toml");
    let out = folder.path().join("run.csv");
    for (scenario, key) in [
        ("seconds = 1\n[drone]\nbody_mass_kg = 0", "body_mass_kg"),
        (
            "seconds = 1\n[drone]\nlink_length_m = 0.03",
            "link_length_m",
        ),
        ("seconds = 1\n[drone]\nbody_mass = 1", "`body_mass`"),
        ("seconds = 1\n[drone]\npreset = \"MAPLE\"", "MAPLE"),
        ("seconds = 1\n[drones]\nx = 1", "`drones`"),
        ("seconds = 1\n[input]\ntorque = 1", "`torque`"),
        (
            "seconds = 1\n[input]\ntorque_n_m = [[0, 0], [1, 1], [1, 2]]",
            "torque_n_m",
        ),
        ("seconds = 1\n[input]\ncrank_rad = []", "crank_rad"),
        ("seconds = 1\n[start]\npitch_rad = \"3 kg\"", "pitch_rad"),
        ("dt_s = 1", "seconds"),
        ("seconds = ", "line 1"),
    ] {
        std::fs::write(&path, scenario).unwrap();
        let output = tvc(&["simulate", text(&path), "--out", text(&out)]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{scenario}: {said}");
        assert!(output.stdout.is_empty());
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(
            said.contains("mistake.toml") && said.contains(key),
            "{said}"
        );
        assert!(!out.exists());
    }
    for (arguments, part) in [
        (&["simulate", "no/such.toml"][..], "no/such.toml"),
        (&["simulate", "x.toml", "--dt", "0"], "above zero"),
        (&["simulate", "x.toml", "--dt", "fast"], "--dt"),
    ] {
        let output = tvc(arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(part) && said.lines().count() == 1, "{said}");
    }
}

#[test]
fn help_has_examples() {
    let output = tvc(&["simulate", "--help"]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("Examples:") && text.contains("Exit status:"),
        "{text}"
    );
}
