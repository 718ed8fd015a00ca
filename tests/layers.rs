//! Who may name what: the layers of docs/explanation/architecture.md, read from the sources.
//!
//! Comments and tests may name anything.

use std::fs;
use std::path::{Path, PathBuf};

/// A layer: what it is, where it lies, and the names that do not stand in it.
const LAYERS: [(&str, &[&str], &[&str]); 10] = [
    ("one file for each sensor names its driver", &["src"], &["bno055_driver", "lsm6ds3_driver"]),
    (
        "the link knows no sensor's driver, no filter's inside, no law and no servo's map",
        &["src/telemetry", "src/telemetry.rs"],
        &[
            "crate::navigation",
            "crate::controller",
            "crate::channel",
            "crate::mount",
            "servo::Servo",
        ],
    ),
    (
        "the states know no link and no estimate's inside",
        &["src/failsafe", "src/failsafe.rs"],
        &[
            "crate::telemetry",
            "crate::recorder",
            "crate::navigation",
            "crate::controller",
            "crate::flight",
        ],
    ),
    (
        "the laws know no estimate, no state and no link",
        &["src/controller.rs", "src/channel.rs", "src/servo.rs"],
        &[
            "crate::navigation",
            "crate::failsafe",
            "crate::telemetry",
            "crate::flight",
            "tvc_fusion",
        ],
    ),
    (
        "the estimate knows no law, no state and no link",
        &["src/navigation.rs", "src/mount.rs", "src/blow.rs"],
        &["crate::controller", "crate::failsafe", "crate::telemetry", "crate::flight"],
    ),
    (
        "the flight knows no link and no board",
        &["src/flight", "src/flight.rs"],
        &["crate::telemetry", "crate::recorder", "crate::application", "embedded_storage"],
    ),
    (
        "filters, laws and what sensors share use nothing of ours",
        &["fusion/src", "pid/src", "imu/src"],
        &["tvc_nano", "bno055_driver", "lsm6ds3_driver", "plant::", "rig::"],
    ),
    (
        "a driver uses what sensors share, and no more of ours",
        &["bno055-driver/src", "lsm6ds3-driver/src"],
        &["tvc_nano", "tvc_fusion", "tvc_pid", "rig::"],
    ),
    (
        "design and logs talk to no vehicle",
        &["design/src", "flights/src"],
        &["Client", "GroundStation", "serialport"],
    ),
    (
        "what commands share knows no vehicle and no rig",
        &["reports/src"],
        &["tvc_nano", "client::", "plant::", "rig::"],
    ),
];

/// Where a name may stand: naming layers is this file's task.
const PLACES: [(&str, &str); 2] =
    [("src/sensor/bno055.rs", "bno055_driver"), ("src/sensor/lsm6ds3.rs", "lsm6ds3_driver")];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The Rust files of a folder, or the file; tests apart.
fn sources(place: &Path) -> Vec<PathBuf> {
    if place.is_file() {
        return vec![place.to_owned()];
    }
    let entries = fs::read_dir(place).unwrap().map(|entry| entry.unwrap().path());
    let is_test = |path: &Path| path.file_stem().is_some_and(|stem| stem == "tests");
    entries
        .filter(|path| !is_test(path))
        .filter(|path| path.is_dir() || path.extension().is_some_and(|end| end == "rs"))
        .flat_map(|path| sources(&path))
        .collect()
}

/// The lines of a file that are neither comment nor test.
fn code(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    let production = text.split("\n#[cfg(test)]").next().unwrap_or_default();
    let lines = production.lines().map(str::trim);
    lines.filter(|line| !line.starts_with("//")).map(str::to_owned).collect()
}

/// The names that stand in the files of a layer against its rule.
fn breaches(places: &[&str], names: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    for path in places.iter().flat_map(|place| sources(&root().join(place))) {
        let file = path.strip_prefix(root()).unwrap().display().to_string();
        for line in code(&path) {
            for name in names.iter().filter(|name| line.contains(**name)) {
                if !PLACES.contains(&(file.as_str(), name)) {
                    found.push(format!("{file} names {name}: {line}"));
                }
            }
        }
    }
    found
}

#[test]
fn each_layer_names_only_what_it_may() {
    let broken: Vec<String> = LAYERS
        .iter()
        .map(|(what, places, names)| (what, breaches(places, names)))
        .filter(|(_, found)| !found.is_empty())
        .map(|(what, found)| format!("{what}:\n  {}", found.join("\n  ")))
        .collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// Were nothing read, nothing would be found.
#[test]
fn a_name_that_stands_there_is_found() {
    assert!(!breaches(&["src/telemetry", "src/telemetry.rs"], &["crate::flight"]).is_empty());
    for (file, driver) in PLACES {
        assert!(breaches(&[file], &[driver]).is_empty());
        assert!(code(&root().join(file)).iter().any(|line| line.contains(driver)), "{file}");
    }
}
