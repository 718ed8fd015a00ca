//! Puts the image into a `tvc` that is to be installed, so that it works without the source tree.
//!
//! Only a release build does: `cargo fly` and `cargo tvc` (which say `TVC_IMAGE=none`) and the
//! tests build the image from the sources beside them when they need it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs};

use image_build::{BuildError, Builder, FIRMWARE_SOURCES, Source, Toolchain};

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=TVC_IMAGE");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let is_release = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let is_wanted = is_release && env::var("TVC_IMAGE").as_deref() != Ok("none");
    let image = if is_wanted {
        match build(&out.join("chip")) {
            Ok(path) => fs::read(path).expect("cargo has written the image"),
            Err(error) => {
                for line in error.to_string().lines() {
                    println!("cargo::error={line}");
                }
                return ExitCode::FAILURE;
            }
        }
    } else {
        Vec::new()
    };
    fs::write(out.join("image.elf"), image).expect("OUT_DIR can be written");
    ExitCode::SUCCESS
}

/// Builds the image into `folder`. A toolchain is looked for and not changed: that is for whoever
/// installs the tool to decide.
fn build(folder: &Path) -> Result<PathBuf, BuildError> {
    let own = env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let tree = Path::new(&own)
        .parent()
        .expect("the crate lies in the tree");
    for source in FIRMWARE_SOURCES {
        println!("cargo::rerun-if-changed={}", tree.join(source).display());
    }
    Builder::new(folder.to_owned(), Toolchain::find(tree)?).build(&Source::firmware(tree))
}
