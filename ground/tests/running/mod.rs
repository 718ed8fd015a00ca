//! The tool as a process: a command that ends, and one that goes on beside the test, such as
//! `tvc rig --pty`.
#![allow(dead_code, reason = "every test file takes what it needs")]

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// `tvc`, its arguments still to come.
pub fn tvc() -> Command {
    Command::new(env!("CARGO_BIN_EXE_tvc"))
}

/// Every command below `parents`, by what their help lists, and its own help.
pub fn commands_below(parents: &[String]) -> Vec<(Vec<String>, String)> {
    let help = help_of(parents);
    let listed = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        // A description that goes on in the next line stands further in.
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help");
    listed
        .flat_map(|name| {
            let command = [parents, &[name.to_owned()]].concat();
            let mut all = vec![(command.clone(), help_of(&command))];
            all.extend(commands_below(&command));
            all
        })
        .collect()
}

fn help_of(command: &[String]) -> String {
    let output = tvc().args(command).arg("--help").output().unwrap();
    assert!(output.status.success(), "{command:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// A `tvc` of ours, ended with the test.
pub struct Running(pub Child);

impl Running {
    /// Starts it and waits for the first line that it prints.
    pub fn start(arguments: &[&str]) -> (Self, String) {
        let mut process = tvc()
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
