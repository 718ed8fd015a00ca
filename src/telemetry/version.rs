//! Which vehicle this is, and what runs on it: AUTOPILOT_VERSION.

use core::array;

use heapless::Vec;
use mavlink::dialects::common::{AUTOPILOT_VERSION_DATA, MavProtocolCapability};

use super::Telemetry;
use super::queue::Priority;
use crate::config::SYSTEM_ID;

/// Tells vehicles apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// MAVLink system id, 1 to 250.
    pub system: u8,
    /// The chip's serial number.
    pub serial: [u8; 16],
}

impl Default for Identity {
    fn default() -> Self {
        Self { system: SYSTEM_ID, serial: [0; 16] }
    }
}

/// PROTOCOL_VERSION, which older stations ask for.
#[allow(deprecated)]
pub(super) type ProtocolVersion = mavlink::dialects::common::PROTOCOL_VERSION_DATA;

/// Tells builds of the same version apart, as stations show it: the first digits of a sum over the
/// sources of the image, none on the host.
const BUILD_ID: [u8; 8] = match option_env!("TVC_BUILD_ID") {
    Some(text) => match text.as_bytes().first_chunk() {
        Some(digits) => *digits,
        None => [0; 8],
    },
    None => [0; 8],
};

impl Telemetry {
    /// AUTOPILOT_VERSION, whose `uid` has the two halves of the serial number by exclusive or.
    pub(super) fn version(&mut self) {
        const CAPABILITIES: u64 = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
            .union(MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST)
            .union(MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT)
            .bits();
        const VERSION: u32 = version_number(env!("CARGO_PKG_VERSION"));
        let serial = self.identity.serial;
        let (head, tail) = serial.split_at(8);
        let mut halves = head.iter().zip(tail).map(|(a, b)| a ^ b);
        let uid: [u8; 8] = array::from_fn(|_| halves.next().unwrap_or(0));
        // By hand, since the dialect's type has no `uid2`: of what stands between, nothing is
        // known.
        let mut payload: Vec<u8, 76> = Vec::new();
        for field in [
            &CAPABILITIES.to_le_bytes()[..],
            &uid,
            &VERSION.to_le_bytes(),
            &[0; 16],
            &BUILD_ID,
            &[0; 16],
            &serial,
        ] {
            // There is room for all of them.
            let _ = payload.extend_from_slice(field);
        }
        self.send_payload::<AUTOPILOT_VERSION_DATA>(Priority::Event, &payload);
    }

    /// PROTOCOL_VERSION: 2.0 is spoken, 1.0 understood.
    pub(super) fn protocol_version(&mut self) {
        self.send_payload::<ProtocolVersion>(Priority::Event, &[200, 0, 100, 0, 200]);
    }
}

/// `major.minor.patch` as `flight_sw_version` has it: a byte each from the top, and below the
/// release type that a pre-release names (MAVLink's FIRMWARE_VERSION_TYPE). Build metadata is
/// ignored.
const fn version_number(version: &str) -> u32 {
    let mut number: u32 = 0;
    let mut part: u32 = 0;
    let mut release_type = OFFICIAL;
    let mut bytes = version.as_bytes();
    while let [byte, rest @ ..] = bytes {
        match *byte {
            b'.' => {
                number = number << 8 | part;
                part = 0;
            }
            digit @ b'0'..=b'9' => part = part * 10 + (digit - b'0') as u32,
            b'-' => {
                release_type = pre_release_type(rest);
                break;
            }
            _ => break,
        }
        bytes = rest;
    }
    (number << 8 | part) << 8 | release_type
}

/// FIRMWARE_VERSION_TYPE_OFFICIAL.
const OFFICIAL: u32 = 255;

/// The type of a pre-release by the word that it begins with: the type for development where
/// MAVLink does not know the word.
const fn pre_release_type(name: &[u8]) -> u32 {
    match name {
        [b'a', b'l', b'p', b'h', b'a', ..] => 64,
        [b'b', b'e', b't', b'a', ..] => 128,
        [b'r', b'c', ..] => 192,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::version_number;

    #[test]
    fn a_version_is_a_byte_a_part_and_its_release_type() {
        for (version, word) in [
            ("0.1.0", 0x0001_00FF),
            ("1.22.255", 0x0116_FFFF),
            ("0.2.0-rc.1", 0x0002_00C0),
            ("0.2.0-beta", 0x0002_0080),
            ("0.2.0-alpha.3+5f2", 0x0002_0040),
            ("0.2.0-dev", 0x0002_0000),
            ("0.2.0+20261122", 0x0002_00FF),
        ] {
            assert_eq!(version_number(version), word, "{version}");
        }
    }
}
