//! What the device tells of itself (USB 2.0, 9.6; CDC 1.2, 5.2; PSTN 1.2, 5.3).

use super::{Endpoint, NOTIFICATION_BYTES, PACKET_BYTES};

pub(super) const DEVICE: u8 = 1;
pub(super) const CONFIGURATION: u8 = 2;
pub(super) const STRING: u8 = 3;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
const INTERFACE_ASSOCIATION: u8 = 11;
/// A class' own descriptor of an interface.
const CLASS_INTERFACE: u8 = 0x24;

/// bConfigurationValue of the only configuration.
pub(super) const CONFIGURED: u8 = 1;
/// The interface that takes the class' requests.
pub(super) const CONTROL_INTERFACE: u8 = 0;
const DATA_INTERFACE: u8 = 1;
/// Interfaces.
pub(super) const INTERFACES: u8 = 2;

/// Indices of the strings, as the device's descriptor names them.
pub(super) const MANUFACTURER: u8 = 1;
/// See [`MANUFACTURER`].
pub(super) const PRODUCT: u8 = 2;
/// See [`MANUFACTURER`].
pub(super) const SERIAL_NUMBER: u8 = 3;

/// Bytes of the chip's serial number.
const SERIAL_BYTES: usize = 16;
/// Bytes of its descriptor: two hexadecimal digits of UTF-16 for each.
pub(super) const SERIAL_DESCRIPTOR_BYTES: usize = 2 + 4 * SERIAL_BYTES;

/// The device's descriptor. USB 2.0 without a BOS, and a composite device whose interfaces are
/// grouped by an association.
#[rustfmt::skip]
pub const fn device(vendor: u16, product: u16) -> [u8; 18] {
    let [v0, v1] = vendor.to_le_bytes();
    let [p0, p1] = product.to_le_bytes();
    let packet = PACKET_BYTES as u8;
    [
        18, DEVICE, 0x00, 0x02, 0xEF, 2, 1, packet,
        v0, v1, p0, p1, 0x10, 0x00, MANUFACTURER, PRODUCT, SERIAL_NUMBER, 1,
    ]
}

const TOTAL: u8 = 75;

/// The configuration with its interfaces and endpoints.
#[rustfmt::skip]
pub(super) static WHOLE_CONFIGURATION: [u8; TOTAL as usize] = [
    // Bus-powered, at most 100 mA.
    9, CONFIGURATION, TOTAL, 0, INTERFACES, CONFIGURED, 0, 0x80, 50,
    8, INTERFACE_ASSOCIATION, CONTROL_INTERFACE, INTERFACES, 2, 2, 0, 0,
    // Communication: abstract control model.
    9, INTERFACE, CONTROL_INTERFACE, 0, 1, 2, 2, 0, 0,
    // CDC 1.10.
    5, CLASS_INTERFACE, 0, 0x10, 0x01,
    // The port obeys SET_LINE_CODING and SET_CONTROL_LINE_STATE: a host that goes by this would
    // otherwise never say that the port is open, nor at which rate.
    4, CLASS_INTERFACE, 2, 0x02,
    // Which interface controls which.
    5, CLASS_INTERFACE, 6, CONTROL_INTERFACE, DATA_INTERFACE,
    // No call management.
    5, CLASS_INTERFACE, 1, 0, DATA_INTERFACE,
    7, ENDPOINT, Endpoint::Notifications.address(), 3, NOTIFICATION_BYTES as u8, 0, 255,
    9, INTERFACE, DATA_INTERFACE, 0, 2, 10, 0, 0, 0,
    7, ENDPOINT, Endpoint::ToHost.address(), 2, PACKET_BYTES as u8, 0, 0,
    7, ENDPOINT, Endpoint::FromHost.address(), 2, PACKET_BYTES as u8, 0, 0,
];

/// The languages that strings are in: English (United States).
pub(super) static LANGUAGES: [u8; 4] = [4, STRING, 0x09, 0x04];
pub(super) static MANUFACTURER_TEXT: [u8; 18] = text("tvc-nano");
pub(super) static PRODUCT_TEXT: [u8; 62] = text("tvc-nano thrust-vector control");

/// A string's descriptor, in UTF-16.
///
/// # Panics
/// At compile time, unless `BYTES` is what an ASCII text takes.
#[allow(clippy::indexing_slicing, clippy::panic, reason = "evaluated at compile time")]
const fn text<const BYTES: usize>(ascii: &str) -> [u8; BYTES] {
    let ascii = ascii.as_bytes();
    assert!(BYTES == 2 + 2 * ascii.len());
    let mut descriptor = [0; BYTES];
    descriptor[0] = BYTES as u8;
    descriptor[1] = STRING;
    let mut at = 0;
    while at < ascii.len() {
        assert!(ascii[at].is_ascii());
        descriptor[2 + 2 * at] = ascii[at];
        at += 1;
    }
    descriptor
}

/// The descriptor of the serial number, in hexadecimal.
pub(super) fn serial_number(serial: [u8; SERIAL_BYTES]) -> [u8; SERIAL_DESCRIPTOR_BYTES] {
    let mut descriptor = [0; SERIAL_DESCRIPTOR_BYTES];
    let [length, kind, text @ ..] = &mut descriptor;
    *length = SERIAL_DESCRIPTOR_BYTES as u8;
    *kind = STRING;
    for (digits, byte) in text.chunks_exact_mut(4).zip(serial) {
        if let [high, _, low, _] = digits {
            *high = digit(byte >> 4);
            *low = digit(byte & 15);
        }
    }
    descriptor
}

const fn digit(number: u8) -> u8 {
    match number {
        0..10 => b'0' + number,
        _ => b'A' + number - 10,
    }
}
