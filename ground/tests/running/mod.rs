//! `tvc` or `lab` ([`crate::PROGRAM`]) as a process: a command that ends, and one that goes on
//! beside the test, such as
//! `tvc rig --pty`.
#![allow(dead_code, reason = "every test file takes what it needs")]

pub(crate) mod golden;
pub(crate) mod keys;

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// `tvc` with these arguments, still to be run.
pub(crate) fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(crate::PROGRAM);
    command.args(arguments);
    command
}

/// What `tvc` with these arguments prints, and its status.
pub(crate) fn tvc(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

/// Standard error.
pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The object on standard output of a command that must succeed.
pub(crate) fn json(output: &Output) -> Value {
    assert_eq!(output.status.code(), Some(0), "{}", said(output));
    object(output)
}

/// The object on standard output, whatever the status.
pub(crate) fn object(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", said(output)))
}

/// The one line on standard error of a command with unusable input: status 2, nothing on standard
/// output.
pub(crate) fn refused(arguments: &[&str]) -> String {
    let output = tvc(arguments);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    assert_eq!(said.lines().count(), 1, "{arguments:?}: {said}");
    assert!(said.starts_with("error: "), "{arguments:?}: {said}");
    said
}

/// The command is [`refused`] with `part` in the line.
pub(crate) fn assert_refused(arguments: &[&str], part: &str) {
    let said = refused(arguments);
    assert!(said.contains(part), "{arguments:?}: {part} in {said}");
}

/// Every command below `parents`, by what their help lists, and its own help.
pub(crate) fn commands_below(parents: &[String]) -> Vec<(Vec<String>, String)> {
    let help = help_of(parents);
    // The help of `tvc` itself has its commands in groups; that of others under one head.
    let commands = match help.split_once("Commands:\n") {
        Some((_, below)) => below.split("\n\n").next().unwrap_or_default(),
        None if parents.is_empty() => help.as_str(),
        None => "",
    };
    let listed = commands
        .lines()
        // A description that goes on in the next line stands further in.
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
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
    let mut arguments: Vec<&str> = command.iter().map(String::as_str).collect();
    arguments.push("--help");
    let output = tvc(&arguments);
    assert!(output.status.success(), "{command:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// A `tvc` of ours, ended with the test.
pub(crate) struct Running(pub Child);

impl Running {
    /// Starts it and waits for the first line that it prints.
    pub(crate) fn start(arguments: &[&str]) -> (Self, String) {
        Self::of(command(arguments).stderr(Stdio::null()))
    }

    /// Starts this command, likewise.
    pub(crate) fn of(command: &mut Command) -> (Self, String) {
        let mut process = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let out = process.stdout.take().unwrap();
        BufReader::new(out).read_line(&mut line).unwrap();
        assert!(!line.is_empty(), "{command:?} ended");
        (Self(process), line.trim().to_owned())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
