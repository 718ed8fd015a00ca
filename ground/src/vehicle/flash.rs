//! `tvc flash`: the image onto a Nano, or into a file.

mod bootloader;
mod bossac;
mod uf2;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bossac::Bossac;
use clap::Args;
use rig::image::IMAGE_ADDRESS;

use crate::image::{Firmware, ImageOption};
use crate::vehicle::port;
use report::exit::{BadInput, Verdict};
use report::file::write_whole;
use report::kind;

/// Options of `tvc flash`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc flash                          find the Nano, enter its bootloader, write with bossac
  tvc flash --port /dev/ttyACM0      a given port
  tvc flash --image tvc-nano.elf     an image that somebody else has built
  tvc flash --uf2 /media/$USER/NANOBOOT    onto the drive of a UF2 bootloader
  tvc flash --elf f.elf --bin f.bin --uf2 f.uf2    only write files, for other programmers

The image is linked at 0x2000, above the bootloader; never write it to 0x0. Stored parameters are
kept: bossac 1.9 and newer erase only what they write, and so do UF2 bootloaders.
docs/guides/flashing.md has bossac for every system, debug probes, and the way back to a lost
bootloader.
Exit status: 0 written, 1 something failed, 2 unusable input.")]
pub struct Flash {
    /// Serial port of the Nano [default: the only SAMD21 that is connected].
    #[arg(long, value_name = "PORT", conflicts_with_all = ["elf", "bin", "uf2"])]
    pub port: Option<String>,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Write the ELF file instead, for debug probes and for `--image`.
    #[arg(long, value_name = "FILE.elf", value_parser = kind::image)]
    pub elf: Option<PathBuf>,

    /// Write the raw image instead (first byte belongs at 0x2000).
    #[arg(long, value_name = "FILE.bin", value_parser = kind::image)]
    pub bin: Option<PathBuf>,

    /// Write a UF2 file instead: a file, or the board's drive, which is the folder it shows up as.
    #[arg(long, value_name = "FILE.uf2", value_parser = kind::image_or_folder)]
    pub uf2: Option<PathBuf>,
}

/// Writes the image where `options` say.
pub fn run(options: &Flash) -> Result<Verdict> {
    if options.elf.is_some() || options.bin.is_some() || options.uf2.is_some() {
        options.uf2.as_deref().map(check_drive).transpose()?;
        return write_files(options, &options.image.firmware()?);
    }
    // A missing port or programmer is reported before the build, which takes minutes.
    let port = port::find_nano(options.port.as_deref())?;
    let bossac = Bossac::find()?;
    let image = options.image.image()?;
    if image.address() != IMAGE_ADDRESS {
        bail!(BadInput::new(format!(
            "the image is linked at 0x{:X}, in the bootloader's place: only a debug probe writes it",
            image.address()
        )));
    }
    let port = bootloader::enter(&port)?;
    bootloader::wait_until_open(&port)?;
    bossac.write(&port, image.address(), image.bytes())?;
    eprintln!("written, verified and started");
    Ok(Verdict::Met)
}

fn write_files(options: &Flash, firmware: &Firmware) -> Result<Verdict> {
    let (address, bytes) = (firmware.image.address(), firmware.image.bytes());
    let say = |path: &Path| {
        eprintln!("wrote {}: {} bytes of image for 0x{address:04X}", path.display(), bytes.len());
    };
    for (path, content) in [(&options.elf, &*firmware.elf), (&options.bin, bytes)] {
        if let Some(path) = path {
            write_whole(path, content)?;
            say(path);
        }
    }
    if let Some(path) = &options.uf2 {
        let path = if path.is_dir() { path.join("tvc-nano.uf2") } else { path.clone() };
        let blocks = uf2::encode(address, bytes);
        if is_on_a_bootloader(&path) {
            write_to_bootloader(&path, &blocks)?;
        } else {
            write_whole(&path, &blocks)?;
        }
        say(&path);
    }
    Ok(Verdict::Met)
}

/// A drive that is not there would become a file of its name.
fn check_drive(path: &Path) -> Result<()> {
    if path.extension().is_none() && !path.exists() {
        bail!(BadInput::new(format!(
            "there is no drive {}: tap the reset button twice; a file is named FILE.uf2",
            path.display()
        )));
    }
    Ok(())
}

/// True for a file on the drive of a UF2 bootloader, which has this text file (UF2 specification,
/// "Files exposed by bootloaders").
fn is_on_a_bootloader(path: &Path) -> bool {
    path.parent().is_some_and(|drive| drive.join("INFO_UF2.TXT").exists())
}

/// A bootloader takes blocks under any name and resets after the last one. A file that is first
/// written under another name would never get its own.
fn write_to_bootloader(path: &Path, blocks: &[u8]) -> Result<()> {
    let writing = || format!("writing {}", path.display());
    let mut file = File::create(path).with_context(writing)?;
    file.write_all(blocks).with_context(writing)?;
    // This fails when the drive goes away as soon as it has the last block: then it has worked.
    let _ = file.sync_all();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bootloaders_drive_is_known_by_its_text_file_and_gets_one_file() {
        let drive = tempfile::tempdir().unwrap();
        let path = drive.path().join("tvc-nano.uf2");
        assert!(!is_on_a_bootloader(&path));
        std::fs::write(drive.path().join("INFO_UF2.TXT"), "UF2 Bootloader").unwrap();
        assert!(is_on_a_bootloader(&path));
        write_to_bootloader(&path, b"blocks").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"blocks");
        assert_eq!(std::fs::read_dir(drive.path()).unwrap().count(), 2);
    }
}
