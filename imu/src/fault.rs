//! The faults of the sensor, its data and its bus.

use core::fmt;

use crate::hex::Hex;
use crate::transfer::BusError;

/// Defines [`SensorFault`] from a table: a fault, its details, the number of its kind with the
/// detail that its code carries, and its words.
macro_rules! faults {
    (
        $(#[$about:meta])*
        $name:ident {
            $($(#[$doc:meta])* $fault:ident
                $({ $($(#[$detail_doc:meta])* $detail:ident),+ })?
                = $kind:literal $(+ $coded:ident)?, $(($first:expr))? $words:literal $(, $shown:expr)*;)+
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name {
            $($(#[$doc])* $fault $({ $($(#[$detail_doc])* $detail: u8,)+ })?,)+
        }

        impl $name {
            /// Stable number: the kind in the high byte, and in the low one its detail (register,
            /// identification, result or error), 0 if it has none.
            #[must_use]
            pub const fn code(&self) -> u16 {
                match *self {
                    $(Self::$fault { $($coded, ..)? } => $kind << 8 $(| $coded as u16)?,)+
                }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match *self {
                    $(Self::$fault $({ $($detail),+ })? => {
                        $(f.write_str($first)?;)?
                        write!(f, $words $(, $shown)*)
                    })+
                }
            }
        }
    };
}

faults! {
    /// The reason for a missing sample.
    ///
    /// `Display` gives at most 34 characters, so that a fault with a prefix fits a MAVLink
    /// STATUSTEXT.
    SensorFault {
        /// Being set up, and not yet late.
        Booting = 1, "IMU booting";
        /// The chip does not acknowledge: it is unplugged, booting, or lost after a reset.
        Nak = 2, "IMU does not answer";
        /// A transfer missed its deadline.
        Timeout = 3, "IMU transfer timed out";
        /// A bus line is held low.
        Stuck = 4, "IMU bus line held low";
        /// Another master, or noise, won the bus.
        Arbitration = 5, "IMU bus arbitration lost";
        /// The bus misbehaved, or an answer had the wrong length.
        Protocol = 6, "IMU bus protocol error";
        /// The identification is another chip's.
        WrongChip {
            /// The value read.
            found
        } = 7 + found, "IMU is another chip: id {}", Hex(found);
        /// The chip answers, but one of its sensors does not identify itself.
        DeadSensor {
            /// 1 accelerometer, 2 magnetometer, 3 gyroscope.
            sensor,
            /// The value read.
            found
        } = 8 + sensor, (match sensor {
            1 => "IMU accelerometer",
            2 => "IMU magnetometer",
            _ => "IMU gyroscope",
        }) " dead: id {}", Hex(found);
        /// The power-on self-test failed.
        SelfTest {
            /// The chip's own word for it.
            result
        } = 9 + result, "IMU self-test failed: {}", Hex(result);
        /// The chip reports a system error.
        System {
            /// The chip's own number of it.
            error
        } = 10 + error, "IMU error: {}", Hex(error);
        /// A register does not hold the written value.
        Configuration {
            /// The register.
            register,
            /// The value read.
            found
        } = 11 + register, "IMU register {} reads {}", Hex(register), Hex(found);
        /// The configured calibration profile has a value out of range; it is not written.
        Profile {
            /// Register of the value's low byte.
            register
        } = 20 + register, "IMU profile out of range at {}", Hex(register);
        /// The external crystal does not start.
        Clock = 12, "IMU crystal does not start";
        /// The chip has reset itself.
        Reset = 13, "IMU has reset itself";
        /// All outputs are zero: the chip has reset itself, or a line of the bus is held low.
        AllZero = 23, "IMU data all zero";
        /// Words of 0xFFFF: the chip did not drive the data line.
        AllOnes = 14, "IMU data all ones";
        /// The same data again and again, or a gyroscope without noise.
        Frozen = 15, "IMU data frozen";
        /// Values beyond the sensors' range.
        Implausible = 16, "IMU data out of range";
        /// All three words of a sensor became 0 at once, far from the words before.
        Torn = 17, "IMU data torn";
        /// A tick went by without its burst.
        Late = 18, "IMU sample late";
        /// Suspended by request.
        Suspended = 19, "IMU suspended";
        /// Too many recent samples were bad: the good samples are not trusted either.
        Unreliable = 21, "IMU data unreliable";
        /// A register did not read as written once. The driver reads it again, because a wrong bit
        /// on the wire looks the same.
        RegisterMismatch = 22, "IMU register in doubt";
        /// Two sensors on one body turn differently.
        Disagreement = 24, "IMUs disagree";
    }
}

impl SensorFault {
    /// Whether the samples before the fault were wrong already, so a vehicle must stop using them
    /// at once.
    #[must_use]
    pub const fn ends_trust(&self) -> bool {
        matches!(
            self,
            Self::Reset
                | Self::Configuration { .. }
                | Self::Frozen
                | Self::Unreliable
                | Self::Disagreement
        )
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
            SensorFault::Disagreement,
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
