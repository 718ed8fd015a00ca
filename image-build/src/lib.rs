//! Builds what runs on the chip: the firmware of a source tree, and other images in the same way.
//!
//! Every build of the image goes through here (`cargo fly`, `tvc`, the tests, the build script that
//! puts the image into an installed `tvc`), so that all of them build the same bytes. It has no
//! dependencies, because it is compiled before the first line that a newcomer sees.

#![forbid(unsafe_code)]

mod build_id;
mod seal;
mod toolchain;

pub use build_id::{build_id, sum_of};
pub use seal::SEAL;
pub use toolchain::Toolchain;

use std::env;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What images are built for.
pub const TARGET: &str = "thumbv6m-none-eabi";

/// The firmware's package and binary.
const FIRMWARE: &str = "tvc-nano";

/// What the firmware is made from, below its tree: a build script that embeds it runs again when
/// one of these changes.
pub const FIRMWARE_SOURCES: [&str; 10] = [
    "Cargo.toml",
    "Cargo.lock",
    "build.rs",
    "memory.x",
    "src",
    "fusion/src",
    "pid/src",
    "imu/src",
    "bno055-driver/src",
    "lsm6ds3-driver/src",
];

/// Flags of the compiler. Only debug information holds folders of this machine: without it an ELF
/// file has the same bytes wherever it was built. It does not change what goes into flash.
const FLAGS: &str = "-Cstrip=debuginfo";
/// Of the flight image alone, with cargo's separator: fewer functions are inlined than the compiler
/// would, which takes 1.1 KB less flash for as many cycles.
const FLIGHT_FLAGS: &str = "\u{1f}-Cllvm-args=-inline-threshold=20";

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

impl<'a> Source<'a> {
    /// The firmware of a source tree, as it flies.
    pub fn firmware(tree: &'a Path) -> Self {
        Self { folder: tree, package: FIRMWARE, profile: "firmware", features: &[] }
    }
}

/// The folder of the firmware's source tree: `folder` or the nearest one above it.
pub fn tree_around(folder: &Path) -> Option<&Path> {
    let package = format!("name = \"{FIRMWARE}\"");
    folder.ancestors().find(|folder| {
        folder.join("memory.x").is_file()
            && std::fs::read_to_string(folder.join("Cargo.toml"))
                .is_ok_and(|manifest| manifest.lines().any(|line| line == package))
    })
}

/// A toolchain that can build for the chip, and the folder that it builds into.
#[derive(Debug)]
pub struct Builder {
    folder: PathBuf,
    toolchain: Toolchain,
}

impl Builder {
    /// Builds into `target/chip` of the tree, so that a build never waits for the lock of the cargo
    /// that runs the caller. A missing Rust target is added through rustup. `say` gets lines of
    /// progress for a person.
    ///
    /// # Errors
    /// No toolchain.
    pub fn in_tree(tree: &Path, say: &mut dyn FnMut(&str)) -> io::Result<Self> {
        let target = match env::var_os("CARGO_TARGET_DIR") {
            Some(folder) => std::path::absolute(&folder).unwrap_or_else(|_| folder.into()),
            None => tree.join("target"),
        };
        let toolchain = Toolchain::find_or_add(tree, say)?;
        Ok(Self::new(target.join("chip"), toolchain))
    }

    /// Builds into `folder`, an absolute path.
    pub fn new(folder: PathBuf, toolchain: Toolchain) -> Self {
        Self { folder, toolchain }
    }

    /// The file that a build of this source writes.
    pub fn path(&self, source: &Source<'_>) -> PathBuf {
        self.folder.join(TARGET).join(source.profile).join(source.package)
    }

    /// Builds an image, writes its sums into it, and gives the path of its ELF file.
    ///
    /// # Errors
    /// Cargo could not be started, or the build failed.
    pub fn build(&self, source: &Source<'_>) -> io::Result<PathBuf> {
        let failed = |why: &str| io::Error::other(format!("the image does not build:\n{why}"));
        let output = run(&mut self.command(source))?;
        if !output.status.success() {
            return Err(failed(String::from_utf8_lossy(&output.stderr).trim()));
        }
        let path = self.path(source);
        seal::seal(&path).map_err(|error| failed(&format!("{}: {error}", path.display())))?;
        Ok(path)
    }

    fn command(&self, source: &Source<'_>) -> Command {
        let of_flight = if source.profile == "firmware" { FLIGHT_FLAGS } else { "" };
        let flags = format!("{FLAGS}{of_flight}");
        let mut command = self.toolchain.build();
        command
            .current_dir(source.folder)
            .args(["--package", source.package, "--bin", source.package])
            .args(["--target", TARGET, "--profile", source.profile])
            .arg("--features")
            .arg(source.features.join(","))
            .arg("--target-dir")
            .arg(&self.folder)
            // This goes before every other place for flags: those that are meant for the host's
            // build must not change the image.
            .env("CARGO_ENCODED_RUSTFLAGS", flags)
            .env_remove("CARGO_BUILD_TARGET");
        command
    }
}

fn run(command: &mut Command) -> io::Result<Output> {
    command.output().map_err(|error| {
        let program = command.get_program().to_string_lossy();
        io::Error::other(format!("cannot run {program}: {error}"))
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn tree() -> &'static Path {
        let own = Path::new(env!("CARGO_MANIFEST_DIR"));
        own.parent().expect("the crate lies in the tree")
    }

    #[test]
    fn the_tree_is_found_from_within_and_nowhere_else() {
        assert_eq!(tree_around(&tree().join("fusion/src")), Some(tree()));
        assert_eq!(tree_around(tree()), Some(tree()));
        assert_eq!(tree_around(&env::temp_dir()), None);
    }

    #[test]
    fn all_that_the_firmware_is_made_from_is_there() {
        for source in FIRMWARE_SOURCES {
            assert!(tree().join(source).exists(), "{source}");
        }
        for source in build_id::SOURCES {
            assert!(FIRMWARE_SOURCES.contains(&source), "{source}");
        }
    }

    #[test]
    fn the_build_id_covers_every_crate_that_the_firmware_depends_on() {
        let manifest = fs::read_to_string(tree().join("Cargo.toml")).unwrap();
        let (_, after) = manifest.split_once("\n[dependencies]\n").unwrap();
        let (dependencies, _) = after.split_once("\n[").unwrap();
        let crates: Vec<_> = dependencies
            .lines()
            .filter_map(|line| line.strip_suffix(".workspace = true"))
            .filter_map(|name| {
                let row = format!("\n{name} = {{ path = \"");
                let (_, path) = manifest.split_once(&row)?;
                path.split('"').next()
            })
            .collect();
        assert_eq!(crates.len() + 1, build_id::SOURCES.len(), "{crates:?}");
        for folder in crates {
            let sources = format!("{folder}/src");
            assert!(build_id::SOURCES.contains(&sources.as_str()), "{sources}");
        }
    }
}
