//! Tells the linker where the image goes.

use std::path::PathBuf;
use std::{env, fs};

/// All of the chip's memory above the bootloader, as the firmware has its flash.
const MEMORY: &str = "\
MEMORY
{
  FLASH : ORIGIN = 0x2000, LENGTH = 248K
  RAM   : ORIGIN = 0x20000000, LENGTH = 32K
}
";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(out.join("memory.x"), MEMORY).expect("OUT_DIR can be written");
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
}
