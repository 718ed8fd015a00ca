//! What `cargo fly`, `cargo tvc` and `cargo lab` start. The first argument names the program.
//!
//! `cargo run --quiet` alone would build the ground tool for minutes without a word the first time;
//! without `--quiet` it would add its own lines to every message of the tool. So the first build is
//! shown, later ones are not. The first `cargo fly` also begins the image's build beside the
//! tool's, because each of the two leaves a processor core idle for much of its time.
//!
//! The tool takes the launcher's place: who ends `cargo tvc test` ends the tool, which then leaves
//! the vehicle neutral.

#![forbid(unsafe_code)]

use std::env;
use std::ffi::OsStr;
use std::io;
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::thread;

use image_build::{Builder, Source};

/// The profile that the ground tool is built with, and the folder below `target` where it then
/// lies.
const PROFILE: &str = "tool";
/// The programs and the packages that they are built from.
const PROGRAMS: [(&str, &str); 2] = [("tvc", "ground"), ("lab", "lab")];

fn main() -> ExitCode {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let name = env::args().nth(1).unwrap_or_default();
    let Some((program, package)) = PROGRAMS.into_iter().find(|(program, _)| *program == name)
    else {
        eprintln!("error: this starts tvc or lab; use `cargo fly`, `cargo tvc` or `cargo lab`");
        return ExitCode::from(2);
    };
    let cargo_command = |verb| cargo_command(&cargo, verb, program, package);
    let target = target_folder();
    let is_built = |target: &PathBuf| {
        let name = format!("{program}{}", env::consts::EXE_SUFFIX);
        target.join(PROFILE).join(name).exists()
    };
    if !target.as_ref().is_some_and(is_built) {
        eprintln!("building {program}; the first time this takes some minutes");
        let flies = env::args_os().nth(2).is_some_and(|command| command == "fly");
        let image = flies.then(|| thread::spawn(build_image));
        let built = status(&mut cargo_command("build"));
        if let Some(image) = image {
            // It has no result: the tool builds the image again and reports what goes wrong.
            let _ = image.join();
        }
        if built != 0 {
            return ExitCode::from(built);
        }
    }
    let mut tool = cargo_command("run");
    tool.args(["--quiet", "--"]).args(env::args_os().skip(2));
    become_one(&mut tool)
}

/// Cargo's folder of results, two above this program.
fn target_folder() -> Option<PathBuf> {
    let own = env::current_exe().ok()?;
    Some(own.parent()?.parent()?.to_path_buf())
}

/// Builds the image of the tree round this folder without a word.
fn build_image() {
    let folder = env::current_dir().unwrap_or_default();
    if let Some(tree) = image_build::tree_around(&folder)
        && let Ok(builder) = Builder::in_tree(tree, &mut |_| {})
    {
        let _ = builder.build(&Source::firmware(tree));
    }
}

/// Cargo's work on a program.
fn cargo_command(cargo: &OsStr, verb: &str, program: &str, package: &str) -> Command {
    let mut command = Command::new(cargo);
    // The image is built from the sources beside the tool, and no second time into it.
    command.args([verb, "--profile", PROFILE, "--package", package, "--bin", program]);
    command.env("TVC_IMAGE", "none");
    command
}

/// Runs `command` in the place of this process, so that a signal to the launcher reaches the tool.
#[cfg(unix)]
fn become_one(command: &mut Command) -> ExitCode {
    use std::os::unix::process::CommandExt;

    let error = command.exec();
    cannot_run(command, &error);
    ExitCode::FAILURE
}

/// Runs `command` to its end. Ctrl-C reaches it as well as this process, which waits until the tool
/// has left the vehicle neutral.
#[cfg(not(unix))]
fn become_one(command: &mut Command) -> ExitCode {
    // Without a handler this process would end first; the tool would still end by itself.
    let _ = ctrlc::set_handler(|| {});
    ExitCode::from(status(command))
}

/// Runs `command` and gives the exit status, 1 where there is none.
fn status(command: &mut Command) -> u8 {
    match command.status() {
        Ok(status) => status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1),
        Err(error) => {
            cannot_run(command, &error);
            1
        }
    }
}

fn cannot_run(command: &Command, error: &io::Error) {
    let program = command.get_program().to_string_lossy();
    eprintln!("error: cannot run {program}: {error}");
}
