//! Golden runs of the command line: every help text, and every line with which bad input is
//! refused.
//!
//! `golden/help/` and `golden/refused/` hold a file for each command: what is typed, the exit
//! status unless it is 0, and all that is printed, standard output and standard error together.
//! What depends on the machine stands there as `[..]`.
//!
//! A change of these texts that is meant is taken over with
//! `TRYCMD=overwrite cargo test -p ground --test golden`, and read as a difference before it is
//! committed. A new command is typed into its files by hand; its output is then filled in likewise.

mod running;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use mavlink::MavHeader;
use mavlink::dialects::common::MavMessage;

use running::commands_below;

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// Runs every file of `golden/<part>` in `folder`.
fn run(part: &str, folder: &Path) {
    let pattern = golden().join(part).join("*.trycmd");
    assert!(
        !commands_run(part).is_empty(),
        "nothing in {}",
        pattern.display()
    );
    // The commands run where the test runs; only this test of the file depends on where that is.
    std::env::set_current_dir(folder).unwrap();
    trycmd::TestCases::new()
        .register_bin("tvc", Path::new(env!("CARGO_BIN_EXE_tvc")))
        .case(pattern)
        .run();
}

/// Every command line in the files of `golden/<part>`.
fn commands_run(part: &str) -> BTreeSet<String> {
    let mut lines = BTreeSet::new();
    for entry in std::fs::read_dir(golden().join(part)).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        lines.extend(
            text.lines()
                .filter_map(|line| Some(line.strip_prefix("$ ")?.to_owned())),
        );
    }
    lines
}

#[test]
fn no_command_is_without_its_help_and_its_refusals() {
    let (help, refused) = (commands_run("help"), commands_run("refused"));
    let commands = commands_below(&[]);
    assert!(commands.len() > 40, "{}", commands.len());
    for (command, _) in &commands {
        let line = format!("tvc {}", command.join(" "));
        assert!(help.contains(&format!("{line} --help")), "{line} --help");
        assert!(
            refused.iter().any(|refused| refused.starts_with(&line)),
            "nothing that {line} refuses"
        );
    }
}

/// Help texts and refusals, one after the other: both run in a folder of their own.
#[test]
fn help_and_refusals_are_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    run("help", folder.path());
    assert_eq!(names(folder.path()), BTreeSet::new());
    #[cfg(unix)]
    {
        write_input(folder.path());
        let before = names(folder.path());
        run("refused", folder.path());
        let mut after = names(folder.path());
        // A log is begun before its port is looked for.
        for log in ["forward.tlog", "monitor.tlog", "record.tlog", "test.tlog"] {
            after.remove(log);
        }
        assert_eq!(before, after, "what is refused writes nothing");
    }
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

/// The files that the commands of `golden/refused/` are given.
#[cfg(unix)]
fn write_input(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    let text = std::fs::read_to_string(golden().join("input.txt")).unwrap();
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
    let vehicle = MavHeader {
        system_id: 1,
        component_id: 1,
        sequence: 0,
    };
    let message = MavMessage::HEARTBEAT(Default::default());
    mavlink::write_v2_msg(&mut heartbeat, vehicle, &message).unwrap();
    let time_us = 1_700_000_000_000_000_u64.to_be_bytes();
    write("heartbeat.tlog", &[&time_us[..], &heartbeat].concat());
}
