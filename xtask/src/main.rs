//! What `cargo fly` and `cargo tvc` start.
//!
//! `cargo run --quiet` alone would build the ground tool for minutes without a word the first time;
//! without `--quiet` it would add its own lines to every message of the tool. So the first build is
//! shown, later ones are not. The first `cargo fly` also begins the image's build beside the
//! tool's, because each of the two leaves a processor core idle for much of its time.

#![forbid(unsafe_code)]

use std::env;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::thread;

use image_build::{Builder, Source};

/// The profile that the ground tool is built with, and the folder below `target` where it then
/// lies.
const PROFILE: &str = "tool";
/// The ground tool, as cargo names it.
const TOOL: [&str; 6] = ["--profile", PROFILE, "--package", "ground", "--bin", "tvc"];

fn main() -> ExitCode {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let target = target_folder();
    let is_built = |target: &PathBuf| {
        let name = format!("tvc{}", env::consts::EXE_SUFFIX);
        target.join(PROFILE).join(name).exists()
    };
    if !target.as_ref().is_some_and(is_built) {
        eprintln!("building the ground tool; the first time this takes some minutes");
        let flies = env::args_os()
            .nth(1)
            .is_some_and(|command| command == "fly");
        let image = flies.then(|| thread::spawn(build_image));
        let status = cargo_command(&cargo, "build", []);
        if let Some(image) = image {
            // It has no result: the tool builds the image again and reports what goes wrong.
            let _ = image.join();
        }
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

/// Runs cargo on the tool and gives the exit status, 1 where there is none.
fn cargo_command(cargo: &OsStr, verb: &str, more: impl IntoIterator<Item = OsString>) -> u8 {
    let status = Command::new(cargo)
        .arg(verb)
        .args(TOOL)
        .args(more)
        // The image is built from the sources beside the tool, and no second time into it.
        .env("TVC_IMAGE", "none")
        .status();
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
