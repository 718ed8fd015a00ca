//! The help of every command of `tvc`, and every line with which bad input is refused.

mod running;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_tvc");

use std::collections::BTreeSet;
use std::path::Path;

use mavlink::MavHeader;
use mavlink::dialects::common::MavMessage;

use running::golden;

#[test]
fn every_command_has_examples_and_refusals() {
    golden::assert_help_and_refusals("tvc", 40);
}

#[cfg(unix)]
#[test]
fn refusals_are_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    write_input(folder.path());
    let before = names(folder.path());
    golden::run("tvc", folder.path());
    assert_eq!(before, names(folder.path()), "what is refused writes nothing");
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// The files that the commands of `golden/refused/` are given.
#[cfg(unix)]
fn write_input(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    let text = std::fs::read_to_string(golden::folder().join("input.txt")).unwrap();
    let files = text.split("-- ").skip(1);
    for file in files {
        let (name, contents) = file.split_once(" --\n").unwrap();
        write(name, contents.as_bytes());
    }
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/broad_11_cut.imuq");
    let recording = std::fs::read(recording).unwrap();
    // 64 bytes of header, 28 a sample.
    write("header_cut.imuq", &recording[..40]);
    write("no_sample.imuq", &recording[..64]);
    write("sample_cut.imuq", &recording[..64 + 2 * 28 - 5]);
    write("foreign.imuq", b"PK\x03\x04 something else");
    write("binary.csv", &[0xff, 0xfe, 0, 1, 2]);
    // A telemetry log: a time in us, big-endian, before each frame.
    let mut heartbeat = Vec::new();
    let vehicle = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
    let message = MavMessage::HEARTBEAT(Default::default());
    mavlink::write_v2_msg(&mut heartbeat, vehicle, &message).unwrap();
    let time_us = 1_700_000_000_000_000_u64.to_be_bytes();
    write("heartbeat.tlog", &[&time_us[..], &heartbeat].concat());
}
