//! What `cargo fly` and `cargo tvc` start.
//!
//! `cargo run --quiet` alone would build the ground tool for minutes without a word the first time;
//! without `--quiet` it would add its own lines to every message of the tool. So the first build is
//! shown, later ones are not.

#![forbid(unsafe_code)]

use std::env;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// The ground tool, as cargo names it.
const TOOL: [&str; 6] = ["--profile", PROFILE, "--package", "ground", "--bin", "tvc"];

/// The profile that it is built with, and the folder below `target` where it then lies.
const PROFILE: &str = "tool";

fn main() -> ExitCode {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    if !tool().is_some_and(|path| path.exists()) {
        eprintln!("building the ground tool; the first time this takes some minutes");
        let status = cargo_command(&cargo, "build", []);
        if status != 0 {
            return ExitCode::from(status);
        }
    }
    let quietly = [OsString::from("--quiet"), OsString::from("--")];
    ExitCode::from(cargo_command(
        &cargo,
        "run",
        quietly.into_iter().chain(env::args_os().skip(1)),
    ))
}

/// Where the tool is once built: beside this program, in the folder of its profile.
fn tool() -> Option<PathBuf> {
    let own = env::current_exe().ok()?;
    let name = format!("tvc{}", env::consts::EXE_SUFFIX);
    Some(own.parent()?.parent()?.join(PROFILE).join(name))
}

/// Runs cargo on the tool and gives the exit status, 1 where there is none.
fn cargo_command(cargo: &OsStr, verb: &str, more: impl IntoIterator<Item = OsString>) -> u8 {
    let status = Command::new(cargo).arg(verb).args(TOOL).args(more).status();
    match status {
        Ok(status) => status
            .code()
            .and_then(|code| u8::try_from(code).ok())
            .unwrap_or(1),
        Err(error) => {
            eprintln!("error: cannot run {}: {error}", cargo.to_string_lossy());
            1
        }
    }
}
