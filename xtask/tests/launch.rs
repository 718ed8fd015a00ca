//! The tool takes the launcher's place.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};

/// A signal to the launcher then reaches the tool, which leaves the vehicle neutral.
#[test]
fn the_tool_runs_in_the_launchers_own_process() {
    let folder = std::env::temp_dir().join(format!("tvc-launch-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let cargo = folder.join("cargo");
    // In cargo's place: it has built the tool, which says the number of its process.
    fs::write(&cargo, "#!/bin/sh\n[ \"$1\" = build ] || echo $$\n").unwrap();
    fs::set_permissions(&cargo, fs::Permissions::from_mode(0o755)).unwrap();
    let launcher = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["tvc", "test", "hold"])
        .env("CARGO", &cargo)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let id = launcher.id().to_string();
    let output = launcher.wait_with_output().unwrap();
    assert_eq!(String::from_utf8(output.stdout).unwrap().trim(), id);
    fs::remove_dir_all(&folder).unwrap();
}
