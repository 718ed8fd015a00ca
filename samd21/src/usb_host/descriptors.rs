//! Reading a configuration descriptor (USB 2.0, 9.6; CDC 1.2, 5).

use super::HostError;

const INTERFACE: u8 = 4;
/// Class-specific, and its subtype of the abstract control model.
const CLASS_INTERFACE: u8 = 0x24;
const ACM: u8 = 2;
/// bmCapabilities of the abstract control model: line coding and control lines are announced (CDC
/// PSTN 1.2, 5.3.2).
const LINES: u8 = 1 << 1;
const ENDPOINT: u8 = 5;
const CLASS_CDC: u8 = 0x02;
const CLASS_CDC_DATA: u8 = 0x0A;
const BULK: u8 = 2;
const INTERRUPT: u8 = 3;

/// An endpoint of the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Endpoint {
    /// 1 to 15.
    pub(super) number: u8,
    /// Largest packet in bytes.
    pub(super) packet_size: u16,
    /// Polling interval of an interrupt endpoint in ms.
    pub(super) interval_ms: u8,
}

/// A CDC-ACM port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SerialPort {
    /// bConfigurationValue.
    pub(super) configuration: u8,
    /// The device says that it takes line coding and control lines.
    pub(super) announces_lines: bool,
    /// The interface that takes class requests.
    pub(super) control_interface: u8,
    /// Notifications, if there are any.
    pub(super) interrupt: Option<Endpoint>,
    /// Device to host.
    pub(super) bulk_in: Endpoint,
    /// Host to device.
    pub(super) bulk_out: Endpoint,
}

impl SerialPort {
    /// Finds the port in a whole configuration.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, HostError> {
        let mut port = Self {
            configuration: *bytes.get(5).ok_or(HostError::Descriptor("cut short"))?,
            ..Self::default()
        };
        let mut class = 0;
        let mut control_interface = None;
        let (mut bulk_in, mut bulk_out) = (None, None);
        let mut rest = bytes;
        while let [length, kind, ..] = *rest {
            let length = usize::from(length);
            if length < 2 || length > rest.len() {
                return Err(HostError::Descriptor("a length does not fit"));
            }
            let (descriptor, tail) = rest.split_at(length);
            rest = tail;
            match (kind, descriptor) {
                (INTERFACE, [_, _, number, _, _, interface_class, ..]) => {
                    class = *interface_class;
                    if class == CLASS_CDC {
                        control_interface = Some(*number);
                    }
                }
                (CLASS_INTERFACE, [_, _, ACM, capabilities, ..]) => {
                    port.announces_lines = capabilities & LINES != 0;
                }
                (ENDPOINT, [_, _, address, attributes, low, high, interval, ..]) => {
                    let endpoint = Endpoint {
                        number: address & 0xF,
                        packet_size: u16::from_le_bytes([*low, *high]) & 0x7FF,
                        interval_ms: *interval,
                    };
                    match (class, attributes & 3, address & 0x80 != 0) {
                        (CLASS_CDC_DATA, BULK, true) => bulk_in = Some(endpoint),
                        (CLASS_CDC_DATA, BULK, false) => bulk_out = Some(endpoint),
                        (CLASS_CDC, INTERRUPT, true) => port.interrupt = Some(endpoint),
                        _ => {}
                    }
                }
                _ => {}
            }
        }
        port.control_interface =
            control_interface.ok_or(HostError::Descriptor("no CDC interface"))?;
        port.bulk_in = bulk_in.ok_or(HostError::Descriptor("no bulk IN endpoint"))?;
        port.bulk_out = bulk_out.ok_or(HostError::Descriptor("no bulk OUT endpoint"))?;
        Ok(port)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `usbd-serial` describes itself.
    const CONFIGURATION: [u8; 75] = [
        9, 2, 75, 0, 2, 1, 0, 0x80, 50, // configuration
        8, 11, 0, 2, 2, 2, 0, 0, // interface association
        9, 4, 0, 0, 1, 2, 2, 0, 0, // communication interface
        5, 0x24, 0, 0x10, 1, // header
        4, 0x24, 2, 0, // ACM
        5, 0x24, 6, 0, 1, // union
        5, 0x24, 1, 0, 1, // call management
        7, 5, 0x81, 3, 8, 0, 255, // interrupt IN 1
        9, 4, 1, 0, 2, 10, 0, 0, 0, // data interface
        7, 5, 0x82, 2, 64, 0, 0, // bulk IN 2
        7, 5, 0x01, 2, 64, 0, 0, // bulk OUT 1
    ];

    #[test]
    fn a_serial_port_is_found() {
        let bulk = |number| Endpoint { number, packet_size: 64, interval_ms: 0 };
        assert_eq!(
            SerialPort::parse(&CONFIGURATION),
            Ok(SerialPort {
                configuration: 1,
                announces_lines: false,
                control_interface: 0,
                interrupt: Some(Endpoint { number: 1, packet_size: 8, interval_ms: 255 }),
                bulk_in: bulk(2),
                bulk_out: bulk(1),
            })
        );
    }

    #[test]
    fn broken_descriptors_are_told_apart() {
        assert_eq!(
            SerialPort::parse(&CONFIGURATION[..70]),
            Err(HostError::Descriptor("a length does not fit"))
        );
        assert_eq!(
            SerialPort::parse(&CONFIGURATION[..68]),
            Err(HostError::Descriptor("no bulk OUT endpoint"))
        );
        assert_eq!(
            SerialPort::parse(&CONFIGURATION[..9]),
            Err(HostError::Descriptor("no CDC interface"))
        );
        assert_eq!(SerialPort::parse(&[]), Err(HostError::Descriptor("cut short")));
    }
}
