//! Puts the image into a `tvc` that is to be installed, so that it works without the source tree.
//!
//! Only a release build does: `cargo fly` and `cargo tvc` (which say `TVC_IMAGE=none`) and the
//! tests build the image from the sources beside them when they need it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs, io};

use image_build::{Builder, FIRMWARE_SOURCES, Source, Toolchain, build_id, sum_of};

/// Folders of what the tool itself is made from, and what it computes with.
const TOOL_SOURCES: [&str; 10] = [
    "calibration/src",
    "client/src",
    "design/src",
    "flights/src",
    "ground/src",
    "plant/src",
    "recordings/src",
    "reports/src",
    "rig/src",
    "samd21/src",
];

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=TVC_TOOL_BUILD={:08x}", tool_build());
    let image = build_id(&tree()).expect("the sources can be read");
    println!("cargo::rustc-env=TVC_IMAGE_BUILD={image:016x}");
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

/// Tells builds of the same version apart: a sum over the sources of tool and image.
fn tool_build() -> u32 {
    let sources = [&TOOL_SOURCES[..], &FIRMWARE_SOURCES].concat();
    for source in &sources {
        println!("cargo::rerun-if-changed={}", tree().join(source).display());
    }
    sum_of(&tree(), &sources).expect("the sources can be read") as u32
}

/// The tree of sources, in which the crate lies.
fn tree() -> PathBuf {
    let own = env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let tree = Path::new(&own).parent();
    tree.expect("the crate lies in the tree").to_owned()
}

/// Builds the image into `folder`. A toolchain is looked for and not changed: that is for whoever
/// installs the tool to decide.
fn build(folder: &Path) -> io::Result<PathBuf> {
    let tree = tree();
    Builder::new(folder.to_owned(), Toolchain::find(&tree)?).build(&Source::firmware(&tree))
}
