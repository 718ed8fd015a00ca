//! The help of every command of `lab`, and every line with which bad input is refused.

#[path = "../../ground/tests/running/mod.rs"]
mod running;

use running::golden;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_lab");

#[test]
fn every_command_has_examples_and_refusals() {
    golden::assert_help_and_refusals("lab", 7);
}

#[cfg(unix)]
#[test]
fn refusals_are_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    golden::run("lab", folder.path());
    let written = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(written, 0, "what is refused writes nothing");
}
