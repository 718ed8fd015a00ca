//! Tells the linker where the image goes, and the image its build id. On the host there is nothing
//! to do.

use std::path::{Path, PathBuf};
use std::{env, fs};

/// Above the Arduino bootloader, which takes 8 KB, and below the last 1 KB, where parameters are
/// stored.
const ABOVE_BOOTLOADER: &str = "MEMORY { FLASH : ORIGIN = 0x2000, LENGTH = 247K }\n";

/// In the bootloader's place, for a board that is only ever written by a debug probe (the feature
/// `no-bootloader`).
const IN_ITS_PLACE: &str = "MEMORY { FLASH : ORIGIN = 0x0, LENGTH = 255K }\n";

/// Folders of what the image is made from.
const SOURCES: [&str; 4] = ["src", "fusion/src", "pid/src", "bno055-driver/src"];

fn main() {
    println!("cargo::rerun-if-changed=memory.x");
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let has = |feature| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let flash = if has("NO_BOOTLOADER") {
        IN_ITS_PLACE
    } else {
        ABOVE_BOOTLOADER
    };
    fs::write(out.join("flash.x"), flash).expect("OUT_DIR can be written");
    let root = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    println!(
        "cargo::rustc-env=TVC_BUILD_ID={:016x}",
        build_id(Path::new(&root))
    );
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

/// FNV-1a over names and contents of the sources, 64 bits.
fn build_id(root: &Path) -> u64 {
    let mut files = Vec::new();
    for folder in SOURCES {
        println!("cargo::rerun-if-changed={folder}");
        collect(&root.join(folder), &mut files);
    }
    files.sort();
    let mut id = 0xCBF2_9CE4_8422_2325_u64;
    for file in files {
        let name = file
            .strip_prefix(root)
            .unwrap_or(&file)
            .to_string_lossy()
            .replace('\\', "/");
        let content = fs::read(&file).expect("a source can be read");
        for byte in name.bytes().chain(content) {
            id = (id ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
    id
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources can be read") {
        let path = entry.expect("a folder of sources can be read").path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
}
