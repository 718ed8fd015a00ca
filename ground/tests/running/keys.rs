//! The paths of the keys that a command prints with `--json`, such as `runs[].overshoot_pct`, held
//! against those stored in `golden/keys/`. Values are the subject of other tests.
//!
//! A change of the keys that is meant is taken over by running the tests with `TRYCMD=overwrite`,
//! and read as a difference before it is committed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{command, commands_below, said};

/// A machine that is busy with other tests runs the rig slower than real time.
const PATIENCE: Duration = Duration::from_secs(120);

/// What a vehicle says that is soon ready.
const VEHICLE_WAITS: [&str; 3] =
    ["attitude still settling", "gyro offset unknown", "the vehicle holds no release"];

/// Where the keys are stored, a file for each command and a path a line.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/keys")
}

/// The keys of `object` are those of `name`.
pub(crate) fn assert_keys(name: &str, object: &Value) {
    if let Some(difference) = difference(name, std::slice::from_ref(object)) {
        panic!("{difference}");
    }
}

/// What the keys of `objects`, together, have lost and gained over those of `name`.
pub(crate) fn difference(name: &str, objects: &[Value]) -> Option<String> {
    let mut found = BTreeSet::new();
    for object in objects {
        assert!(object.is_object(), "{name}: {object}");
        collect(object, "", &mut found);
    }
    // A place that is empty in one object and has keys in another has those keys.
    let bare: Vec<String> = found
        .iter()
        .filter(|path| {
            let below = |other: &&String| {
                other.strip_prefix(path.as_str()).is_some_and(|rest| rest.starts_with(['.', '[']))
            };
            found.iter().any(|other| below(&other))
        })
        .cloned()
        .collect();
    found.retain(|path| !bare.contains(path));
    let file = folder().join(format!("{name}.txt"));
    if std::env::var("TRYCMD").is_ok_and(|how| how == "overwrite") {
        let text: String = found.iter().map(|path| format!("{path}\n")).collect();
        std::fs::create_dir_all(folder()).unwrap();
        std::fs::write(&file, text).unwrap();
        return None;
    }
    let expected = std::fs::read_to_string(&file)
        .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let expected: BTreeSet<String> = expected.lines().map(str::to_owned).collect();
    let lost: Vec<_> = expected.difference(&found).collect();
    let new: Vec<_> = found.difference(&expected).collect();
    (found != expected).then(|| format!("keys of {name}: lost {lost:?}, new {new:?}"))
}

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
pub(crate) fn check_all(folder: &Path, runs: &[(&str, &str)], more: &[&str]) -> Vec<String> {
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
    found.iter().filter_map(|(name, objects)| difference(name, objects)).collect()
}

/// Every command with `--json` is among `runs`, and every name of these has its file.
pub(crate) fn assert_complete(runs: &[(&str, &str)], at_least: usize) {
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
        assert!(run, "no keys of {line} --json");
    }
    assert!(with_json > at_least, "{with_json}");
    let named = runs.iter().filter(|(name, _)| !name.is_empty());
    let names: BTreeSet<String> = named.map(|(name, _)| format!("{name}.txt")).collect();
    let stored = std::fs::read_dir(folder()).unwrap();
    let stored: BTreeSet<String> =
        stored.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(names, stored);
}

/// The paths of all that `value` holds; an element of an array is `[]`, whatever its place.
fn collect(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(members) if !members.is_empty() => {
            for (key, member) in members {
                let dot = if path.is_empty() { "" } else { "." };
                collect(member, &format!("{path}{dot}{key}"), found);
            }
        }
        Value::Array(elements) if !elements.is_empty() => {
            for element in elements {
                collect(element, &format!("{path}[]"), found);
            }
        }
        Value::Array(_) => {
            found.insert(format!("{path}[]"));
        }
        _ => {
            found.insert(path.to_owned());
        }
    }
}
