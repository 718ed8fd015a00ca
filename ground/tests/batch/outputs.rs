//! No command writes its output in the place of its input, or of another kind of file.

use crate::running::{self, tvc};

/// Names of outputs, the commands that are to write them, and what these say.
const COMMANDS: [[&str; 3]; 14] = [
    ["a.tlog", "report a.tlog --out", "name of a telemetry log"],
    ["a.tlog", "replay a.tlog --csv", "name of a telemetry log"],
    [
        "a.tlog",
        "replay a.tlog --report",
        "name of a telemetry log",
    ],
    ["a.tlog", "record b.tlog --csv", "name of a telemetry log"],
    ["a.tlog", "param dump", "name of a telemetry log"],
    ["a.tlog", "fuse run.imuq --out", "name of a telemetry log"],
    ["a.html", "report", "another kind of file"],
    [
        "gains",
        "fly --params gains --report",
        "another kind of file",
    ],
    [
        "a.param",
        "fly --params a.param --report",
        "name of a parameter file",
    ],
    [
        "a.toml",
        "tune --params a.toml --out",
        "name of a TOML file",
    ],
    [
        "a.toml",
        "model simulate a.toml --out",
        "name of a TOML file",
    ],
    [
        "a.toml",
        "identify run.csv --params a.toml --out",
        "is read from a.toml",
    ],
    [
        "a.csv",
        "montecarlo merge a.csv --out",
        "is read from a.csv",
    ],
    ["a.foo", "monitor --log", "must end in .tlog or .mcap"],
];

#[test]
fn what_is_there_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    for [name, command, part] in COMMANDS {
        let path = folder.path().join(name);
        // Neither text nor a page where the name is to be that of a log.
        let bytes: &[u8] = match name {
            "a.html" => b"\x00\x06\xfd a log by another name",
            _ => b"what is there",
        };
        std::fs::write(&path, bytes).unwrap();
        let command: Vec<_> = command.split(' ').collect();
        let output = running::command(&command)
            .arg(name)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = running::said(&output);
        assert_eq!(output.status.code(), Some(2), "{command:?}: {said}");
        assert!(said.contains(part), "{command:?}: {said}");
        assert_eq!(std::fs::read(&path).unwrap(), bytes, "{command:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn standard_output_that_cannot_be_written_is_an_error_in_one_line() {
    for command in [
        &["ports"][..],
        &["ports", "--json"],
        &[
            "model",
            "simulate",
            concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../scenarios/gravity_only_pendulum.toml"
            ),
        ],
    ] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full");
        let output = running::command(command).stdout(full.unwrap()).output();
        let output = output.unwrap();
        let said = running::said(&output);
        assert_eq!(output.status.code(), Some(1), "{command:?}: {said}");
        assert!(said.contains("error: writing to standard output"), "{said}");
        assert!(!said.contains("panicked"), "{said}");
    }
}

#[test]
fn what_may_be_written_again_is() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.html");
    for _ in 0..2 {
        let output = tvc(&["model", "validate", "--report", page.to_str().unwrap()]);
        assert!(output.status.success(), "{}", running::said(&output));
    }
}
