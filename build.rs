//! Gives the image its memory map. On the host there is nothing to do.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-changed=memory.x");
    println!("cargo::rerun-if-changed=memory-probe.x");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let probe = env::var_os("CARGO_FEATURE_PROBE").is_some();
    let map = if probe { "memory-probe.x" } else { "memory.x" };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    // cortex-m-rt's link.x includes a file of this name.
    fs::copy(map, out.join("memory.x")).expect("the memory map is beside build.rs");
    println!("cargo::rustc-link-search={}", out.display());
    // Without --nmagic the linker pads segments to its page size, beyond what the flash holds at 0x2000.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    if probe {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
}
