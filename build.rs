//! Tells the linker where the image goes. On the host there is nothing to do.

use std::path::PathBuf;
use std::{env, fs};

/// Above the Arduino bootloader, which takes 8 KB, and below the last 1 KB, where parameters are stored.
const ABOVE_BOOTLOADER: &str = "MEMORY { FLASH : ORIGIN = 0x2000, LENGTH = 247K }\n";

/// A debug probe's flash algorithm erases 16 KB at a time and would take the bootloader with the image, so the image takes
/// the bootloader's place.
const IN_ITS_PLACE: &str = "MEMORY { FLASH : ORIGIN = 0x0, LENGTH = 255K }\n";

fn main() {
    println!("cargo::rerun-if-changed=memory.x");
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let probe = env::var_os("CARGO_FEATURE_PROBE").is_some();
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let flash = if probe {
        IN_ITS_PLACE
    } else {
        ABOVE_BOOTLOADER
    };
    fs::write(out.join("flash.x"), flash).expect("OUT_DIR can be written");
    let root = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-search={root}");
    // Without --nmagic the linker pads segments to its page size, beyond what the flash holds at 0x2000.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    if probe {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
}
