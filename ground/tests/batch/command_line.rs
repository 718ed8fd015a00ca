//! The tool as scripts and people meet it: exit status, one line for what was wrong, data apart
//! from messages.

use std::path::Path;

use crate::running::{self, object, tvc};

/// A sensor that resets at 1.2 s ends in failsafe; the same flight stays active without that.
#[test]
fn faults_come_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("fly.html");
    let report = report.to_str().unwrap();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/faults.toml");
    let shipped = shipped.to_str().unwrap();
    let output = tvc(&["fly", "--json", "--start", "0.4", "--faults", shipped, "--report", report]);
    assert_eq!(output.status.code(), Some(1));
    let flight: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(flight["runs"][0]["stayed_active"], false);
    assert_eq!(flight["faults"][1]["kind"], "config-reset");
    assert_eq!(flight["faults"][1]["at_s"], 1.2);
}

/// Faults with their strengths, and disturbances; an option counts before the file.
#[test]
fn a_rough_flight_comes_from_a_file_and_stays_in_control() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("fly.html");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/rough_flight.toml");
    let output = tvc(&[
        "fly",
        "--json",
        "--start",
        "0.4",
        "--servo-supply",
        "4.8",
        "--faults",
        shipped.to_str().unwrap(),
        "--report",
        report.to_str().unwrap(),
    ]);
    let flight = object(&output);
    assert_eq!(flight["runs"][0]["stayed_active"], true);
    assert_eq!(flight["faults"][0]["probability"], 0.001);
    assert_eq!(flight["faults"][1]["stretch_ms"], 2.0);
    let disturbances = &flight["disturbances"];
    assert_eq!(disturbances["servo_supply"]["volts"], 4.8);
    assert_eq!(disturbances["vibration"]["acc_m_s2"], 2.0);
    assert_eq!(disturbances["temperature"]["to_c"], 40.0);
    assert_eq!(disturbances["thrust_ramp"]["seconds"], 0.3);
}

/// A drone that pitches under a growing thrust rises later; one that shakes stays in control.
#[test]
fn a_disturbed_flight_says_what_disturbed_it() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("fly.html");
    let fly = |options: &[&str]| -> serde_json::Value {
        let path = report.to_str().unwrap();
        let common = ["fly", "--json", "--start", "0.4", "--report", path];
        object(&tvc(&[&common, options].concat()))
    };
    let (calm, shaken) = (fly(&[]), fly(&["--vibration", "5,180", "--thrust-ramp", "10,0.5"]));
    assert!(calm.get("disturbances").is_none());
    let said = &shaken["disturbances"];
    assert_eq!(said["vibration"]["frequency_hz"], 180.0);
    assert_eq!(said["thrust_ramp"]["from_pct"], 10.0);
    assert!(said.get("servo_supply").is_none());
    let rise_s = |flight: &serde_json::Value| flight["runs"][0]["rise_s"].as_f64().unwrap();
    assert!(rise_s(&shaken) > rise_s(&calm) + 0.03);
    assert_eq!(shaken["runs"][0]["stayed_active"], true);
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("propeller vibration"));
}

#[test]
fn gains_and_drone_come_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| -> String {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let report = file("fly.html", "");
    let fly = |options: &[&str]| -> (f64, f64) {
        let common = ["fly", "--json", "--start", "0.4", "--report", &report];
        let output = tvc(&[&common, options].concat());
        let flight: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let run = &flight["runs"][0];
        let figure = |name: &str| run[name].as_f64().unwrap();
        (figure("rise_s"), figure("overshoot_pct"))
    };
    let (rise_s, overshoot_pct) = fly(&[]);
    let calm = file("calm.param", "SFC_CURVE 0.4\n");
    assert!(fly(&["--params", &calm]).0 > rise_s + 0.05);
    let heavy = file("heavy.toml", "[drone]\nbody_inertia_kg_m2 = 0.2\n");
    assert!(fly(&["--vehicle", &heavy]).1 > overshoot_pct + 10.0);
}

#[test]
fn a_flight_as_json_is_one_object_and_the_same_seed_gives_the_same_flight() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("fly.html");
    let fly = || {
        let report = report.to_str().unwrap();
        object(&tvc(&["fly", "--json", "--start", "0.4", "--seed", "3", "--report", report]))
    };
    let (one, two) = (fly(), fly());
    for (part, keys) in [
        ("image", &["flash_bytes", "static_ram_bytes", "stack_high_water_bytes"][..]),
        (
            "loop",
            &[
                "rate_hz",
                "jitter_us_max",
                "cycles_per_step_mean",
                "cycles_per_step_max",
                "cpu_load",
            ],
        ),
        ("latency_us", &["mean", "max"]),
        ("telemetry", &["messages", "lost", "crc_errors"]),
        ("emulation", &["simulated_s", "wall_s", "real_time_factor", "busy_real_time_factor"]),
    ] {
        for key in keys {
            assert!(one[part][key].is_number(), "{part}.{key} in {one}");
        }
    }
    let run = &one["runs"][0];
    for key in ["start_rad", "overshoot_pct", "rise_s", "settling_5pct_s", "final_error_rad"] {
        assert!(run[key].is_number(), "{key} in {run}");
    }
    for part in ["image", "loop", "latency_us", "telemetry", "runs"] {
        assert_eq!(one[part], two[part]);
    }
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("<svg") && page.contains("Step responses"));
}

#[cfg(unix)]
#[test]
fn a_reader_who_leaves_is_no_error() {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;

    let scenario =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/gravity_only_pendulum.toml");
    let mut process = running::command(&["model", "simulate", scenario.to_str().unwrap()])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = String::new();
    let mut out = BufReader::with_capacity(64, process.stdout.take().unwrap());
    out.read_line(&mut first).unwrap();
    drop(out);
    let end = process.wait_with_output().unwrap();
    assert!(first.contains(','), "{first}");
    assert_eq!(String::from_utf8_lossy(&end.stderr), "");
    assert!(end.status.code().is_none(), "{}", end.status);
}

#[test]
fn a_configuration_gives_defaults_and_its_errors_have_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let output = running::command(arguments)
            .current_dir(folder.path())
            .env("XDG_CONFIG_HOME", folder.path().join("own"))
            .output()
            .unwrap();
        (output.status.code(), running::said(&output))
    };
    let own = folder.path().join("own/tvc");
    std::fs::create_dir_all(&own).unwrap();
    std::fs::write(own.join("config.toml"), "port = \"/dev/no-such-own\"\n").unwrap();
    let (status, said) = run(&["arm"]);
    assert_eq!(status, Some(2));
    assert!(said.contains("no port /dev/no-such-own"), "{said}");
    let near = folder.path().join("tvc.toml");
    std::fs::write(&near, "port = \"/dev/no-such-near\"\n").unwrap();
    assert!(run(&["arm"]).1.contains("/dev/no-such-near"));
    assert!(run(&["arm", "--port", "/dev/no-such"]).1.contains("no port /dev/no-such;"));
    std::fs::write(&near, "\nprot = 1\n").unwrap();
    let (status, said) = run(&["arm"]);
    assert_eq!(status, Some(2));
    assert!(said.starts_with("error: tvc.toml, line 2: unknown field `prot`"), "{said}");
    assert_eq!(run(&["--help"]).0, Some(0));
}
