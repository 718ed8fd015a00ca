//! Into the bootloader: by the 1200-baud touch.
//!
//! The port is opened at 1200 baud with DTR raised, and DTR is dropped. Upon that the running
//! firmware (unless it is armed) or Arduino sketch resets into the bootloader, which shows up as
//! another port with another product id.

use std::io;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use serialport::SerialPortInfo;

use crate::vehicle::port::{self, Life, Nano};

/// How long the bootloader's port may take to appear after the touch.
const PATIENCE: Duration = Duration::from_secs(8);
/// How often a port is looked at.
const STEP: Duration = Duration::from_millis(100);
/// How many times a port that is there is tried: 2 s, in which Linux gives it to its group.
const TRIES: usize = 20;

/// Brings a Nano into its bootloader and returns the bootloader's port.
///
/// # Errors
/// The port cannot be opened, or no bootloader comes: the firmware's own port is never returned.
pub(super) fn enter(nano: &Nano) -> Result<String> {
    if nano.life == Life::Bootloader {
        eprintln!("{} is in its bootloader", nano.port);
        return Ok(nano.port.clone());
    }
    let before = port::available()?;
    touch(&nano.port)?;
    eprintln!("asked {} for its bootloader (refused while the firmware is armed)", nano.port);
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        sleep(STEP);
        if let Some(port) = appeared(&before, &port::available()?) {
            return Ok(port);
        }
    }
    bail!(
        "{} is not in its bootloader (that would be the USB product 2341:0057); disarm it, or \
         double-tap the reset button, and try again",
        nano.port
    )
}

/// Windows leaves DTR low unless it is asked for, and a line that was never high cannot drop.
fn touch(port: &str) -> Result<()> {
    let mut touched = serialport::new(port, 1200)
        .timeout(Duration::from_millis(200))
        .dtr_on_open(true)
        .open()
        .map_err(|error| port::refused(port, &error.into()))?;
    // This write may fail because the board resets at once: then the touch has worked.
    let _ = touched.write_data_terminal_ready(false);
    Ok(())
}

/// The port of a bootloader that was not there before.
fn appeared(before: &[SerialPortInfo], now: &[SerialPortInfo]) -> Option<String> {
    let bootloaders = |ports| {
        let nanos = port::nanos(ports).into_iter();
        nanos.filter(|nano| nano.life == Life::Bootloader)
    };
    let old: Vec<Nano> = bootloaders(before).collect();
    let mut new = bootloaders(now).filter(|nano| !old.contains(nano));
    Some(new.next()?.port)
}

/// Waits until `port` opens. Linux lists a port before udev has given it to its group, and bossac
/// calls a port that it may not open "no device".
///
/// # Errors
/// It does not open within 2 s; says which group it belongs to.
pub(super) fn wait_until_open(port: &str) -> Result<()> {
    let open = || serialport::new(port, 115_200).dtr_on_open(true).open();
    retry(|| open().map(drop), || sleep(STEP))
        .map_err(|error| port::refused(port, &error))
        .context("the bootloader is there")
}

/// Tries up to [`TRIES`] times, with a pause between two.
fn retry(
    mut open: impl FnMut() -> serialport::Result<()>,
    mut pause: impl FnMut(),
) -> io::Result<()> {
    for _ in 1..TRIES {
        if open().is_ok() {
            return Ok(());
        }
        pause();
    }
    Ok(open()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::port::test_ports::{BOOTLOADER, FIRMWARE, port};
    use serialport::{Error, ErrorKind};

    #[test]
    fn only_a_bootloader_that_was_not_there_before_has_appeared() {
        let firmware = port("/dev/ttyACM0", FIRMWARE, Some("A"));
        let other = port("/dev/ttyACM1", BOOTLOADER, Some("B"));
        let bootloader = |name| port(name, BOOTLOADER, Some("C"));
        let before = [firmware.clone(), other.clone()];
        // Nothing has happened, the firmware has gone, it has come back.
        for now in [&before[..], std::slice::from_ref(&other)] {
            assert_eq!(appeared(&before, now), None);
        }
        // The system may give the bootloader the firmware's name.
        for name in ["/dev/ttyACM0", "/dev/ttyACM2"] {
            let now = [other.clone(), bootloader(name)];
            assert_eq!(appeared(&before, &now).as_deref(), Some(name));
        }
    }

    #[test]
    fn on_macos_the_callout_device_of_the_bootloader_is_taken() {
        let now = [
            port("/dev/tty.usbmodem1", BOOTLOADER, None),
            port("/dev/cu.usbmodem1", BOOTLOADER, None),
        ];
        assert_eq!(appeared(&[], &now).as_deref(), Some("/dev/cu.usbmodem1"));
    }

    #[test]
    fn a_port_that_is_given_away_late_is_waited_for_and_no_longer_than_two_seconds() {
        let denied = || Error::new(ErrorKind::Io(io::ErrorKind::PermissionDenied), "denied");
        for (opens_at, pauses) in [(1, 0), (4, 3), (20, 19)] {
            let (mut tries, mut waited) = (0, 0);
            let open = || {
                tries += 1;
                if tries < opens_at { Err(denied()) } else { Ok(()) }
            };
            assert!(retry(open, || waited += 1).is_ok());
            assert_eq!(waited, pauses);
        }
        let mut waited = 0;
        let error = retry(|| Err(denied()), || waited += 1).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(waited, 19);
    }
}
