//! Builds what runs on the chip: the firmware of the workspace that this crate belongs to, and
//! other images in the same way.

use super::{Image, ImageError};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub(super) const TARGET: &str = "thumbv6m-none-eabi";

/// Where Debian installs its compiler; a package of its own brings the sources of `core`.
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";

/// How to build for the chip on this machine.
enum Toolchain {
    /// The compiler in use has the target's libraries.
    Ready,
    /// Debian's compiler builds `core` from its sources.
    Debian,
}

/// A binary for the chip and how it is to be built.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Folder of the package or of its workspace.
    pub folder: &'a Path,
    /// Package and binary, which have one name.
    pub package: &'a str,
    /// Profile of cargo; not `dev`, whose output folder has another name.
    pub profile: &'a str,
    /// Features of the package.
    pub features: &'a [&'a str],
}

/// A toolchain that can build for the chip, and the folder that it builds into.
pub struct Builder {
    toolchain: Toolchain,
    /// `target/chip`, so that a build never waits for the lock of the cargo that runs the caller.
    folder: PathBuf,
}

impl Builder {
    /// Finds a toolchain; a missing Rust target is added through rustup. `say` gets lines of
    /// progress for a person.
    ///
    /// # Errors
    /// [`ImageError::Toolchain`].
    pub fn new(say: &mut dyn FnMut(&str)) -> Result<Self, ImageError> {
        let toolchain = toolchain(say)?;
        if matches!(toolchain, Toolchain::Debian) {
            say("building with Debian's compiler, and the core library first");
        }
        let folder = match std::env::var_os("CARGO_TARGET_DIR") {
            Some(folder) => {
                std::path::absolute(PathBuf::from(&folder)).unwrap_or_else(|_| folder.into())
            }
            None => workspace().join("target"),
        };
        Ok(Self {
            toolchain,
            folder: folder.join("chip"),
        })
    }

    /// The file that a build of this source writes.
    fn path(&self, source: &Source<'_>) -> PathBuf {
        self.folder
            .join(TARGET)
            .join(source.profile)
            .join(source.package)
    }

    /// Builds an image and reads it.
    ///
    /// # Errors
    /// Every [`ImageError`] but [`ImageError::Toolchain`].
    pub fn build(&self, source: &Source<'_>) -> Result<Image, ImageError> {
        let mut command = match self.toolchain {
            Toolchain::Ready => {
                Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
            }
            Toolchain::Debian => {
                let mut command = Command::new(DEBIAN_CARGO);
                command
                    .env("RUSTC", DEBIAN_RUSTC)
                    .env("RUSTC_BOOTSTRAP", "1")
                    .env("CARGO_TARGET_THUMBV6M_NONE_EABI_LINKER", "ld.lld");
                command
            }
        };
        command.arg("build");
        if matches!(self.toolchain, Toolchain::Debian) {
            command.arg("-Zbuild-std=core");
        }
        command
            .current_dir(source.folder)
            .args(["--package", source.package, "--bin", source.package])
            .args(["--target", TARGET, "--profile", source.profile])
            .arg("--features")
            .arg(source.features.join(","))
            .arg("--target-dir")
            .arg(&self.folder)
            // Flags that are meant for the host's build must not change the image.
            .env_remove("RUSTFLAGS")
            .env_remove("CARGO_ENCODED_RUSTFLAGS")
            .env_remove("CARGO_BUILD_TARGET");
        let output = run(&mut command)?;
        if !output.status.success() {
            return Err(ImageError::Build {
                output: String::from_utf8_lossy(&output.stderr).trim().to_owned(),
            });
        }
        Image::open(&self.path(source))
    }
}

/// Builds the firmware for the chip and reads it. `say` gets lines of progress for a person.
///
/// # Errors
/// Every [`ImageError`].
pub fn build(say: &mut dyn FnMut(&str)) -> Result<Image, ImageError> {
    let workspace = workspace();
    let firmware = Source {
        folder: &workspace,
        package: "tvc-nano",
        profile: "firmware",
        features: &[],
    };
    let builder = Builder::new(say)?;
    if !builder.path(&firmware).exists() {
        say("building the image for the chip; the first time this takes a minute or two");
    }
    builder.build(&firmware)
}

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Finds a toolchain; adds the target where rustup can.
fn toolchain(say: &mut dyn FnMut(&str)) -> Result<Toolchain, ImageError> {
    if has_target() {
        return Ok(Toolchain::Ready);
    }
    say(&format!(
        "the Rust target {TARGET} is missing: adding it with `rustup target add {TARGET}`"
    ));
    let reason = match run(&mut add_target()) {
        Ok(output) if output.status.success() && has_target() => return Ok(Toolchain::Ready),
        Ok(output) => format!(
            "rustup said: {}",
            String::from_utf8_lossy(&output.stderr)
                .lines()
                .last()
                .unwrap_or("nothing")
        ),
        Err(_) => "there is no rustup".to_owned(),
    };
    say(&format!("{reason}; looking for Debian's compiler"));
    if Path::new(DEBIAN_CARGO).exists() && has_core_sources() {
        return Ok(Toolchain::Debian);
    }
    Err(ImageError::Toolchain {
        reason: format!("{reason}; Debian's compiler with the sources of core is not there"),
    })
}

/// True when the compiler that cargo will use has the target's core library.
fn has_target() -> bool {
    let Some(folder) = answer(&mut print_target_folder()) else {
        return false;
    };
    std::fs::read_dir(folder).is_ok_and(|mut files| {
        files.any(|file| {
            file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore"))
        })
    })
}

fn add_target() -> Command {
    let mut command = in_workspace("rustup".into());
    command.args(["target", "add", TARGET]);
    command
}

fn print_target_folder() -> Command {
    let mut command = in_workspace(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    command.args(["--print", "target-libdir", "--target", TARGET]);
    command
}

/// A program of the toolchain, run in the workspace: rustup takes the toolchain from the
/// `rust-toolchain.toml` there, and another folder may have another toolchain.
fn in_workspace(program: OsString) -> Command {
    let mut command = Command::new(program);
    command.current_dir(workspace());
    command
}

fn has_core_sources() -> bool {
    answer(Command::new(DEBIAN_RUSTC).args(["--print", "sysroot"])).is_some_and(|sysroot| {
        Path::new(&sysroot)
            .join("lib/rustlib/src/rust/library/core")
            .exists()
    })
}

/// What a command prints; `None` if it cannot be run.
fn answer(command: &mut Command) -> Option<String> {
    let output = run(command).ok()?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

fn run(command: &mut Command) -> Result<Output, ImageError> {
    command.output().map_err(|source| ImageError::Program {
        program: command.get_program().to_string_lossy().into_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_workspace_decides_the_toolchain_wherever_the_tool_is_started() {
        for command in [add_target(), print_target_folder()] {
            let folder = command.get_current_dir().expect("a folder is set");
            assert!(folder.join("rust-toolchain.toml").exists(), "{command:?}");
        }
    }
}
