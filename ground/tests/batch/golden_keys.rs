//! Golden keys of `--json`: every command prints the keys that are stored in `golden/keys/`. How a
//! change is taken over stands in `running/keys.rs`.

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::thread;

use crate::running::keys::{self, check_all};
use crate::running::{self, Running};

/// What is run without a vehicle, `--json` behind it, in one folder.
const ALONE: &[(&str, &str)] = &[
    ("fly", "fly --start 0.4 --faults rough_flight.toml --servo-supply 4.8"),
    ("fly-drone2", "fly --vehicle drone2 --start 0.2"),
    ("fly-rocket", "fly --vehicle rocket"),
    ("fly-recording", "fly --recording walk.imuq"),
    ("bringup", "bringup --rig"),
    ("model-simulate", "model simulate pendulum.toml"),
    ("model-linear", "model linear"),
    ("model-margins", "model margins --dispersed 2"),
    ("tune", "tune --generations 0 --flights 1"),
    ("tune-rocket", "tune --vehicle rocket --generations 0"),
    ("montecarlo", "montecarlo -n 6 --lateral-mm 5 --out runs.csv"),
    ("montecarlo-merge", "montecarlo merge runs.csv"),
    ("montecarlo-rerun", "montecarlo rerun report/montecarlo/worst-1.toml"),
    ("fuse", "fuse walk.imuq"),
    ("fuse-6d", "fuse walk.imuq --mode 6d"),
];

/// What is run at one vehicle, in this order; without a name it only prepares what follows.
const AT_A_VEHICLE: &[(&str, &str)] = &[
    ("monitor", "monitor --every 0.2 --seconds 0.3"),
    ("param-list", "param list"),
    ("param-get", "param get PID_KP PID_KD"),
    ("param-set", "param set PID_KP 1.25"),
    ("param-diff", "param diff"),
    ("param-dump", "param dump"),
    ("", "param dump gains.param"),
    ("param-reset", "param reset PID_KP"),
    ("param-load", "param load gains.param"),
    ("param-save", "param save"),
    ("info", "info"),
    ("arm", "arm"),
    ("release", "release --yes --seconds 0.5"),
    ("disarm", "disarm"),
    // Together they have a release, a hold and a sweep.
    ("test", "test step --seconds 1 --log step.tlog"),
    ("record-last", "record release.csv --last"),
    ("support", "support support.zip"),
    ("record", "record record.tlog --seconds 1 --csv record.csv"),
    // Long enough that on a slow machine, too, the vehicle's own clock sees two seconds.
    ("test", "test hold --seconds 12 --log hold.tlog"),
    ("test", "test chirp --seconds 6"),
    ("reboot", "reboot"),
];

/// What is run on the logs of the vehicle.
const ON_ITS_LOGS: &[(&str, &str)] = &[
    ("report", "report hold.tlog"),
    ("report-several", "report step.tlog hold.tlog --out both.html"),
    ("log-info", "log info step.tlog"),
    ("log-cut", "log cut step.tlog part.tlog --release 1"),
    ("log-recover", "log recover step.tlog whole.mcap"),
    ("replay", "replay step.tlog"),
    ("replay-changed", "replay step.tlog --param SFC_GAIN_S=0.1 --filter madgwick --offline"),
    ("log-convert", "log convert step.tlog step.csv"),
    ("log-convert", "log convert step.tlog step.mcap"),
    ("identify", "identify step.csv"),
    ("identify", "identify step.tlog --out drone.toml"),
    ("model-what-if", "model what-if step.tlog --vehicle drone.toml --param SFC_GAIN_S=0.1"),
];

/// What is compared by a test of its own, mostly one that runs it for other reasons.
const ELSEWHERE: &[(&str, &str)] = &[
    ("info-ports", "info --ports"),
    ("calibrate", "calibrate"),
    ("calibrate-from", "calibrate --from"),
    ("calibrate-servo", "calibrate servo"),
    ("calibrate-polarity", "calibrate polarity"),
    ("calibrate-hold", "calibrate hold"),
];

/// One at a time: an image in the making would slow the rig down.
static TURN: Mutex<()> = Mutex::new(());

#[test]
fn no_command_with_json_is_without_its_keys() {
    keys::assert_complete(&[ALONE, AT_A_VEHICLE, ON_ITS_LOGS, ELSEWHERE].concat(), 25);
}

/// Two seconds out of the recording, the first of its movement with some rest before.
fn write_short_recording(to: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let recording = std::fs::read(root.join("tests/data/broad_11_cut.imuq")).unwrap();
    // 64 bytes of header with the number of samples at 8, and 28 bytes a sample.
    let (header, samples) = recording.split_at(64);
    let mut short = header.to_vec();
    short[8..12].copy_from_slice(&600_u32.to_le_bytes());
    short.extend(&samples[28 * 3300..28 * 3900]);
    std::fs::write(to, short).unwrap();
}

#[test]
fn what_is_run_without_a_vehicle_keeps_its_keys() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let scenarios = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    for (from, to) in [
        ("rough_flight.toml", "rough_flight.toml"),
        ("gravity_only_pendulum.toml", "pendulum.toml"),
    ] {
        std::fs::copy(scenarios.join(from), folder.path().join(to)).unwrap();
    }
    write_short_recording(&folder.path().join("walk.imuq"));
    let of_one_campaign = |a: &(&str, &str), b: &(&str, &str)| {
        a.0.starts_with("montecarlo") && b.0.starts_with("montecarlo")
    };
    let place = folder.path();
    let differences = thread::scope(|scope| {
        let start = |part| scope.spawn(move || check_all(place, part, &[]));
        let parts: Vec<_> = ALONE.chunk_by(of_one_campaign).map(start).collect();
        parts.into_iter().flat_map(|part| part.join().unwrap()).collect::<Vec<_>>()
    });
    assert!(differences.is_empty(), "{}", differences.join("\n"));
}

#[test]
fn what_is_run_at_a_vehicle_and_on_its_logs_keeps_its_keys() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("nano");
    let port = port.to_str().unwrap();
    let (_rig, _) = Running::start(&[
        "rig",
        "--pty",
        "--seconds",
        "600",
        "--speed",
        "5",
        "--tilt",
        "0.3",
        "--link",
        port,
    ]);
    let mut differences = check_all(folder.path(), AT_A_VEHICLE, &["--port", port]);
    differences.extend(check_all(folder.path(), ON_ITS_LOGS, &[]));
    assert!(differences.is_empty(), "{}", differences.join("\n"));
}

/// A machine without a serial port has nothing to show but the key of the list itself.
#[test]
fn ports_have_their_keys() {
    let object = running::json(&running::tvc(&["info", "--ports", "--json"]));
    match object["ports"].as_array().map(Vec::len) {
        Some(0) => assert_eq!(object, serde_json::json!({ "ports": [] })),
        _ => keys::assert_keys("info-ports", &object),
    }
}
