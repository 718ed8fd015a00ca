//! Every command that talks to a vehicle, against the virtual rig behind its pseudo-terminal.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::running::{self, object};
use crate::vehicle::{PATIENCE, Rig};

#[test]
fn parameters_are_listed_set_refused_compared_and_loaded() {
    let rig = Rig::start(&["--blank"]);
    let list = rig.json(&["param", "list"]);
    let rows = list["parameters"].as_array().unwrap();
    assert_eq!(rows.len(), tvc_nano::Params::count());
    for row in rows {
        // The vehicle takes this one over from USB by itself.
        if row["name"] != "CLK_FINE" {
            assert_eq!(row["value"], row["default"], "{row}");
        }
        assert!(!row["meaning"].as_str().unwrap().is_empty(), "{row}");
    }
    rig.ok(&["param", "diff"]);

    rig.ok(&["param", "set", "PID_KP", "1.25"]);
    let got = rig.json(&["param", "get", "PID_KP", "PID_KD"]);
    assert_eq!(got["parameters"][0]["value"], 1.25);
    let diff = rig.tvc(&["param", "diff"]);
    assert_eq!(diff.status.code(), Some(1));
    assert!(String::from_utf8(diff.stdout).unwrap().contains("PID_KP"));

    let said = rig.refused(2, &["param", "set", "PID_KP", "11"]);
    assert!(said.contains("PID_KP must be 0 to 10"), "{said}");
    assert!(said.contains("stays at 1.25"), "{said}");
    let said = rig.refused(2, &["param", "set", "NO_SUCH", "1"]);
    assert!(said.contains("NO_SUCH"), "{said}");

    let file = rig.path("gains.parm");
    let dumped = rig.json(&["param", "dump", &file]);
    assert_eq!(dumped["parameters"].as_array().unwrap().len(), rows.len());
    let columns = rig.path("gains.params");
    rig.ok(&["param", "dump", &columns]);
    let text = std::fs::read_to_string(&columns).unwrap();
    assert!(text.contains("\n1\t1\tPID_KP\t1.25\t9\n"), "{text}");
    rig.ok(&["param", "set", "PID_KP", "2"]);
    rig.ok(&["param", "load", &columns]);
    rig.ok(&["param", "diff", &file]);
    rig.ok(&["param", "set", "PID_KP", "2"]);
    rig.ok(&["param", "load", &file]);
    rig.ok(&["param", "diff", &columns]);
    assert_eq!(rig.json(&["param", "get", "PID_KP"])["parameters"][0]["value"], 1.25);

    assert_eq!(rig.json(&["param", "save"])["saved"], true);

    rig.ok(&["param", "set", "PID_KD", "0.4"]);
    let reset = rig.json(&["param", "reset", "PID_KD"]);
    assert_eq!(reset["changed"], 1, "{reset}");
    assert_eq!(rig.tvc(&["param", "diff"]).status.code(), Some(1));
    // PID_KP, and not what the vehicle has taken over from USB by itself.
    let reset = rig.json(&["param", "reset"]);
    assert_eq!(reset["changed"], 1, "{reset}");
    let gain = rig.json(&["param", "get", "PID_KP"])["parameters"][0].clone();
    assert_eq!(gain["value"], gain["default"]);
    rig.ok(&["param", "reset", "--stored"]);
    rig.ok(&["param", "diff", &file]);
    let said = rig.refused(2, &["param", "reset", "NO_SUCH"]);
    assert!(said.contains("NO_SUCH"), "{said}");
    rig.refused(2, &["param", "reset", "PID_KP", "--stored"]);

    let other = rig.path("other.parm");
    std::fs::write(&other, "PID_KD 0.3\nNO_SUCH 1\n").unwrap();
    let said = rig.refused(2, &["param", "load", &other]);
    assert!(said.contains("NO_SUCH") && said.contains("nothing was"), "{said}");
    let loaded = rig.json(&["param", "load", &other, "--skip-unknown"]);
    assert_eq!(loaded["changed"], 1, "{loaded}");
    rig.ok(&["param", "reset", "PID_KD"]);

    // That somebody saw the rudder answer is true of one drone as it stood.
    let other_drone = rig.path("other_drone.parm");
    std::fs::write(&other_drone, "SRV_DIR -1\nMNT_YAW_DEG 90\nSRV_POLARITY 1\n").unwrap();
    let output = rig.tvc(&["param", "load", &other_drone]);
    let said = running::said(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("tvc calibrate polarity"), "{said}");
    assert_eq!(running::said(&rig.tvc(&["param", "diff", &other_drone])).lines().count(), 1);
    let polarity = rig.json(&["param", "get", "SRV_POLARITY"]);
    assert_eq!(polarity["parameters"][0]["value"], 0.0);
    assert!(rig.refused(1, &["arm"]).contains("polarity"));
    let text = rig.ok(&["param", "dump"]);
    let line = text.lines().find(|line| line.contains("SRV_POLARITY"));
    assert!(line.unwrap().starts_with("# SRV_POLARITY"), "{text}");
    rig.ok(&["param", "reset", "SRV_DIR", "MNT_YAW_DEG"]);

    // A gain of another law is set, and said to do nothing.
    let set = rig.tvc(&["param", "set", "PID_KI", "0.1"]);
    assert!(running::said(&set).contains("not used by law 2"));
    assert!(running::said(&rig.tvc(&["param", "set", "SFC_GAIN_S", "0.6"])).is_empty());
    let list = rig.ok(&["param", "list"]);
    let first: Vec<&str> = list.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(first[1..3], ["PID_LAW", "PID_TRIM_RAD_S"], "{list}");
    rig.ok(&["param", "reset", "PID_KI", "SFC_GAIN_S"]);

    let bad = rig.path("bad.parm");
    std::fs::write(&bad, "PID_KD 0.1\nPID_KP 99\n").unwrap();
    let said = rig.refused(2, &["param", "load", &bad]);
    assert!(said.contains("line 2"), "{said}");
    assert_ne!(rig.json(&["param", "get", "PID_KD"])["parameters"][0]["value"], 0.1);
}

#[test]
fn a_vehicle_out_of_the_box_says_what_to_do_before_it_is_armed() {
    let rig = Rig::start(&["--blank"]);
    rig.wait_for("standby");
    let said = rig.refused(1, &["arm"]);
    assert!(said.contains("run tvc calibrate polarity first"), "{said}");
    let said = rig.refused(1, &["test", "step"]);
    assert!(said.contains("run tvc calibrate polarity first"), "{said}");
    let output = rig.tvc(&["test", "step", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let object: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["releases"], 0, "{object}");
    let error = object["error"].as_str().unwrap();
    assert!(error.contains("run tvc calibrate polarity"), "{object}");
    // Any MAVLink client can say that it was done, but not as a file of parameters says it.
    let said = rig.refused(2, &["param", "set", "SRV_POLARITY", "1"]);
    assert!(said.contains("set 2 and look at the rudder first"), "{said}");
    rig.ok(&["param", "set", "SRV_POLARITY", "2"]);
    rig.ok(&["param", "set", "SRV_POLARITY", "1"]);
    assert_eq!(rig.arm()["state"], "armed");
}

#[test]
fn it_arms_disarms_is_watched_and_recorded() {
    let rig = Rig::start(&["--tilt", "0.3"]);
    rig.wait_for("standby");
    let status = rig.status();
    let pitch = status["attitude_rad"][1].as_f64().unwrap();
    assert!((pitch - 0.3).abs() < 0.03, "{status}");
    assert_eq!(status["armed"], false);
    assert_eq!((&status["lost"], &status["crc_errors"]), (&0.into(), &0.into()));

    assert_eq!(rig.arm()["state"], "armed");
    assert_eq!(rig.status()["armed"], true);
    let said = rig.refused(2, &["param", "set", "SRV_DIR", "-1"]);
    assert!(said.contains("disarm first"), "{said}");
    assert_eq!(rig.json(&["disarm"])["state"], "standby");

    let (log, table) = (rig.path("flight.tlog"), rig.path("flight.csv"));
    rig.ok(&["record", &log, "--csv", &table, "--seconds", "2"]);
    let rows = std::fs::read_to_string(&table).unwrap();
    assert!(rows.lines().count() > 20, "{}", rows.lines().count());
    assert!(std::fs::metadata(&log).unwrap().len() > 5_000);
    let said = rig.refused(2, &["record", &log, "--seconds", "1"]);
    assert!(said.contains("is there already"), "{said}");
}

#[test]
fn a_reader_who_leaves_ends_the_monitor_quietly() {
    let rig = Rig::start(&[]);
    let log = rig.path("watched.tlog");
    let mut monitor = running::command(&["monitor", "--json", "--every", "0.2", "--log", &log])
        .args(["--port", &rig.path("nano")])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(monitor.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let status: Value = serde_json::from_str(&line).unwrap();
    let end = monitor.wait_with_output().unwrap();
    assert_eq!(String::from_utf8_lossy(&end.stderr), "");
    assert!(end.status.code().is_none(), "{}", end.status);
    // What was heard until then is in the log.
    let logged = std::fs::metadata(&log).unwrap().len();
    assert!(logged > 20 * status["messages"].as_u64().unwrap(), "{logged}");
}

/// Status and standard output of a command without a vehicle.
fn tvc(arguments: &[&str]) -> (Option<i32>, String) {
    let output = running::tvc(arguments);
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

#[test]
fn a_release_is_measured_reported_and_replayed_bit_for_bit() {
    let rig = Rig::start(&["--tilt", "0.3"]);
    rig.wait_for("standby");
    let said = rig.refused(2, &["record", "--last", &rig.path("early.csv")]);
    assert!(said.contains("no release"), "{said}");
    let (log, page) = (rig.path("step.tlog"), rig.path("step.html"));
    let output =
        rig.tvc(&["test", "step", "--seconds", "2", "--log", &log, "--report", &page, "--json"]);
    let figures = object(&output);
    let run = &figures["runs"][0];
    assert_eq!(run["stayed_active"], true, "{run}");
    assert!(run["settling_5pct_s"].as_f64().unwrap() < 1.5, "{run}");
    assert!(run["overshoot_pct"].as_f64().unwrap() < 30.0, "{run}");
    assert_eq!(figures["telemetry"]["lost"], 0);
    let jitter_us = figures["loop"]["jitter_us_max"].as_f64().unwrap();
    assert!(jitter_us < 100.0, "{jitter_us}");
    let origin = &figures["origin"];
    assert!(origin["vehicle"].as_str().unwrap().starts_with("0."), "{origin}");
    assert!(origin["tool"].as_str().unwrap().starts_with("tvc 0."), "{origin}");
    assert!(origin["date"].as_str().unwrap().starts_with("20"), "{origin}");
    assert!(std::fs::read_to_string(&page).unwrap().contains("<svg"));

    recorded_as_streamed(&rig, &log);

    let (status, text) = tvc(&["replay", &log, "--json"]);
    assert_eq!(status, Some(0), "{text}");
    let replay: Value = serde_json::from_str(&text).unwrap();
    assert!(replay["compared"].as_u64().unwrap() > 300, "{replay}");
    assert_eq!(replay["equal"], replay["compared"]);
    assert_eq!(replay["refused"], serde_json::json!([]));

    // In the form for Foxglove and PlotJuggler it is the same log.
    let other_form = rig.path("step.mcap");
    assert_eq!(tvc(&["log", "convert", &log, &other_form]).0, Some(0));
    let (status, text) = tvc(&["replay", &other_form, "--json"]);
    assert_eq!(status, Some(0), "{text}");
    assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), replay);

    // Damaged, it is read as far as it goes, or refused in a line.
    let mut damaged = std::fs::read(&other_form).unwrap();
    let bytes = damaged.iter_mut().skip(64).step_by(997);
    bytes.for_each(|byte| *byte ^= 0xFF);
    let path = rig.path("damaged.mcap");
    std::fs::write(&path, damaged).unwrap();
    let output = running::command(&["replay", &path]).output().unwrap();
    assert!(matches!(output.status.code(), Some(0..=2)), "{output:?}");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.lines().all(|line| line.len() < 200), "{said}");

    let (status, text) = tvc(&["replay", &log, "--param", "SFC_GAIN_S=0.1", "--json"]);
    assert_eq!(status, Some(0), "{text}");
    let other: Value = serde_json::from_str(&text).unwrap();
    assert!(other["pulse_difference_us_max"].as_u64().unwrap() > 10, "{other}");

    // Without its middle the log says so, and claims nothing about what comes behind.
    let bytes = std::fs::read(&log).unwrap();
    let cut = rig.path("cut.tlog");
    let (third, two_thirds) = (bytes.len() / 3, bytes.len() / 3 + 2_000);
    std::fs::write(&cut, [&bytes[..third], &bytes[two_thirds..]].concat()).unwrap();
    let (_, text) = tvc(&["replay", &cut, "--json"]);
    let cut: Value = serde_json::from_str(&text).unwrap();
    assert!(cut["lost"].as_u64().unwrap() > 10, "{cut}");
    assert_eq!(cut["gaps_s"].as_array().unwrap().len(), 1, "{cut}");
    assert!(cut["compared"].as_u64() < replay["compared"].as_u64(), "{cut}");
    assert_eq!(cut["equal"], cut["compared"]);
}

/// What the vehicle kept of the release is what it sent.
fn recorded_as_streamed(rig: &Rig, log: &str) {
    let [kept, streamed, again] =
        ["burst.csv", "streamed.csv", "burst.tlog"].map(|name| rig.path(name));
    // A machine that is busy runs the rig slowly: the second that is recorded may not be over.
    let begun = Instant::now();
    while !rig.tvc(&["record", "--last", &kept]).status.success() {
        assert!(begun.elapsed() < PATIENCE);
    }
    let told = rig.json(&["record", "--last", &kept]);
    // A release in the same breath as the arming has nothing before it.
    let steps = told["steps"].as_u64().unwrap();
    assert!((170..=200).contains(&steps), "{told}");
    assert_eq!(told["before_release"], steps - 170);
    assert_eq!(tvc(&["log", "convert", log, &streamed]).0, Some(0));
    let rows = |path: &str| -> Vec<Vec<String>> {
        let text = std::fs::read_to_string(path).unwrap();
        let rows = text.lines().skip(1);
        rows.map(|row| row.split(',').map(str::to_owned).collect()).collect()
    };
    let streamed = rows(&streamed);
    let kept = rows(&kept);
    assert_eq!(kept.len() as u64, steps);
    for row in &kept {
        let same = streamed.iter().find(|other| other[0] == row[0]);
        let other = same.unwrap_or_else(|| panic!("{row:?} was not streamed"));
        assert_eq!(row[3..13], other[3..13], "counts");
        assert_eq!(row[17..22], other[17..22], "rates, command and pulse");
        for (kept, told) in row[13..17].iter().zip(&other[13..17]) {
            let [kept, told] = [kept, told].map(|text| text.parse::<f32>().unwrap());
            assert!((kept - told).abs() < 2e-4, "{kept} {told}");
        }
    }
    rig.ok(&["record", "--last", &again]);
    let (_, text) = tvc(&["report", &again, "--json"]);
    let figures: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(figures["runs"].as_array().unwrap().len(), 1, "{text}");
    assert_eq!(figures["loop"]["steps"], steps);
}

/// A rudder that answers the wrong way pushes the drone over.
#[test]
fn a_test_that_ends_in_a_fall_still_tells_what_it_has_seen() {
    let rig = Rig::start(&["--tilt", "0.3"]);
    rig.wait_for("standby");
    rig.ok(&["param", "set", "SRV_DIR", "-1"]);
    for polarity in ["2", "1"] {
        rig.ok(&["param", "set", "SRV_POLARITY", polarity]);
    }
    let (log, page) = (rig.path("fall.tlog"), rig.path("fall.html"));
    let output = rig.tvc(&["test", "step", "--json", "--log", &log, "--report", &page]);
    let said = running::said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let object: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["releases"], 1, "{object}");
    assert_eq!(object["met"], false, "{object}");
    let missed = object["missed"].as_array().unwrap();
    assert!(missed.contains(&"runs[0].stayed_active".into()), "{object}");
    let error = object["error"].as_str().unwrap();
    assert!(error.starts_with("the vehicle gave up: "), "{object}");
    assert!(said.lines().last().unwrap().ends_with(error), "{said}");
    assert!(std::fs::read_to_string(&page).unwrap().contains("Release 1"));
}

#[test]
fn a_rig_that_is_told_to_end_leaves_nothing_behind_and_who_listens_is_told() {
    let mut rig = Rig::start(&[]);
    let port = rig.path("nano");
    let monitor = running::command(&["monitor", "--json", "--every", "0.1", "--port", &port])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(2));
    rig.terminate();
    assert_eq!(rig.running.0.wait().unwrap().code(), Some(0));
    assert!(!PathBuf::from(rig.path("nano")).is_symlink());
    let output = monitor.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("went away"), "{said}");
    let said = rig.refused(2, &["arm"]);
    assert!(said.contains("no port"), "{said}");
}

#[test]
fn a_port_without_a_vehicle_is_said_to_be_one() {
    let pty = rig::pty::Pty::open().unwrap();
    let output = running::tvc(&["param", "list", "--port", pty.path().to_str().unwrap()]);
    let said = running::said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("no heartbeat on") && said.contains("tvc info --ports"), "{said}");
}

/// What can be shown is.
#[test]
fn a_vehicle_of_another_firmware_is_said_to_be_one_and_watched_all_the_same() {
    use client::Wire;
    use mavlink::dialects::common::{
        ATTITUDE_QUATERNION_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage,
    };
    use std::sync::atomic::{AtomicBool, Ordering};

    let pty = rig::pty::Pty::open().unwrap();
    let path = pty.path().to_str().unwrap().to_owned();
    let over = AtomicBool::new(false);
    let output = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut wire = Wire::default();
            while !over.load(Ordering::Relaxed) {
                let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                    autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
                    ..HEARTBEAT_DATA::default()
                });
                let attitude = MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                    q1: 1.0,
                    ..ATTITUDE_QUATERNION_DATA::default()
                });
                for message in [beat, attitude] {
                    let _ = pty.write(&wire.frame(&message));
                }
                let _ = pty.read();
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        let output = running::tvc(&["monitor", "--json", "--seconds", "1.5", "--port", &path]);
        over.store(true, Ordering::Relaxed);
        output
    });
    let said = running::said(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("no tvc-nano (MAVLink's autopilot 12)"), "{said}");
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(shown.contains("\"attitude_rad\""), "{shown}");
}
