//! `tvc support` at the rig and without a vehicle.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde_json::Value;
use zip::ZipArchive;

use crate::running::{command, said};

/// The text of a file in an archive.
fn text(archive: &mut ZipArchive<File>, name: &str) -> String {
    let mut text = String::new();
    let mut file = archive.by_name(name).unwrap();
    file.read_to_string(&mut text).unwrap();
    text
}

/// `tvc support` in a folder: its status, and the archive.
fn support(folder: &Path, more: &[&str]) -> (Option<i32>, ZipArchive<File>) {
    let arguments = [&["support", "bug.zip"], more].concat();
    let output = command(&arguments).current_dir(folder).output().unwrap();
    let file = File::open(folder.join("bug.zip")).unwrap_or_else(|_| panic!("{}", said(&output)));
    (output.status.code(), ZipArchive::new(file).unwrap())
}

#[test]
fn the_rig_gives_all_but_a_release() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("notes.tlog"), "what I saw").unwrap();
    let (status, mut archive) = support(folder.path(), &["--log", "notes.tlog", "--rig"]);
    assert_eq!(status, Some(0));
    let names = (0..archive.len())
        .map(|index| archive.by_index(index).unwrap().name().unwrap().into_owned());
    assert_eq!(names.collect::<Vec<_>>(), ["info.json", "parameters.param", "log/notes.tlog"]);
    let info: Value = serde_json::from_str(&text(&mut archive, "info.json")).unwrap();
    assert!(info["tool"].is_string() && info["vehicle"]["state"].is_string(), "{info}");
    assert!(text(&mut archive, "parameters.param").contains("PID_KP"));
    assert_eq!(text(&mut archive, "log/notes.tlog"), "what I saw");
}

/// The archive of a vehicle that does not answer tells why.
#[test]
fn without_a_vehicle_the_rest_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (status, mut archive) = support(folder.path(), &["--port", "/dev/no-such-port"]);
    assert_eq!(status, Some(1));
    assert_eq!(archive.len(), 1);
    let info: Value = serde_json::from_str(&text(&mut archive, "info.json")).unwrap();
    assert!(info["problem"].as_str().unwrap().contains("no-such-port"), "{info}");
}
