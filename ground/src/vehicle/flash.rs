//! `tvc flash`: the image onto a Nano.
//!
//! The bootloader is entered by the 1200-baud touch: the port is opened at 1200 baud and DTR is
//! dropped, upon which the running firmware (unless it is armed) resets into the bootloader, which
//! shows up as another port. `bossac` writes the image above the bootloader.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rig::image::{self, Image};

use crate::out::exit::Verdict;
use crate::out::file::write_whole;
use crate::vehicle::port;
use crate::vehicle::uf2;
use clap::Args;

/// Options of `tvc flash`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc flash                          find the Nano, enter its bootloader, write with bossac
  cargo tvc flash --port /dev/ttyACM0      a given port
  cargo tvc flash --uf2 /media/NANO/f.uf2  copy onto the drive of a UF2 bootloader
  cargo tvc flash --bin firmware.bin       only write the raw image, for other programmers

The image is linked at 0x2000, above the bootloader; never write it to 0x0. bossac erases everything
above the bootloader (-e), stored parameters too: `tvc param dump FILE` first, `tvc param load FILE`
and `tvc param save` afterwards.
Exit status: 0 written, 1 something failed, 2 unusable input.")]
pub struct Flash {
    /// Serial port of the Nano [default: the only SAMD21 that is connected].
    #[arg(long, value_name = "PORT", conflicts_with_all = ["uf2", "bin"])]
    pub port: Option<String>,

    /// Write a UF2 file instead: copy it onto the board's drive, or name a file there.
    #[arg(long, value_name = "FILE.uf2", conflicts_with = "bin")]
    pub uf2: Option<PathBuf>,

    /// Write the raw image instead (first byte belongs at 0x2000).
    #[arg(long, value_name = "FILE.bin")]
    pub bin: Option<PathBuf>,
}

/// How long the bootloader's port may take to appear after the touch.
const BOOTLOADER_PATIENCE: Duration = Duration::from_secs(8);

/// Builds the image and writes it where `options` say.
pub fn run(options: &Flash) -> Result<Verdict> {
    // A missing port or programmer is reported before the build, which takes minutes.
    let target = match options {
        Flash {
            uf2: Some(path), ..
        } => Target::Uf2(path.clone()),
        Flash {
            bin: Some(path), ..
        } => Target::Bin(path.clone()),
        Flash { port, .. } => Target::Port(port::find(port.as_deref())?, find_bossac()?),
    };
    let image = image::build(&mut |line| eprintln!("{line}")).context("building the image")?;
    let (address, bytes) = (image.address(), image.bytes());
    match target {
        Target::Uf2(path) => write_file(&path, &uf2::encode(address, bytes), &image),
        Target::Bin(path) => write_file(&path, bytes, &image),
        Target::Port(port, bossac) => write_with_bossac(&port, &bossac, &image),
    }
}

enum Target {
    Uf2(PathBuf),
    Bin(PathBuf),
    Port(String, PathBuf),
}

fn write_file(path: &Path, bytes: &[u8], image: &Image) -> Result<Verdict> {
    write_whole(path, bytes)?;
    eprintln!(
        "wrote {}: {} bytes of image for 0x{:04X}",
        path.display(),
        image.bytes().len(),
        image.address()
    );
    Ok(Verdict::Met)
}

fn find_bossac() -> Result<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path)
        .map(|folder| folder.join(format!("bossac{}", std::env::consts::EXE_SUFFIX)))
        .find(|candidate| candidate.is_file())
        .context(
            "bossac is not installed (Debian: apt install bossa-cli); \
             or write a file with --uf2 or --bin",
        )
}

fn write_with_bossac(port: &str, bossac: &Path, image: &Image) -> Result<Verdict> {
    let port = enter_bootloader(port)?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let file = folder.path().join("firmware.bin");
    std::fs::write(&file, image.bytes()).context("writing the image for bossac")?;
    eprintln!("writing {} bytes through {port}", image.bytes().len());
    // Without the offset the erase would begin at the bootloader.
    let status = Command::new(bossac)
        .arg(format!("--port={}", port.trim_start_matches("/dev/")))
        .args(["-U", "-i", "-e", "-w", "-v", "-R"])
        .arg(format!("--offset=0x{:X}", image.address()))
        .arg(&file)
        .status()
        .with_context(|| format!("starting {}", bossac.display()))?;
    if !status.success() {
        bail!("bossac failed ({status}); double-tap the reset button and try again");
    }
    eprintln!("written, verified and started");
    Ok(Verdict::Met)
}

/// Touches `port` at 1200 baud and waits for the bootloader; returns the bootloader's port.
fn enter_bootloader(port: &str) -> Result<String> {
    let before = port_names()?;
    let mut touch = serialport::new(port, 1200)
        .timeout(Duration::from_millis(200))
        .open()
        .with_context(|| format!("opening {port}"))?;
    // This write may fail because the board resets at once: then the touch has worked.
    let _ = touch.write_data_terminal_ready(false);
    drop(touch);
    eprintln!("asked {port} for its bootloader (refused while the firmware is armed)");
    let start = Instant::now();
    let mut vanished = false;
    while start.elapsed() < BOOTLOADER_PATIENCE {
        sleep(Duration::from_millis(100));
        let now = port_names()?;
        if let Some(new) = now.difference(&before).next() {
            return Ok(new.clone());
        }
        vanished |= !now.contains(port);
        if vanished && now.contains(port) {
            return Ok(port.to_string());
        }
    }
    // A board that is in its bootloader already keeps its port.
    if port_names()?.contains(port) {
        return Ok(port.to_string());
    }
    bail!("{port} went away and no bootloader came; double-tap the reset button and try again")
}

fn port_names() -> Result<BTreeSet<String>> {
    let ports = port::available()?;
    Ok(ports.into_iter().map(|port| port.port_name).collect())
}
