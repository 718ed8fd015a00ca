//! `tvc model` as scripts and people meet it.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::running;

fn tvc(arguments: &[&str]) -> Output {
    running::tvc(&[&["model"], arguments].concat())
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
    let rows =
        lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
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
        if path.ends_with("faults.toml") || path.ends_with("rough_flight.toml") {
            // For `tvc fly --faults`, flown in the tests of the command line.
            continue;
        }
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
    let output =
        tvc(&["simulate", text(&at_root("scenarios/thrust_and_torque.toml")), "--dt", "0.5"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("t,theta0,") && text.lines().count() == 6);
}

/// Runs a command with `--json` and a report, and gives the object and the report's text.
fn json_and_report(arguments: &[&str]) -> (serde_json::Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.html");
    let mut all = arguments.to_vec();
    all.extend(["--json", "--report", text(&report)]);
    let output = tvc(&all);
    assert!(output.status.success(), "{output:?}");
    let object = serde_json::from_slice(&output.stdout).unwrap();
    (object, std::fs::read_to_string(report).unwrap())
}

fn near(value: &serde_json::Value, expected: f64, tolerance: f64) {
    let found = value.as_f64().unwrap();
    assert!((found - expected).abs() <= tolerance, "{found} {expected}");
}

#[test]
fn linear_gives_the_reference_model_and_margins() {
    // The reference's servo is stiff.
    let folder = tempfile::tempdir().unwrap();
    let stiff = folder.path().join("stiff.toml");
    std::fs::write(&stiff, "[servo]\npreset = \"S3003\"\ndroop = 0").unwrap();
    let (object, page) = json_and_report(&["linear", "--vehicle", text(&stiff)]);
    near(&object["A"][1][0], -0.0028, 5e-5);
    near(&object["A"][1][2], -26.162, 5e-4);
    near(&object["A"][3][0], 0.292, 5e-4);
    near(&object["A"][3][2], -565.75, 5e-3);
    near(&object["B"][1], -14.316, 5e-4);
    near(&object["B"][3], 1485.2, 5e-2);
    assert_eq!(object["C"], serde_json::json!([1.0, 0.0, 0.0, 0.0]));
    assert_eq!(object["D"], 0.0);
    for part in ["controllability", "observability"] {
        assert_eq!(object[part]["rank"], 4);
    }
    let largest = |key: &str| {
        let values = object[key].as_array().unwrap();
        values.iter().map(|z| z["im"].as_f64().unwrap()).fold(0.0, f64::max)
    };
    assert!((largest("poles") - 23.79).abs() < 0.006);
    assert!((largest("zeros") - 57.27).abs() < 0.006);
    let margins = &object["loop"]["margins"];
    near(&margins["gain_margin_db"], 13.1, 0.06);
    near(&margins["gain_margin_at_rad_s"], 28.4, 0.5);
    near(&margins["phase_margin_deg"], 42.7, 0.06);
    near(&margins["delay_margin_s"], 0.077, 6e-4);
    assert_eq!(object["loop"]["stable"], true);
    assert!(page.matches("<svg").count() >= 6);
}

#[test]
fn linear_takes_servo_gains_point_and_parameter_file() {
    let (digital, _) = json_and_report(&["linear", "--servo", "digital"]);
    near(&digital["loop"]["margins"]["phase_margin_deg"], 50.7, 0.06);
    let (hot, _) = json_and_report(&["linear", "--gains", "6,1.8"]);
    assert_eq!(hot["loop"]["stable"], false);
    let (held, _) = json_and_report(&["linear", "--preset", "thesis_text", "--at", "0.2"]);
    assert_eq!(held["point"]["equilibrium"], true);
    near(&held["point"]["theta1_rad"], 0.2, 0.0);
    assert!(held["point"]["theta0_rad"].as_f64().unwrap() < -0.5);
    let (askew, _) = json_and_report(&["linear", "--at", "0.3"]);
    assert_eq!(askew["point"]["equilibrium"], false);
    let (pitched, _) = json_and_report(&["linear", "--preset", "THESIS_TEXT", "--pitch", "0.3"]);
    near(&pitched["point"]["theta0_rad"], 0.3, 0.0);

    let folder = tempfile::tempdir().unwrap();
    let params = folder.path().join("p.toml");
    std::fs::write(&params, "[drone]\nthrust_n = 15\n[timing]\npreset = \"DIGITAL\"").unwrap();
    let (weak, _) = json_and_report(&["linear", "--vehicle", text(&params)]);
    near(&weak["loop"]["kp"], 1.6, 0.0);
    near(&weak["A"][1][2], -13.08, 0.01);
}
