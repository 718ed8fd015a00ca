//! What the launcher starts ends with it.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;
use std::time::{Duration, Instant};

/// Longest wait for a process to begin or to end.
const PATIENCE: Duration = Duration::from_secs(20);

fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Whether a process with this number runs: signal 0 reaches it.
fn runs(id: &str) -> bool {
    let sent = Command::new("kill").args(["-0", id]).output();
    sent.unwrap().status.success()
}

#[test]
fn a_signal_to_the_launcher_ends_the_tool() {
    let folder = std::env::temp_dir().join(format!("tvc-launch-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let (cargo, id) = (folder.join("cargo"), folder.join("id"));
    // In cargo's place: it has built the tool, and the tool says its number and runs on.
    let script = format!(
        "#!/bin/sh\n[ \"$1\" = build ] && exit 0\necho $$ >{0}.new && mv {0}.new {0}\nexec sleep 60\n",
        id.display()
    );
    fs::write(&cargo, script).unwrap();
    fs::set_permissions(&cargo, fs::Permissions::from_mode(0o755)).unwrap();
    for signal in ["-TERM", "-INT", "-HUP"] {
        let mut launcher = Command::new(env!("CARGO_BIN_EXE_xtask"))
            .args(["tvc", "test", "hold"])
            .env("CARGO", &cargo)
            .spawn()
            .unwrap();
        wait_for("the tool begins", || id.exists());
        let tool = fs::read_to_string(&id).unwrap().trim().to_owned();
        assert!(runs(&tool));
        let launcher_id = launcher.id().to_string();
        let sent = Command::new("kill").args([signal, &launcher_id]).status();
        assert!(sent.unwrap().success());
        launcher.wait().unwrap();
        wait_for("the tool ends with its launcher", || !runs(&tool));
        fs::remove_file(&id).unwrap();
    }
    fs::remove_dir_all(&folder).unwrap();
}
