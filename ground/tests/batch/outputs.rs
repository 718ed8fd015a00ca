//! No command writes its output in the place of its input, or of another kind of file.

use std::process::Output;

use crate::running::{self, commands_below, tvc};

/// Names of outputs, the commands that are to write them, and what these say.
const COMMANDS: [[&str; 3]; 18] = [
    ["a.tlog", "report a.tlog --out", "name of a telemetry log"],
    ["a.tlog", "replay a.tlog --csv", "name of a telemetry log"],
    ["a.tlog", "replay a.tlog --report", "name of a telemetry log"],
    ["a.tlog", "record b.tlog --csv", "name of a telemetry log"],
    ["a.tlog", "param dump", "name of a telemetry log"],
    ["a.tlog", "fuse run.imuq --out", "name of a telemetry log"],
    ["a.html", "report", "another kind of file"],
    ["gains", "fly --params gains --report", "another kind of file"],
    ["a.param", "fly --params a.param --report", "name of a parameter file"],
    ["a.toml", "tune --vehicle a.toml --out", "name of a TOML file"],
    ["a.toml", "model simulate a.toml --out", "name of a TOML file"],
    ["a.toml", "identify run.csv --vehicle a.toml --out", "is read from a.toml"],
    ["a", "identify a --out", "is read from a"],
    ["a", "model simulate a --out", "is read from a"],
    ["a", "montecarlo rerun a --out", "is read from a"],
    ["a.csv", "montecarlo merge a.csv --out", "is read from a.csv"],
    ["b.csv", "record a.tlog --csv", "another kind of file"],
    ["a.foo", "monitor --log", "must end in .tlog or .mcap"],
];

#[test]
fn what_is_there_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    for [name, command, part] in COMMANDS {
        let path = folder.path().join(name);
        // Neither text nor a page where the name is to be that of a log.
        let bytes: &[u8] = match name {
            "a.html" | "b.csv" => b"\x00\x06\xfd a log by another name",
            _ => b"what is there",
        };
        std::fs::write(&path, bytes).unwrap();
        let command: Vec<_> = command.split(' ').collect();
        let output =
            running::command(&command).arg(name).current_dir(folder.path()).output().unwrap();
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
        &["info", "--ports"][..],
        &["info", "--ports", "--json"],
        &[
            "model",
            "simulate",
            concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/gravity_only_pendulum.toml"),
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

/// Whatever a command would do for hours, a page that has no place is complained of first.
#[test]
fn a_page_without_a_place_is_refused_before_the_work_begins() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("plain"), "no folder").unwrap();
    let mut tried = 0;
    for (words, help) in commands_below(&[]) {
        let is_taken = |option: &&&str| help.contains(&format!("{option} <FILE.html>"));
        let Some(option) = ["--report", "--out"].iter().find(is_taken) else {
            continue;
        };
        tried += 1;
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let output = running::command(&words)
            .args([option, "plain/page.html"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = running::said(&output);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains("plain/page.html"), "{words:?}: {said}");
        assert!(said.contains("cannot be written"), "{words:?}: {said}");
        assert!(!said.contains(".tmp"), "{words:?}: {said}");
    }
    assert!(tried > 12, "{tried}");
}

/// So is the usual place, but only by a command that writes there.
#[test]
fn a_usual_place_that_takes_no_file_is_refused_by_who_would_use_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("report"), "no folder").unwrap();
    std::fs::write(folder.path().join("counts.csv"), "t,acc_x\n").unwrap();
    let run = |arguments: &str| {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let mut command = running::command(&arguments);
        let output = command.current_dir(folder.path()).output().unwrap();
        (output.status.code(), running::said(&output))
    };
    for command in [
        "fly",
        "montecarlo",
        "montecarlo merge rows.csv",
        "model linear",
        "calibrate --from counts.csv",
        "report a.tlog b.tlog",
    ] {
        let (status, said) = run(command);
        assert_eq!(status, Some(2), "{command}: {said}");
        assert!(said.contains("report/") || said.contains("folder"), "{said}");
        assert!(said.contains("not a directory"), "{command}: {said}");
    }
    let (_, said) = run("calibrate polarity --port none");
    assert!(!said.contains("not a directory"), "{said}");
}

/// The figures come first, and the complaint last.
#[cfg(unix)]
#[test]
fn a_disk_that_is_full_takes_no_figures_away() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/");
    for (from, to) in [
        ("../lab/fuzz_corpus/log/step.tlog", "step.tlog"),
        ("../lab/fuzz_corpus/case/worst.toml", "worst.toml"),
    ] {
        std::fs::copy(format!("{root}{from}"), at(to)).unwrap();
    }
    for command in [
        "model linear --json --report",
        "report step.tlog --json --out",
        "report step.tlog step.tlog --json --out",
        "replay step.tlog --json --report",
        "montecarlo --runs 4 --json --worst . --report",
    ] {
        let output = with_a_full_disk(command, "new.html", folder.path(), false);
        let said = running::said(&output);
        assert!(serde_json::from_slice::<serde_json::Value>(&output.stdout).is_ok(), "{command}");
        let last = said.lines().last().unwrap();
        assert!(last.starts_with("error: writing "), "{command}: {said}");
    }
    let replay = "montecarlo rerun worst.toml --json --out";
    let output = with_a_full_disk(replay, "new.csv", folder.path(), false);
    assert!(!output.stdout.is_empty());
}

#[test]
fn what_may_be_written_again_is() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.html");
    for _ in 0..2 {
        let output = tvc(&["model", "linear", "--report", page.to_str().unwrap()]);
        assert!(output.status.success(), "{}", running::said(&output));
    }
}

/// Commands that write a file of a kilobyte or more, its name, and what may be there before:
/// nothing where a log is not overwritten.
#[cfg(unix)]
const WRITERS: [(&str, &str, Option<&str>); 11] = [
    ("log convert step.tlog", "new.mcap", None),
    ("log convert step.tlog", "new.csv", Some("time_us\n1\n")),
    ("log convert step.mcap", "new.tlog", None),
    ("log cut step.tlog --from 0 --to 9", "new.tlog", None),
    ("log recover step.tlog", "new.tlog", None),
    ("report step.tlog --out", "new.html", Some("<!DOCTYPE html>old")),
    ("replay step.tlog --report", "new.html", Some("<!DOCTYPE html>old")),
    ("replay step.tlog --csv", "new.csv", Some("old\n")),
    ("fuse counts.csv --filter mahony --out", "new.csv", Some("old\n")),
    ("model simulate pendulum.toml --out", "new.csv", Some("old\n")),
    ("montecarlo rerun worst.toml --out", "new.csv", Some("old\n")),
];

/// Runs a command that can write no more than half a kilobyte into a file. Beyond that it gets an
/// error, or, where it is `killed`, ends at once.
#[cfg(unix)]
fn with_a_full_disk(command: &str, name: &str, folder: &std::path::Path, killed: bool) -> Output {
    let trap = if killed { "" } else { "trap '' XFSZ; " };
    let limit = format!("{trap}ulimit -c 0; ulimit -f 1; exec \"$@\"");
    let output = std::process::Command::new("sh")
        .args(["-c", &limit, "sh", env!("CARGO_BIN_EXE_tvc")])
        .args(command.split(' '))
        .arg(name)
        .current_dir(folder)
        .output()
        .unwrap();
    let said = running::said(&output);
    let code = if killed { None } else { Some(1) };
    let said_so = killed || said.contains(name) || said.contains("File too large");
    assert!(output.status.code() == code || output.status.code() == Some(2), "{command}: {said}");
    assert!(said_so && !said.contains("panicked"), "{command}: {said}");
    assert!(!said.contains(".tmp"), "{command}: {said}");
    output
}

/// No file is left half written, neither by an error half way nor by the end of the program. An old
/// file stays whole.
#[cfg(unix)]
#[test]
fn a_file_that_cannot_be_written_to_its_end_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/");
    for (from, to) in [
        ("../lab/fuzz_corpus/log/step.tlog", "step.tlog"),
        ("../lab/fuzz_corpus/recording-table/counts.csv", "counts.csv"),
        ("../lab/fuzz_corpus/case/worst.toml", "worst.toml"),
        ("../scenarios/gravity_only_pendulum.toml", "pendulum.toml"),
    ] {
        std::fs::copy(format!("{root}{from}"), at(to)).unwrap();
    }
    let command = running::command(&["convert", "step.tlog", "step.mcap"])
        .current_dir(folder.path())
        .output();
    assert!(command.unwrap().status.success());
    let names = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    for (command, name, old) in WRITERS {
        for old in [None, old] {
            let path = at(name);
            if let Some(old) = old {
                std::fs::write(&path, old).unwrap();
            }
            let before = names();
            with_a_full_disk(command, name, folder.path(), false);
            assert_eq!(names(), before, "{command} leaves something behind");
            with_a_full_disk(command, name, folder.path(), true);
            let left = std::fs::read_to_string(&path).ok();
            assert_eq!(left.as_deref(), old, "{command} killed");
            // What a program that was killed leaves are temporary files.
            for entry in std::fs::read_dir(folder.path()).unwrap() {
                let name = entry.unwrap().file_name().into_string().unwrap();
                if name.starts_with(".tmp") {
                    std::fs::remove_file(at(&name)).unwrap();
                }
            }
            // It is the disk alone: with room for it the file is written.
            let output = running::command(&command.split(' ').collect::<Vec<_>>())
                .arg(name)
                .current_dir(folder.path())
                .output()
                .unwrap();
            assert!(
                path.metadata().is_ok_and(|file| file.len() > 512),
                "{command}: {}",
                running::said(&output)
            );
            std::fs::remove_file(&path).unwrap();
            assert_eq!(names().len(), 5, "{command}: {:?}", names());
        }
    }
}
