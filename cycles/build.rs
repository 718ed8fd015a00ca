//! Tells the linker where the image goes. On the host there is nothing to do.

use std::path::PathBuf;
use std::{env, fs};

/// What the firmware's `memory.x` includes: flash above the bootloader.
const FLASH: &str = "MEMORY { FLASH : ORIGIN = 0x2000, LENGTH = 248K }\n";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(out.join("flash.x"), FLASH).expect("OUT_DIR can be written");
    let root = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    println!("cargo::rerun-if-changed=../memory.x");
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-search={root}/..");
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
}
