//! `docs/guides/tether.md` from its first command to its last, in one folder, at the virtual rig in
//! the process: a blank vehicle is set up, released, recorded and tuned without a second terminal.

use std::fs;
use std::path::Path;

use crate::running::{command, said, tvc};

const PAGE: &str = include_str!("../../../docs/guides/tether.md");
/// Commands that talk to a vehicle.
const VEHICLE: [&str; 9] =
    ["info", "monitor", "calibrate", "param", "test", "record", "arm", "release", "disarm"];
/// What a person adds at the rig: its hand answers no question, and nobody presses Ctrl-C.
const ADDED: [(&str, &[&str]); 2] = [("calibrate", &["--yes"]), ("monitor", &["--seconds", "1"])];
/// Commands that need a board, a network, a browser or what another program has left.
const NOT_HERE: [&str; 5] = [
    "flash",
    "forward",
    "info --ports",
    "record release.csv --last",
    "log recover broken.mcap whole.mcap",
];

/// The commands of the page's blocks.
fn commands() -> Vec<&'static str> {
    let blocks = PAGE.split("```").skip(1).step_by(2).flat_map(str::lines);
    let commands = blocks.filter_map(|line| line.strip_prefix("cargo tvc "));
    let bare = commands.map(|line| line.split(" #").next().unwrap_or(line).trim());
    bare.filter(|line| !NOT_HERE.iter().any(|other| line.starts_with(other))).collect()
}

/// What a line makes: its status, and what it says.
fn run(line: &str, rig: &str, folder: &Path) -> (Option<i32>, String) {
    let name = line.split(' ').next().unwrap_or_default();
    let mut words: Vec<&str> = line.split(' ').filter(|word| !word.is_empty()).collect();
    if VEHICLE.contains(&name) {
        words.push(rig);
    }
    let added = ADDED.iter().filter(|(command, _)| *command == name);
    words.extend(added.flat_map(|(_, added)| added.iter().copied()));
    let output = command(&words).current_dir(folder).output().unwrap();
    (output.status.code(), said(&output))
}

#[test]
fn the_page_leads_from_a_blank_vehicle_to_its_report() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let image = folder.join("image.elf");
    let built = tvc(&["flash", "--elf", image.to_str().unwrap()]);
    assert!(built.status.success(), "{}", said(&built));
    let rig = "--rig=--image image.elf --blank --sensor-errors worst --memory nano.bin";

    let commands = commands();
    assert!(commands.len() > 15, "{commands:#?}");
    for line in commands {
        for copy in ["before.tlog", "after.tlog", "flight.tlog"] {
            if line.contains(copy) {
                fs::copy(folder.join("step.tlog"), folder.join(copy)).unwrap();
            }
        }
        let (status, said) = run(line, rig, folder);
        // Something is left to do, and something differs from the defaults.
        let expected = i32::from(matches!(line, "info" | "param diff"));
        assert_eq!(status, Some(expected), "{line}: {said}");
    }
    for file in ["step.tlog", "step.html", "mine.parm", "first.tlog", "replay.html"] {
        assert!(folder.join(file).exists(), "{file}");
    }
    // What was calibrated has stayed: nothing is left to do, and the vehicle can be let go by hand.
    for (line, words) in
        [("info", ""), ("arm", ""), ("release --yes --seconds 1", "released"), ("disarm", "")]
    {
        let (status, said) = run(line, rig, folder);
        assert_eq!(status, Some(0), "{line}: {said}");
        assert!(said.contains(words), "{line}: {said}");
    }
    // A memory is the rig's own, or none.
    let (status, said) = run("info", "--rig=--image image.elf --memory step.tlog", folder);
    assert_eq!(status, Some(2), "{said}");
}
