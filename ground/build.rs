//! Puts the image into a `tvc` that is to be installed, so that it works without the source tree.
//!
//! Only a release build does: `cargo fly` and `cargo tvc` (which say `TVC_IMAGE=none`) and the
//! tests build the image from the sources beside them when they need it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs};

use image_build::{BuildError, Builder, FIRMWARE_SOURCES, Source, Toolchain, build_id};

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

/// Tells builds of the same version apart: FNV-1a over the sources of tool and image, 32 bits.
fn tool_build() -> u32 {
    let mut files = Vec::new();
    for source in TOOL_SOURCES.into_iter().chain(FIRMWARE_SOURCES) {
        let path = tree().join(source);
        println!("cargo::rerun-if-changed={}", path.display());
        collect(&path, &mut files);
    }
    files.sort();
    let bytes = files.iter().flat_map(|path| fs::read(path).unwrap_or_default());
    bytes.fold(0x811C_9DC5, |sum, byte| (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

/// The files at or below a path.
fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    match fs::read_dir(path) {
        Ok(inner) => {
            for entry in inner.flatten() {
                collect(&entry.path(), files);
            }
        }
        Err(_) => files.push(path.to_owned()),
    }
}

/// The tree of sources, in which the crate lies.
fn tree() -> PathBuf {
    let own = env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let tree = Path::new(&own).parent();
    tree.expect("the crate lies in the tree").to_owned()
}

/// Builds the image into `folder`. A toolchain is looked for and not changed: that is for whoever
/// installs the tool to decide.
fn build(folder: &Path) -> Result<PathBuf, BuildError> {
    let tree = tree();
    for source in FIRMWARE_SOURCES {
        println!("cargo::rerun-if-changed={}", tree.join(source).display());
    }
    Builder::new(folder.to_owned(), Toolchain::find(&tree)?).build(&Source::firmware(&tree))
}
