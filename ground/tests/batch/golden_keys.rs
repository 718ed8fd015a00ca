//! Golden keys of `--json`: every command prints the keys that are stored in `golden/keys/`. How a
//! change is taken over stands in `running/keys.rs`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::running::keys::{self, difference};
use crate::running::{self, Running, command, commands_below, said};

/// A machine that is busy with other tests runs the rig slower than real time.
const PATIENCE: Duration = Duration::from_secs(120);

/// What a vehicle says that is soon ready.
const VEHICLE_WAITS: [&str; 3] = [
    "attitude still settling",
    "gyro offset unknown",
    "the vehicle holds no release",
];

/// What is run without a vehicle, `--json` behind it, one after the other in one folder.
const ALONE: &[(&str, &str)] = &[
    (
        "fly",
        "fly --start 0.4 --faults rough_flight.toml --servo-supply 4.8",
    ),
    ("fly-drone2", "fly --vehicle drone2 --start 0.2"),
    ("fly-rocket", "fly --vehicle rocket"),
    ("fly-replay", "fly --replay walk.imuq"),
    (
        "faults",
        "faults --runs 2 --kind spikes ram-statics --out faults.csv",
    ),
    ("faults-merge", "faults merge faults.csv"),
    (
        "faults-sound",
        "faults --sound --runs 1 --kind rest --phase standby --servo s3003 --vehicle drone --seconds 1",
    ),
    ("faults-replay", "faults replay run.toml"),
    ("profile", "profile --seconds 0.1"),
    ("profile-after", "profile --after 0.1 --seconds 0.1"),
    ("stack", "stack --seconds 0.1"),
    ("hardware", "hardware --quick --only wake"),
    ("bringup", "bringup --rig --no-hands"),
    ("model-simulate", "model simulate pendulum.toml"),
    ("model-linear", "model linear"),
    ("model-validate", "model validate"),
    ("model-rocket", "model rocket"),
    ("tune", "tune --generations 0"),
    ("tune-rocket", "tune --vehicle rocket --generations 0"),
    ("montecarlo-rocket", "montecarlo --vehicle rocket -n 20"),
    (
        "montecarlo",
        "montecarlo -n 6 --lateral-mm 5 --out runs.csv",
    ),
    ("montecarlo-merge", "montecarlo merge runs.csv"),
    (
        "montecarlo-replay",
        "montecarlo replay report/montecarlo/worst-1.toml",
    ),
    ("fuse", "fuse walk.imuq"),
    ("fuse-6d", "fuse walk.imuq --mode 6d"),
    ("experiment-motion", "experiment motion --reference-lag 150"),
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
    ("recorder", "recorder release.csv"),
    ("record", "record record.tlog --seconds 1 --csv record.csv"),
    // Long enough that on a slow machine, too, the vehicle's own clock sees two seconds.
    ("test", "test hold --seconds 12 --log hold.tlog"),
    ("test", "test chirp --seconds 6"),
    ("reboot", "reboot"),
];

/// What is run on the logs of the vehicle.
const ON_ITS_LOGS: &[(&str, &str)] = &[
    ("report", "report hold.tlog"),
    (
        "report-several",
        "report step.tlog hold.tlog --out both.html",
    ),
    ("log-info", "log info step.tlog"),
    ("log-cut", "log cut step.tlog part.tlog --release 1"),
    ("log-recover", "log recover step.tlog whole.mcap"),
    ("replay", "replay step.tlog"),
    (
        "replay-changed",
        "replay step.tlog --param SFC_GAIN_S=0.1 --filter madgwick --offline",
    ),
    ("convert", "convert step.tlog step.csv"),
    ("convert", "convert step.tlog step.mcap"),
    ("identify", "identify step.csv"),
    ("identify", "identify step.tlog --out drone.toml"),
    (
        "model-what-if",
        "model what-if step.tlog --drone drone.toml --param SFC_GAIN_S=0.1",
    ),
];

/// What is compared by a test of its own, mostly one that runs it for other reasons.
const ELSEWHERE: &[(&str, &str)] = &[
    ("ports", "ports"),
    ("experiment-static", "experiment static"),
    ("experiment-vibration", "experiment vibration"),
    ("experiment-jerk", "experiment jerk"),
    ("experiment-acceleration", "experiment acceleration"),
    ("cycles", "cycles"),
    ("calibrate", "calibrate"),
    ("calibrate-from", "calibrate --from"),
    ("calibrate-servo", "calibrate servo"),
    ("calibrate-polarity", "calibrate polarity"),
    ("calibrate-hold", "calibrate hold"),
];

/// The objects of a command, which is run until it prints some: a vehicle has to settle before it
/// is armed.
fn objects(folder: &Path, name: &str, arguments: &[&str]) -> Vec<Value> {
    let begun = Instant::now();
    let output = loop {
        let output = command(arguments).current_dir(folder).output().unwrap();
        let said = said(&output);
        if name.is_empty() {
            // Status 1 is a figure that misses its requirement.
            let status = output.status.code();
            assert!(matches!(status, Some(0 | 1)), "{arguments:?}: {said}");
            return Vec::new();
        }
        if !output.stdout.is_empty() {
            break output;
        }
        let waits =
            begun.elapsed() < PATIENCE && VEHICLE_WAITS.iter().any(|why| said.contains(why));
        assert!(waits, "{arguments:?}: {said}");
    };
    eprintln!("{name}: {:.1} s", begun.elapsed().as_secs_f64());
    // `tvc monitor` prints an object a line.
    serde_json::Deserializer::from_slice(&output.stdout)
        .into_iter()
        .collect::<Result<_, _>>()
        .unwrap_or_else(|error| panic!("{arguments:?}: {error}"))
}

/// Runs all of `runs`; every difference is told, not only the first. Runs of the same name count
/// together.
fn check_all(folder: &Path, runs: &[(&str, &str)], more: &[&str]) -> Vec<String> {
    let mut found: BTreeMap<&str, Vec<Value>> = BTreeMap::new();
    for (name, arguments) in runs {
        let mut arguments: Vec<&str> = arguments.split(' ').collect();
        if !name.is_empty() {
            arguments.push("--json");
        }
        let objects = objects(folder, name, &[&arguments[..], more].concat());
        found.entry(name).or_default().extend(objects);
    }
    found.remove("");
    found
        .iter()
        .filter_map(|(name, objects)| difference(name, objects))
        .collect()
}

/// One at a time: an image in the making would slow the rig down.
static TURN: Mutex<()> = Mutex::new(());

#[test]
fn no_command_with_json_is_without_its_keys() {
    let runs: Vec<_> = [ALONE, AT_A_VEHICLE, ON_ITS_LOGS, ELSEWHERE].concat();
    let mut with_json = 0;
    for (words, help) in commands_below(&[]) {
        // What only leads to other commands is not run by itself.
        if !help.contains("--json") || help.contains("<COMMAND>") {
            continue;
        }
        with_json += 1;
        let line = words.join(" ");
        let run = runs.iter().any(|(_, arguments)| {
            let rest = arguments.strip_prefix(&line);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
        });
        assert!(run, "no keys of tvc {line} --json");
    }
    assert!(with_json > 25, "{with_json}");
    let names: BTreeSet<String> = runs
        .iter()
        .filter(|(name, _)| !name.is_empty())
        .map(|(name, _)| format!("{name}.txt"))
        .collect();
    let stored: BTreeSet<String> = std::fs::read_dir(keys::folder())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(names, stored);
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
    let run = "seed = 1\ncampaign = \"faults\"\nvehicle = \"drone\"\nservo = \"s3003\"\n\
               hardware = \"\"\nphase = \"flight\"\nkind = \"spikes\"\nnumber = 0\n";
    std::fs::write(folder.path().join("run.toml"), run).unwrap();
    let differences = check_all(folder.path(), ALONE, &[]);
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
    let object = running::json(&running::tvc(&["ports", "--json"]));
    match object["ports"].as_array().map(Vec::len) {
        Some(0) => assert_eq!(object, serde_json::json!({ "ports": [] })),
        _ => keys::assert_keys("ports", &object),
    }
}
