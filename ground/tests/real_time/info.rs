//! What a person does before and around a flight by hand: look, reboot, release.

use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::running::{Running, command, object, said, tvc};

/// A machine that is busy with other tests runs the rig slower than real time.
const PATIENCE: Duration = Duration::from_secs(120);

/// A rig and the path of its port.
fn rig(folder: &tempfile::TempDir, options: &[&str]) -> (Running, String) {
    let link = folder.path().join("nano").to_str().unwrap().to_owned();
    let fixed = ["rig", "--pty", "--seconds", "600", "--link", &link];
    let (rig, _) = Running::start(&[&fixed[..], options].concat());
    (rig, link)
}

#[test]
fn info_names_the_next_thing_to_do_and_who_has_the_port() {
    let folder = tempfile::tempdir().unwrap();
    let (_rig, port) = rig(&folder, &["--blank"]);
    let info = || tvc(&["info", "--json", "--port", &port]);
    let output = info();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let found = object(&output);
    // The rig runs what the tree builds.
    assert_eq!(found["vehicle"]["runs_image"], true, "{found}");
    assert_eq!(found["vehicle"]["polarity_checked"], false);
    assert_eq!(found["standing"], "to-do");
    assert!(found["next"].as_str().unwrap().contains("`tvc calibrate`"), "{found}");

    if cfg!(target_os = "linux") {
        let mut monitor = command(&["monitor", "--json", "--port", &port]);
        let (monitor, _) = Running::of(monitor.stderr(Stdio::null()));
        let output = info();
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        let found = object(&output);
        assert_eq!(found["port"]["held_by"][0]["id"], monitor.0.id(), "{found}");
        assert!(found["vehicle"].is_null() && found["standing"] == "unreachable");
        // Every other command says the same.
        let output = tvc(&["arm", "--port", &port]);
        assert_eq!(output.status.code(), Some(2));
        let holder = format!("(process {}): end that first", monitor.0.id());
        assert!(said(&output).contains(&holder), "{}", said(&output));
    }
    let output = tvc(&["doctor", "--port", "/dev/no-such-port"]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("no port /dev/no-such-port"), "{text}");
}

/// A servo that is as the defaults say is set up once its rudder was seen to answer.
#[test]
fn info_ends_green_where_nothing_is_left_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let (_rig, port) = rig(&folder, &["--tilt", "0.2"]);
    for (name, value) in [
        ("CAL_ACC_OX", "0.001"),
        ("CAL_GYR_OX", "0.001"),
        ("CAL_MAG_OX", "0.001"),
        ("MNT_PITCH_DEG", "0.001"),
        ("SRV_POLARITY", "2"),
        ("SRV_POLARITY", "1"),
    ] {
        let set = tvc(&["param", "set", name, value, "--port", &port]);
        assert!(set.status.success(), "{}", said(&set));
    }
    let begun = Instant::now();
    loop {
        let output = tvc(&["info", "--json", "--port", &port]);
        let found = object(&output);
        let calibrated = found["vehicle"]["calibrated"].as_array().unwrap();
        assert!(calibrated.contains(&"servo".into()), "{found}");
        if output.status.success() {
            assert_eq!(found["standing"], "well", "{found}");
            break;
        }
        let next = found["next"].as_str().unwrap();
        assert!(next.contains("arming would be refused"), "{found}");
        assert!(begun.elapsed() < PATIENCE, "{found}");
    }
}

#[test]
fn a_release_by_hand_needs_an_armed_vehicle_and_ends_disarmed() {
    let folder = tempfile::tempdir().unwrap();
    let (_rig, port) = rig(&folder, &["--tilt", "0.2"]);
    let ask = |arguments: &[&str]| tvc(&[arguments, &["--json", "--port", &port]].concat());
    let release = || ask(&["release", "--yes", "--seconds", "1"]);
    let refused = release();
    assert_eq!(refused.status.code(), Some(1));
    assert!(said(&refused).contains("`tvc arm` first"), "{}", said(&refused));
    let begun = Instant::now();
    while !ask(&["arm"]).status.success() {
        assert!(begun.elapsed() < PATIENCE);
    }
    // Nobody can be asked.
    assert_eq!(ask(&["release"]).status.code(), Some(2));
    let released = release();
    assert_eq!(released.status.code(), Some(0), "{}", said(&released));
    assert!(object(&released)["seconds"].as_f64().unwrap() >= 1.0);
    let standby = ask(&["info"]);
    assert_eq!(object(&standby)["vehicle"]["state"], "standby");
    // What it changed for its time is as it was.
    let watch = object(&ask(&["param", "get", "FS_HOST"]));
    assert_eq!(watch["parameters"][0]["value"], 0.0);

    assert_eq!(object(&ask(&["reboot"]))["restarting"], true);
    let again = object(&ask(&["info"]))["vehicle"]["ready"].clone();
    assert_eq!(again, false, "it is not ready right after a start");
}
