//! That the table has every reader: wherever the tool opens a file or takes apart a text, one of
//! the readers stands for it, or it is said here why none has to.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::readers::READERS;

/// Folders of what the tool is made of.
const FOLDERS: [&str; 10] = [
    "calibration/src",
    "client/src",
    "design/src",
    "flights/src",
    "ground/src",
    "lab/src",
    "plant/src",
    "recordings/src",
    "reports/src",
    "rig/src",
];

/// What reads.
const WORDS: [&str; 16] = [
    "File::open(",
    "Wire::default()",
    "csv::Reader",
    "from_path(",
    "from_reader(",
    "fs::read(",
    "input::bytes(",
    "input::file_text(",
    "input::open(",
    "input::text(",
    "json::from_str(",
    "read_line(",
    "read_to_end(",
    "read_to_string(",
    "recv_from(",
    "toml::from_str(",
];

/// Where something is read that is not of unknown origin.
const ELSEWHERE: [(&str, &str); 10] = [
    ("rig/src/fly/faults/frames.rs", "frames that the rig's host sends"),
    ("rig/src/fly/pilot.rs", "what the rig's own image sends, and prompts to it"),
    ("reports/src/input.rs", "what opens the files of the others"),
    ("lab/src/cycles/mod.rs", "a recording of the source tree"),
    ("reports/src/kind.rs", "the head of a file, looked at for zeros and one word"),
    ("ground/src/vehicle/calibrate/guided.rs", "the log that was written just before, copied"),
    ("ground/src/vehicle/web/report.rs", "a page that this program has made, passed on as it is"),
    ("ground/src/vehicle/support.rs", "a log that is passed on as it is"),
    ("ground/src/vehicle/port/machine.rs", "the names of processes, shown as they are"),
    ("ground/src/vehicle/calibrate/keyboard.rs", "what the person at the keyboard types"),
];

/// The files of source in a folder and those below.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| match path.is_dir() {
            true => sources(&path),
            false => vec![path],
        })
        .collect()
}

/// The code of a file without its tests.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let tests = text.find("mod tests {").unwrap_or(text.len());
    let lines = text[..tests].lines();
    let code: Vec<_> = lines.filter(|line| !line.trim_start().starts_with("//")).collect();
    code.join("\n")
}

#[test]
fn every_place_that_reads_is_one_of_a_reader() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let known: BTreeSet<&str> = READERS.iter().flat_map(|reader| reader.sources).copied().collect();
    let elsewhere: BTreeSet<&str> = ELSEWHERE.iter().map(|(path, _)| *path).collect();
    let mut reading = BTreeSet::new();
    for folder in FOLDERS {
        for path in sources(&root.join(folder)) {
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
            let is_test =
                name.contains("/tests") || name.contains("fuzz") || !name.ends_with(".rs");
            if !is_test && WORDS.iter().any(|word| code(&path).contains(word)) {
                reading.insert(name);
            }
        }
    }
    let is_known =
        |name: &&String| known.contains(name.as_str()) || elsewhere.contains(name.as_str());
    let unknown: Vec<_> = reading.iter().filter(|name| !is_known(name)).collect();
    assert!(unknown.is_empty(), "no reader stands for {unknown:#?}");
    // A file that was moved leaves its name behind.
    let gone = |path: &&&str| !root.join(path).is_file();
    assert_eq!(known.union(&elsewhere).find(gone), None);
}
