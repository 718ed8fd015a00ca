//! A command that goes on beside the test, such as `tvc rig --pty`.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// A `tvc` of ours, ended with the test.
pub struct Running(pub Child);

impl Running {
    /// Starts it and waits for the first line that it prints.
    pub fn start(arguments: &[&str]) -> (Self, String) {
        let mut process = Command::new(env!("CARGO_BIN_EXE_tvc"))
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let out = process.stdout.take().unwrap();
        BufReader::new(out).read_line(&mut line).unwrap();
        assert!(!line.is_empty(), "{arguments:?} ended");
        (Self(process), line.trim().to_owned())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
