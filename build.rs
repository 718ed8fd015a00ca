//! Tells the linker where the image goes, and the image its build id. On the host there is nothing
//! to do.

use std::path::{Path, PathBuf};
use std::{env, fs};

use image_build::{FIRMWARE_SOURCES, build_id};

/// Above the Arduino bootloader, which takes 8 KB, and below the last 2 KB, where parameters are
/// stored.
const ABOVE_BOOTLOADER: &str = "MEMORY { FLASH : ORIGIN = 0x2000, LENGTH = 246K }\n";

/// In the bootloader's place, for a board that is only ever written by a debug probe (the feature
/// `no-bootloader`).
const IN_ITS_PLACE: &str = "MEMORY { FLASH : ORIGIN = 0x0, LENGTH = 254K }\n";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let has = |feature| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let flash = if has("NO_BOOTLOADER") { IN_ITS_PLACE } else { ABOVE_BOOTLOADER };
    fs::write(out.join("flash.x"), flash).expect("OUT_DIR can be written");
    let root = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    for source in FIRMWARE_SOURCES {
        println!("cargo::rerun-if-changed={source}");
    }
    let id = build_id(Path::new(&root)).expect("the sources can be read");
    println!("cargo::rustc-env=TVC_BUILD_ID={id:016x}");
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-search={root}");
    // Without --nmagic the linker pads segments to its page size, beyond what the flash holds at
    // 0x2000.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    if has("PROBE") {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
}
