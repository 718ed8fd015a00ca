//! The virtual rig behind its pseudo-terminal, and what the commands say of it.

use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::running::{self, Running};

/// A machine that is busy with other tests runs the rig slower than real time.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

/// `tvc rig --pty`, ended with the test.
pub(crate) struct Rig {
    pub(crate) running: Running,
    folder: tempfile::TempDir,
}

impl Rig {
    pub(crate) fn start(options: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("nano");
        let fixed = ["rig", "--pty", "--seconds", "600", "--link", link.to_str().unwrap()];
        let (running, port) = Running::start(&[&fixed, options].concat());
        assert!(port.starts_with("/dev/"), "{port}");
        Self { running, folder }
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    pub(crate) fn tvc(&self, arguments: &[&str]) -> Output {
        running::tvc(&[arguments, &["--port", &self.path("nano")]].concat())
    }

    /// Standard output of a command that must succeed.
    pub(crate) fn ok(&self, arguments: &[&str]) -> String {
        let output = self.tvc(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said}");
        String::from_utf8(output.stdout).unwrap()
    }

    pub(crate) fn json(&self, arguments: &[&str]) -> Value {
        running::json(&self.tvc(&[arguments, &["--json"]].concat()))
    }

    /// The error of a command that must fail with `status`, in one line.
    pub(crate) fn refused(&self, status: i32, arguments: &[&str]) -> String {
        let output = self.tvc(arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
        let errors: Vec<&str> = said.lines().filter(|l| l.starts_with("error: ")).collect();
        assert_eq!(errors.len(), 1, "{said}");
        errors[0].to_owned()
    }

    pub(crate) fn status(&self) -> Value {
        let lines = self.ok(&["monitor", "--json", "--every", "0.2", "--seconds", "0.7"]);
        let last = lines.lines().last().expect("a line of status");
        serde_json::from_str(last).unwrap()
    }

    pub(crate) fn wait_for(&self, state: &str) {
        let begun = Instant::now();
        while self.status()["state"] != state {
            assert!(begun.elapsed() < PATIENCE, "{}", self.status());
        }
    }

    /// Arms as soon as the attitude has settled and the gyro's offset has been learned at rest.
    pub(crate) fn arm(&self) -> Value {
        let begun = Instant::now();
        loop {
            let output = self.tvc(&["arm", "--json"]);
            if output.status.success() {
                return serde_json::from_slice(&output.stdout).unwrap();
            }
            let said = String::from_utf8_lossy(&output.stderr);
            let waits = ["attitude still settling", "gyro offset unknown"];
            assert!(waits.iter().any(|why| said.contains(why)), "{said}");
            assert!(begun.elapsed() < PATIENCE, "{said}");
        }
    }

    pub(crate) fn terminate(&mut self) {
        let id = self.running.0.id().to_string();
        assert!(Command::new("kill").arg(id).status().unwrap().success());
    }
}
