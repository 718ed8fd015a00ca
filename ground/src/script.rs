//! Programs that stand in for others in tests.

use std::path::Path;
use std::process::Command;

/// Makes a program of a shell script.
///
/// Another process writes it: a process that a test beside this one starts would inherit the open
/// file, and a file that is open for writing is not started.
pub fn write(path: &Path, script: &str) {
    let text = format!("#!/bin/sh\n{script}\n");
    let write = ["-c", r#"printf %s "$1" > "$0" && chmod 755 "$0""#];
    let written = Command::new("sh").args(write).arg(path).arg(text).status().unwrap();
    assert!(written.success());
}
