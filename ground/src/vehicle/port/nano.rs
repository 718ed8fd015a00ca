//! Which ports are Nanos, and what runs on each.

use std::path::Path;

use serialport::{SerialPortInfo, SerialPortType};

/// USB vendor of the Nano 33 IoT, in firmware and in bootloader.
pub(super) const VENDOR: u16 = 0x2341;
/// USB product of the running firmware; an Arduino sketch has the same.
pub(super) const FIRMWARE: u16 = 0x8057;
/// USB product of the bootloader.
pub(super) const BOOTLOADER: u16 = 0x0057;

/// What runs on a Nano.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Life {
    /// The firmware or an Arduino sketch.
    Firmware,
    /// The bootloader.
    Bootloader,
}

impl Life {
    /// What a port is by what runs behind it; empty if it is no Nano's.
    pub fn words(life: Option<Self>) -> &'static str {
        match life {
            Some(Self::Firmware) => "SAMD21 Nano",
            Some(Self::Bootloader) => "SAMD21 Nano in its bootloader",
            None => "",
        }
    }
}

/// A Nano that is connected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Nano {
    /// Name of its port.
    pub port: String,
    /// What runs on it.
    pub life: Life,
    serial_number: Option<String>,
}

/// The Nano behind a port's name, which may be a link.
pub(super) fn nano_at(name: &str, ports: &[SerialPortInfo]) -> Option<Nano> {
    let real = std::fs::canonicalize(name).unwrap_or_else(|_| name.into());
    let is_it = |port: &&SerialPortInfo| {
        port.port_name == name || Path::new(&port.port_name) == real.as_path()
    };
    nano(ports.iter().find(is_it)?)
}

/// Every Nano among `ports`, once.
pub fn nanos(ports: &[SerialPortInfo]) -> Vec<Nano> {
    let mut found: Vec<Nano> = Vec::new();
    for new in one_of_each(ports).filter_map(nano) {
        let is_known =
            |old: &Nano| new.serial_number.is_some() && old.serial_number == new.serial_number;
        if !found.iter().any(is_known) {
            found.push(new);
        }
    }
    found
}

/// Ports without macOS' dial-in devices (`/dev/tty.*`), each of which has a callout device
/// (`/dev/cu.*`) that does not wait for a carrier.
pub(super) fn one_of_each(ports: &[SerialPortInfo]) -> impl Iterator<Item = &SerialPortInfo> {
    ports.iter().filter(|port| {
        let callout = port.port_name.strip_prefix("/dev/tty.");
        !callout.is_some_and(|name| {
            let callout = format!("/dev/cu.{name}");
            ports.iter().any(|port| port.port_name == callout)
        })
    })
}

/// The Nano behind a port, if it is one.
pub(super) fn nano(port: &SerialPortInfo) -> Option<Nano> {
    let SerialPortType::UsbPort(usb) = &port.port_type else {
        return None;
    };
    let life = match (usb.vid, usb.pid) {
        (VENDOR, FIRMWARE) => Life::Firmware,
        (VENDOR, BOOTLOADER) => Life::Bootloader,
        _ => return None,
    };
    Some(Nano { port: port.port_name.clone(), life, serial_number: usb.serial_number.clone() })
}

/// Made-up ports, as the systems list them.
#[cfg(test)]
pub mod test_ports {
    use super::{SerialPortInfo, SerialPortType, VENDOR};
    use serialport::UsbPortInfo;

    /// Product of the firmware.
    pub const FIRMWARE: u16 = super::FIRMWARE;
    /// Product of the bootloader.
    pub const BOOTLOADER: u16 = super::BOOTLOADER;

    /// A port of Arduino's with this product.
    pub fn port(name: &str, product: u16, serial_number: Option<&str>) -> SerialPortInfo {
        usb(name, VENDOR, product, serial_number)
    }

    /// A USB port.
    pub fn usb(name: &str, vid: u16, pid: u16, serial_number: Option<&str>) -> SerialPortInfo {
        SerialPortInfo {
            port_name: name.into(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid,
                pid,
                serial_number: serial_number.map(str::to_owned),
                manufacturer: None,
                product: None,
            }),
        }
    }

    /// A port of another kind.
    pub fn other(name: &str, port_type: SerialPortType) -> SerialPortInfo {
        SerialPortInfo { port_name: name.into(), port_type }
    }
}

#[cfg(test)]
mod tests {
    use super::test_ports::{other, port, usb};
    use super::*;

    fn names(ports: &[SerialPortInfo]) -> Vec<String> {
        nanos(ports).into_iter().map(|nano| nano.port).collect()
    }

    #[test]
    fn a_nano_is_known_by_its_ids_in_both_lives() {
        let life = |port| nano(&port).map(|nano| nano.life);
        assert_eq!(life(port("x", 0x8057, None)), Some(Life::Firmware));
        assert_eq!(life(port("x", 0x0057, None)), Some(Life::Bootloader));
        assert_eq!(life(port("x", 0x0043, None)), None);
        assert_eq!(life(usb("x", 0x1209, 0x8057, None)), None);
        assert_eq!(life(other("x", SerialPortType::PciPort)), None);
    }

    #[test]
    fn one_nano_is_one_nano_in_the_listing_of_every_system() {
        let linux = [
            other("/dev/ttyS0", SerialPortType::Unknown),
            port("/dev/ttyACM0", FIRMWARE, Some("7F2A")),
            usb("/dev/ttyUSB0", 0x0403, 0x6001, Some("FT1")),
        ];
        assert_eq!(names(&linux), ["/dev/ttyACM0"]);
        let windows =
            [other("COM1", SerialPortType::Unknown), port("COM7", FIRMWARE, Some("7F2A"))];
        assert_eq!(names(&windows), ["COM7"]);
        let bluetooth = |name| other(name, SerialPortType::BluetoothPort);
        for serial_number in [Some("7F2A"), None] {
            let macos = [
                bluetooth("/dev/cu.Bluetooth-Incoming-Port"),
                bluetooth("/dev/tty.Bluetooth-Incoming-Port"),
                port("/dev/tty.usbmodem101", FIRMWARE, serial_number),
                port("/dev/cu.usbmodem101", FIRMWARE, serial_number),
            ];
            assert_eq!(names(&macos), ["/dev/cu.usbmodem101"]);
            assert_eq!(one_of_each(&macos).count(), 2);
        }
    }

    #[test]
    fn two_nanos_are_two_with_and_without_serial_numbers() {
        for serials in [[Some("A"), Some("B")], [None, None]] {
            let two = [
                port("/dev/cu.usbmodem1", FIRMWARE, serials[0]),
                port("/dev/tty.usbmodem1", FIRMWARE, serials[0]),
                port("/dev/cu.usbmodem2", BOOTLOADER, serials[1]),
                port("/dev/tty.usbmodem2", BOOTLOADER, serials[1]),
            ];
            assert_eq!(names(&two), ["/dev/cu.usbmodem1", "/dev/cu.usbmodem2"]);
        }
        // Two listings of one device, whatever their names.
        let one = [port("a", FIRMWARE, Some("A")), port("b", FIRMWARE, Some("A"))];
        assert_eq!(names(&one), ["a"]);
    }

    #[test]
    fn a_port_is_found_by_its_name_the_dial_in_device_too() {
        let ports = [
            port("/dev/cu.usbmodem1", BOOTLOADER, None),
            port("/dev/tty.usbmodem1", BOOTLOADER, None),
            usb("COM3", 0x0403, 0x6001, None),
        ];
        let found = nano_at("/dev/tty.usbmodem1", &ports).unwrap();
        assert_eq!(found.life, Life::Bootloader);
        assert_eq!(nano_at("COM3", &ports), None);
        assert_eq!(nano_at("COM4", &ports), None);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_port_is_that_port() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let (device, link) = (folder.join("ttyACM0"), folder.join("nano"));
        std::fs::write(&device, "").unwrap();
        std::os::unix::fs::symlink(&device, &link).unwrap();
        let ports = [port(device.to_str().unwrap(), FIRMWARE, None)];
        let found = nano_at(link.to_str().unwrap(), &ports).unwrap();
        assert_eq!(found.port, device.to_str().unwrap());
    }
}
