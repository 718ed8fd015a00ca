//! What `tvc bringup` asks a board: to show words of its memory, to time its servo's pulse, to
//! hang or to fail its self-check on purpose. MAV_CMD_USER_1, obeyed while the flight is
//! [idle](crate::State::is_idle).
//!
//! | param1 | what | NAMED_VALUE_INT |
//! |---|---|---|
//! | 1 | show the word at the address, if it is [readable](is_readable) | the word |
//! | 2 | hang until the watchdog resets the chip | |
//! | 3 | reset as after a failed self-check | |
//! | 4 | time a pulse that a jumper leads from D3 to D2 | [`Pulse`] |
//! | 5 | show the sensor's bus | 7-bit address in the upper 8 bits, below it how long the longest of the newest reads' STOPs took, us |
//! | 6 | count the watchdog's clock, 1,024 Hz, in [`words::SLOW_COUNT`] | 0 |
//! | 7 | show who reads the image | how long the DSU's engine took at start-up, us; 0 where the core reads |
//!
//! The bits of param2 are a number: an address, or anything that tells one order from another. The
//! answer's name is that number in eight hexadecimal digits; it comes before the acknowledgement.

pub mod words;

use words::*;

/// MAV_CMD_USER_1.
pub const COMMAND: u16 = 31_010;

/// What can be ordered, by the command's first parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum What {
    /// Show a word.
    Peek = 1,
    /// Hang.
    Hang = 2,
    /// Reset as after a failed self-check.
    FailCheck = 3,
    /// Time a pulse.
    Pulse = 4,
    /// Show the sensor's bus.
    Bus = 5,
    /// Count the watchdog's clock.
    Count = 6,
    /// Show who reads the image.
    Image = 7,
}

/// An order of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// [`What`], as a number.
    pub what: u8,
    /// An address, or any number.
    pub number: u32,
}

/// A pulse that was timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// When it began, us, modulo 2^20.
    pub rise_us: u32,
    /// Its length, us, modulo 2^12.
    pub width_us: u32,
}

impl Pulse {
    /// As one word.
    pub const fn word(self) -> u32 {
        self.rise_us << 12 | self.width_us & 0xFFF
    }

    /// Of a word.
    pub const fn of(word: u32) -> Self {
        Self { rise_us: word >> 12, width_us: word & 0xFFF }
    }
}

/// Words that can be read without changing anything, as first and last address.
const READABLE: [(u32, u32); 12] = [
    // Flash; the user row; the calibration; the serial number.
    (0x0000_0000, 0x0003_FFFC),
    (USER_ROW, USER_ROW + 4),
    (0x0080_6020, 0x0080_6024),
    (SERIAL[0], SERIAL[0]),
    (SERIAL[1], SERIAL[3]),
    (RAM, RAM + 0x7FFC),
    (RESET_CAUSE, RESET_CAUSE),
    (CLOCK_STATUS, BROWN_OUT),
    (WATCHDOG, WATCHDOG),
    (DEVICE_ID, DEVICE_ID),
    (USB_FRAME, USB_FRAME),
    (SLOW_COUNT, SLOW_COUNT),
];

/// Whether the word at `address` can be shown: reading it changes nothing.
pub fn is_readable(address: u32) -> bool {
    let within = |(first, last): &(u32, u32)| (*first..=*last).contains(&address);
    address.is_multiple_of(4) && (address == PORT_IN || READABLE.iter().any(within))
}

/// The payload of NAMED_VALUE_INT: time since start-up, ms, value, and `number` in hexadecimal
/// digits as its name, which two zeros would fill up.
pub fn answer(time_ms: u32, value: u32, number: u32) -> [u8; 16] {
    let mut payload = [0; 16];
    let mut rest = number;
    for (index, place) in payload.iter_mut().enumerate() {
        *place = match index {
            0..4 => (time_ms >> (8 * index)) as u8,
            4..8 => (value >> (8 * index - 32)) as u8,
            _ => {
                rest = rest.rotate_left(4);
                let digit = rest as u8 & 0xF;
                digit + if digit < 10 { b'0' } else { b'a' - 10 }
            }
        };
    }
    payload
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::MessageData;
    use mavlink::dialects::common::NAMED_VALUE_INT_DATA;

    #[test]
    fn only_words_of_the_list_are_shown() {
        for address in [0, 0x3_FFFC, 0x2000_7FFC, 0x0080_A044, PORT_IN, SLOW_COUNT] {
            assert!(is_readable(address), "{address:#010x}");
        }
        // Not aligned; behind a memory; SERCOM4's DATA, which reading empties; nothing there.
        for address in [1, 0x4_0000, 0x2000_8000, 0x4200_1828, 0x0080_6028, 0xFFFF_FFFC] {
            assert!(!is_readable(address), "{address:#010x}");
        }
    }

    #[test]
    fn an_answer_is_a_named_value() {
        let payload = answer(0x0102_0304, 0xFFFF_FFFE, 0xFEDC_BA09);
        let parsed = NAMED_VALUE_INT_DATA::deser(mavlink::MavlinkVersion::V2, &payload).unwrap();
        assert_eq!((parsed.time_boot_ms, parsed.value), (0x0102_0304, -2));
        assert_eq!(parsed.name.to_str(), Ok("fedcba09"));
    }

    #[test]
    fn a_pulse_fits_into_a_word() {
        let pulse = Pulse { rise_us: 0xF_FFFF, width_us: 2_476 };
        assert_eq!(Pulse::of(pulse.word()), pulse);
    }
}
