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
use serialport::{SerialPortInfo, SerialPortType};

use crate::cli::Flash;
use crate::failure::{BadInput, Verdict};
use crate::output::write_whole;
use crate::uf2;

/// USB vendor of the Nano 33 IoT, in firmware and in bootloader.
const VENDOR: u16 = 0x2341;
/// USB products: the running firmware, the bootloader.
const PRODUCTS: [u16; 2] = [0x8057, 0x0057];
/// How long the bootloader's port may take to appear after the touch.
const BOOTLOADER_PATIENCE: Duration = Duration::from_secs(8);

/// Builds the image and writes it where `options` say.
pub fn run(options: &Flash) -> Result<Verdict> {
    // A port or a programmer that is not there is said before minutes of building.
    let target = match options {
        Flash {
            uf2: Some(path), ..
        } => Target::Uf2(path.clone()),
        Flash {
            bin: Some(path), ..
        } => Target::Bin(path.clone()),
        Flash { port, .. } => Target::Port(find_port(port.as_deref())?, find_bossac()?),
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

/// The port to use: the one named, if it exists, or the only Nano that is connected.
fn find_port(wanted: Option<&str>) -> Result<String> {
    let ports = serialport::available_ports().context("listing serial ports")?;
    if let Some(name) = wanted {
        // A port may exist without being listed (a link under /dev, for instance).
        let there = ports.iter().any(|port| port.port_name == name) || Path::new(name).exists();
        return if there {
            Ok(name.to_string())
        } else {
            Err(BadInput::new(format!(
                "no port {name}; {}",
                match ports.as_slice() {
                    [] => "no serial port is connected".to_string(),
                    _ => format!("connected: {}", names(&ports)),
                }
            ))
            .into())
        };
    }
    let nanos: Vec<_> = ports.into_iter().filter(is_nano).collect();
    match nanos.as_slice() {
        [nano] => Ok(nano.port_name.clone()),
        [] => Err(BadInput::new(
            "no Nano found; connect it, double-tap its reset button if it runs other firmware, \
             or name the port with --port",
        )
        .into()),
        _ => Err(BadInput::new(format!(
            "more than one Nano is connected ({}); choose with --port",
            names(&nanos)
        ))
        .into()),
    }
}

fn is_nano(port: &SerialPortInfo) -> bool {
    matches!(&port.port_type, SerialPortType::UsbPort(usb)
        if usb.vid == VENDOR && PRODUCTS.contains(&usb.pid))
}

fn names(ports: &[SerialPortInfo]) -> String {
    ports
        .iter()
        .map(|port| port.port_name.as_str())
        .collect::<Vec<_>>()
        .join(", ")
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

/// Touches `port` at 1200 baud and waits for the bootloader; gives the bootloader's port.
fn enter_bootloader(port: &str) -> Result<String> {
    let before = port_names()?;
    let mut touch = serialport::new(port, 1200)
        .timeout(Duration::from_millis(200))
        .open()
        .with_context(|| format!("opening {port}"))?;
    // If the board vanishes at once this write may fail: that is the touch having worked.
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
    // A board that was in its bootloader already does not re-enumerate.
    if port_names()?.contains(port) {
        return Ok(port.to_string());
    }
    bail!("{port} went away and no bootloader came; double-tap the reset button and try again")
}

fn port_names() -> Result<BTreeSet<String>> {
    let ports = serialport::available_ports().context("listing serial ports")?;
    Ok(ports.into_iter().map(|port| port.port_name).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serialport::UsbPortInfo;

    fn usb(vid: u16, pid: u16) -> SerialPortInfo {
        SerialPortInfo {
            port_name: "ttyACM0".into(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid,
                pid,
                serial_number: None,
                manufacturer: None,
                product: None,
            }),
        }
    }

    #[test]
    fn a_nano_is_known_by_its_ids_in_both_lives() {
        assert!(is_nano(&usb(0x2341, 0x8057)));
        assert!(is_nano(&usb(0x2341, 0x0057)));
        assert!(!is_nano(&usb(0x2341, 0x0043)));
        assert!(!is_nano(&usb(0x1209, 0x8057)));
    }

    #[test]
    fn a_port_that_is_not_there_is_bad_input() {
        let error = find_port(Some("/dev/no-such-port")).unwrap_err();
        assert!(error.is::<BadInput>());
        assert!(error.to_string().starts_with("no port /dev/no-such-port"));
    }
}
