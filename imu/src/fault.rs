//! The faults of the sensor, its data and its bus.

use core::fmt;

use crate::hex::Hex;
use crate::transfer::BusError;

/// The reason for a missing sample.
///
/// `Display` gives at most 34 characters, so that a fault with a prefix fits a MAVLink STATUSTEXT.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SensorFault {
    /// Being set up, and not yet late.
    Booting,
    /// The chip does not acknowledge: it is unplugged, booting, or lost after a reset.
    Nak,
    /// A transfer missed its deadline.
    Timeout,
    /// A bus line is held low.
    Stuck,
    /// Another master, or noise, won the bus.
    Arbitration,
    /// The bus misbehaved, or an answer had the wrong length.
    Protocol,
    /// The identification is another chip's.
    WrongChip {
        /// The value read.
        found: u8,
    },
    /// The chip answers, but one of its sensors does not identify itself.
    DeadSensor {
        /// 1 accelerometer, 2 magnetometer, 3 gyroscope.
        sensor: u8,
        /// The value read.
        found: u8,
    },
    /// The power-on self-test failed.
    SelfTest {
        /// The chip's own word for it.
        result: u8,
    },
    /// The chip reports a system error.
    System {
        /// The chip's own number of it.
        error: u8,
    },
    /// A register does not hold the written value.
    Configuration {
        /// The register.
        register: u8,
        /// The value read.
        found: u8,
    },
    /// The configured calibration profile has a value out of range; it is not written.
    Profile {
        /// Register of the value's low byte.
        register: u8,
    },
    /// The external crystal does not start.
    Clock,
    /// The chip has reset itself.
    Reset,
    /// All outputs are zero: the chip has reset itself, or a line of the bus is held low.
    AllZero,
    /// Words of 0xFFFF: the chip did not drive the data line.
    AllOnes,
    /// The same data again and again, or a gyroscope without noise.
    Frozen,
    /// Values beyond the sensors' range.
    Implausible,
    /// All three words of a sensor became 0 at once, far from the words before.
    Torn,
    /// A tick went by without its burst.
    Late,
    /// Suspended by request.
    Suspended,
    /// Too many recent samples were bad: the good samples are not trusted either.
    Unreliable,
    /// A register did not read as written once. The driver reads it again, because a wrong bit on
    /// the wire looks the same.
    RegisterMismatch,
}

impl SensorFault {
    /// Stable number: the kind in the high byte, and in the low one its detail (register,
    /// identification, result or error), 0 if it has none.
    #[must_use]
    pub const fn code(&self) -> u16 {
        let (kind, detail) = match *self {
            Self::Booting => (1, 0),
            Self::Nak => (2, 0),
            Self::Timeout => (3, 0),
            Self::Stuck => (4, 0),
            Self::Arbitration => (5, 0),
            Self::Protocol => (6, 0),
            Self::WrongChip { found } => (7, found),
            Self::DeadSensor { sensor, .. } => (8, sensor),
            Self::SelfTest { result } => (9, result),
            Self::System { error } => (10, error),
            Self::Configuration { register, .. } => (11, register),
            Self::Clock => (12, 0),
            Self::Reset => (13, 0),
            Self::AllOnes => (14, 0),
            Self::Frozen => (15, 0),
            Self::Implausible => (16, 0),
            Self::Torn => (17, 0),
            Self::Late => (18, 0),
            Self::Suspended => (19, 0),
            Self::Profile { register } => (20, register),
            Self::Unreliable => (21, 0),
            Self::RegisterMismatch => (22, 0),
            Self::AllZero => (23, 0),
        };
        (kind as u16) << 8 | detail as u16
    }

    /// Whether the samples before the fault were wrong already, so a vehicle must stop using them
    /// at once.
    #[must_use]
    pub const fn ends_trust(&self) -> bool {
        matches!(self, Self::Reset | Self::Configuration { .. } | Self::Frozen | Self::Unreliable)
    }

    /// Whether the bus, not the chip's data, is to blame.
    #[must_use]
    pub const fn is_bus(&self) -> bool {
        matches!(
            self,
            Self::Nak
                | Self::Timeout
                | Self::Stuck
                | Self::Arbitration
                | Self::Protocol
                | Self::AllOnes
        )
    }
}

impl From<BusError> for SensorFault {
    fn from(error: BusError) -> Self {
        match error {
            BusError::Nak => Self::Nak,
            BusError::Timeout => Self::Timeout,
            BusError::Stuck => Self::Stuck,
            BusError::Arbitration => Self::Arbitration,
            BusError::Protocol => Self::Protocol,
        }
    }
}

impl fmt::Display for SensorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Booting => f.write_str("IMU booting"),
            Self::Nak => f.write_str("IMU does not answer"),
            Self::Timeout => f.write_str("IMU transfer timed out"),
            Self::Stuck => f.write_str("IMU bus line held low"),
            Self::Arbitration => f.write_str("IMU bus arbitration lost"),
            Self::Protocol => f.write_str("IMU bus protocol error"),
            Self::WrongChip { found } => write!(f, "IMU is another chip: id {}", Hex(found)),
            Self::DeadSensor { sensor, found } => {
                f.write_str(match sensor {
                    1 => "IMU accelerometer",
                    2 => "IMU magnetometer",
                    _ => "IMU gyroscope",
                })?;
                write!(f, " dead: id {}", Hex(found))
            }
            Self::SelfTest { result } => write!(f, "IMU self-test failed: {}", Hex(result)),
            Self::System { error } => write!(f, "IMU error: {}", Hex(error)),
            Self::Configuration { register, found } => {
                write!(f, "IMU register {} reads {}", Hex(register), Hex(found))
            }
            Self::Profile { register } => {
                write!(f, "IMU profile out of range at {}", Hex(register))
            }
            Self::Clock => f.write_str("IMU crystal does not start"),
            Self::Reset => f.write_str("IMU has reset itself"),
            Self::AllZero => f.write_str("IMU data all zero"),
            Self::AllOnes => f.write_str("IMU data all ones"),
            Self::Frozen => f.write_str("IMU data frozen"),
            Self::Implausible => f.write_str("IMU data out of range"),
            Self::Torn => f.write_str("IMU data torn"),
            Self::Late => f.write_str("IMU sample late"),
            Self::Suspended => f.write_str("IMU suspended"),
            Self::Unreliable => f.write_str("IMU data unreliable"),
            Self::RegisterMismatch => f.write_str("IMU register in doubt"),
        }
    }
}

impl core::error::Error for SensorFault {}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::string::ToString;
    use std::vec::Vec;

    use super::*;

    fn all() -> Vec<SensorFault> {
        let mut all = [
            SensorFault::Booting,
            SensorFault::Nak,
            SensorFault::Timeout,
            SensorFault::Stuck,
            SensorFault::Arbitration,
            SensorFault::Protocol,
            SensorFault::WrongChip { found: 0xFF },
            SensorFault::SelfTest { result: 0xFF },
            SensorFault::Configuration { register: 0xFF, found: 0xFF },
            SensorFault::Profile { register: 0xFF },
            SensorFault::Clock,
            SensorFault::Reset,
            SensorFault::AllZero,
            SensorFault::AllOnes,
            SensorFault::Frozen,
            SensorFault::Implausible,
            SensorFault::Torn,
            SensorFault::Late,
            SensorFault::Suspended,
            SensorFault::Unreliable,
            SensorFault::RegisterMismatch,
        ]
        .to_vec();
        all.extend((1..=3).map(|sensor| SensorFault::DeadSensor { sensor, found: 0xFF }));
        all.extend((0..=11).map(|error| SensorFault::System { error }));
        all
    }

    #[test]
    fn texts_are_short_and_each_its_own() {
        let texts: HashSet<_> = all().iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), all().len());
        for text in texts {
            assert!(text.len() <= 34 && text.is_ascii(), "{text}");
        }
    }

    #[test]
    fn codes_are_each_their_own_and_stable() {
        let codes: HashSet<_> = all().iter().map(SensorFault::code).collect();
        assert_eq!(codes.len(), all().len());
        assert_eq!(SensorFault::Nak.code(), 0x0200);
        assert_eq!(SensorFault::Reset.code(), 0x0D00);
        assert_eq!(SensorFault::Configuration { register: 0x41, found: 0x24 }.code(), 0x0B41);
        assert_eq!(SensorFault::System { error: 9 }.code(), 0x0A09);
    }
}
