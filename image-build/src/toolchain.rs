//! The compiler for the chip: the one in use, or Debian's.

use std::env;
use std::ffi::OsString;
use std::io;
use std::path::Path;
use std::process::Command;

use crate::{TARGET, run};

/// Where Debian installs its compiler; a package of its own brings the sources of `core`.
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";

/// How to build for the chip on this machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Toolchain {
    /// The compiler in use has the target's libraries.
    Ready,
    /// Debian's compiler builds `core` from its sources.
    Debian,
}

impl Toolchain {
    /// Finds one for a source tree, and changes nothing on this machine.
    ///
    /// # Errors
    /// There is none; the error says how to install one.
    pub fn find(tree: &Path) -> io::Result<Self> {
        if has_target(tree) {
            return Ok(Self::Ready);
        }
        Self::debian(&format!("the target {TARGET} is not installed"))
    }

    /// Finds one for a source tree; adds the target where rustup can. `say` gets lines of progress
    /// for a person.
    ///
    /// # Errors
    /// There is none; the error says how to install one.
    pub fn find_or_add(tree: &Path, say: &mut dyn FnMut(&str)) -> io::Result<Self> {
        if has_target(tree) {
            return Ok(Self::Ready);
        }
        say(&format!(
            "the Rust target {TARGET} is missing: adding it with `rustup target add {TARGET}`"
        ));
        let reason = match run(&mut add_target(tree)) {
            Ok(output) if output.status.success() && has_target(tree) => return Ok(Self::Ready),
            Ok(output) => format!(
                "rustup said: {}",
                String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or("nothing")
            ),
            Err(_) => "there is no rustup".to_owned(),
        };
        say(&format!("{reason}; looking for Debian's compiler"));
        let found = Self::debian(&reason)?;
        say("building with Debian's compiler, and the core library first");
        Ok(found)
    }

    fn debian(reason: &str) -> io::Result<Self> {
        if Path::new(DEBIAN_CARGO).exists() && has_core_sources() {
            return Ok(Self::Debian);
        }
        Err(io::Error::other(format!(
            "no Rust toolchain here can build for the chip ({reason}; Debian's compiler with the \
             sources of core is not there). Either install it with `rustup target add {TARGET}`, or \
             on Debian with `apt install rustc-web cargo-web rust-web-src lld`"
        )))
    }

    /// `cargo build` of this toolchain, the rest of its arguments still to come.
    pub(crate) fn build(self) -> Command {
        match self {
            Self::Ready => {
                let mut command =
                    Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
                command.arg("build");
                command
            }
            Self::Debian => {
                let mut command = Command::new(DEBIAN_CARGO);
                command
                    .env("RUSTC", DEBIAN_RUSTC)
                    .env("RUSTC_BOOTSTRAP", "1")
                    .env("CARGO_TARGET_THUMBV6M_NONE_EABI_LINKER", "ld.lld")
                    .args(["build", "-Zbuild-std=core"]);
                command
            }
        }
    }
}

/// True when the compiler that cargo will use has the target's core library.
fn has_target(tree: &Path) -> bool {
    let Some(folder) = answer(&mut print_target_folder(tree)) else {
        return false;
    };
    std::fs::read_dir(folder).is_ok_and(|mut files| {
        files.any(|file| {
            file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore"))
        })
    })
}

fn add_target(tree: &Path) -> Command {
    let mut command = in_tree(tree, "rustup".into());
    command.args(["target", "add", TARGET]);
    command
}

fn print_target_folder(tree: &Path) -> Command {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = in_tree(tree, rustc);
    command.args(["--print", "target-libdir", "--target", TARGET]);
    command
}

/// A program of the toolchain, run in the tree: rustup takes the toolchain from the
/// `rust-toolchain.toml` there, and another folder may have another toolchain.
fn in_tree(tree: &Path, program: OsString) -> Command {
    let mut command = Command::new(program);
    command.current_dir(tree);
    command
}

fn has_core_sources() -> bool {
    answer(Command::new(DEBIAN_RUSTC).args(["--print", "sysroot"])).is_some_and(|sysroot| {
        Path::new(&sysroot).join("lib/rustlib/src/rust/library/core").exists()
    })
}

/// What a command prints; `None` if it cannot be run.
fn answer(command: &mut Command) -> Option<String> {
    let output = run(command).ok()?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_decides_the_toolchain_wherever_the_tool_is_started() {
        let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        for command in [add_target(&tree), print_target_folder(&tree)] {
            let folder = command.get_current_dir().expect("a folder is set");
            assert!(folder.join("rust-toolchain.toml").exists(), "{command:?}");
        }
    }
}
