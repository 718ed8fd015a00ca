//! What a program prints, kept as text: every line with which bad input is refused.
//! `golden/refused/` holds a file for each command. The file has what is typed, the exit status
//! unless it is 0, and all that is printed. What depends on the machine stands there as `[..]`.
//!
//! A change of these texts that is meant is taken over with
//! `TRYCMD=overwrite cargo test -p ground --test golden` (for `lab`, `-p lab --test golden`), and
//! read as a difference before it is committed. A new command is typed into its file by hand; its
//! output is then filled in likewise.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::commands_below;

/// The folder of the kept texts.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// Runs every file of `golden/refused` for the program `name` in `folder`.
pub(crate) fn run(name: &str, folder: &Path) {
    let pattern = self::folder().join("refused/*.trycmd");
    assert!(!commands_run().is_empty(), "nothing in {}", pattern.display());
    // The commands run where the test runs; only this test of the file depends on where that is.
    std::env::set_current_dir(folder).unwrap();
    let cases = trycmd::TestCases::new();
    cases.register_bin(name, Path::new(crate::PROGRAM)).case(pattern).run();
}

/// Every command line in the files.
fn commands_run() -> BTreeSet<String> {
    let mut lines = BTreeSet::new();
    for entry in std::fs::read_dir(folder().join("refused")).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        lines.extend(text.lines().filter_map(|line| Some(line.strip_prefix("$ ")?.to_owned())));
    }
    lines
}

/// Every command of the program `name` refuses something, and shows examples and its exit status:
/// in its own help, in that of the command above it, or in those below it.
pub(crate) fn assert_help_and_refusals(name: &str, at_least: usize) {
    let refused = commands_run();
    let commands = commands_below(&[]);
    assert!(commands.len() >= at_least, "{}", commands.len());
    let explains = |help: &str| help.contains("Examples:\n") && help.contains("Exit status: 0");
    for (command, help) in &commands {
        let line = format!("{name} {}", command.join(" "));
        let is_refused = refused.iter().any(|refused| refused.starts_with(&line));
        assert!(is_refused, "nothing that {line} refuses");
        let above = &command[..command.len() - 1];
        let above = commands.iter().find(|(other, _)| other == above);
        let is_explained = explains(help)
            || help.contains("Commands:")
            || above.is_some_and(|(_, help)| explains(help));
        assert!(is_explained, "{line} --help has no examples or exit status");
    }
}
