//! States, reasons and refusals as numbers, for whoever is told of them: one vocabulary for the
//! vehicle and its hosts.
//!
//! HEARTBEAT's `custom_mode` carries a [`StateCode`], COMMAND_ACK's `result_param1` a
//! [`RefusalKind`]. Each number has a type that it is read into (`TryFrom`) and words for it
//! (`Display`).

use core::fmt;

#[cfg(doc)]
use super::{Latch, Reason, Refusal, State};
use crate::config::{ARM_TILT_DEG, FAILSAFE_TILT_DEG, HOST_SILENCE_US};
use crate::format::Whole;
use crate::self_test::Failure;

/// A number that stands for nothing in this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnknownCode(pub u32);

impl fmt::Display for UnknownCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown code {}", Whole(self.0))
    }
}

impl core::error::Error for UnknownCode {}

/// An enum whose variants are numbers: `TryFrom<u8>`, and all of them in `ALL`.
macro_rules! numbered {
    (
        $(#[$meta:meta])*
        $name:ident { $($(#[$doc:meta])* $variant:ident = $number:literal,)+ }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$doc])* $variant = $number,)+ }

        impl $name {
            /// All of them, by number.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];

            /// Its number.
            pub const fn code(self) -> u8 {
                self as u8
            }
        }

        impl TryFrom<u8> for $name {
            type Error = $crate::failsafe::UnknownCode;

            fn try_from(code: u8) -> Result<Self, Self::Error> {
                match code {
                    $($number => Ok(Self::$variant),)+
                    _ => Err($crate::failsafe::UnknownCode(code.into())),
                }
            }
        }
    };
}

pub(crate) use numbered;

numbered! {
    /// A [`State`] without its details.
    StateKind {
        /// No sample yet.
        Boot = 0,
        /// Waiting for a second of rest.
        SelfTest = 1,
        /// Ready to be armed.
        Standby = 2,
        /// Held in hand or clamp.
        Armed = 3,
        /// The rudder is under control.
        Active = 4,
        /// A fault in operation.
        Failsafe = 5,
        /// Something to acknowledge at start-up.
        Latched = 6,
    }
}

numbered! {
    /// A [`Reason`] without its details.
    ReasonKind {
        /// The sensor gave nothing usable for too long, or lost its configuration.
        Sensor = 1,
        /// Samples did not come, or were too old.
        StaleData = 2,
        /// The attitude is not a rotation.
        InvalidAttitude = 3,
        /// Tilted beyond the limit.
        Tilt = 4,
        /// The host fell silent.
        HostSilent = 5,
    }
}

numbered! {
    /// A [`Latch`] without its details.
    LatchKind {
        /// The watchdog fired.
        Watchdog = 1,
        /// The supply dipped.
        BrownOut = 2,
        /// The program panicked.
        Panic = 3,
        /// The processor met an instruction or access it cannot do.
        HardFault = 4,
        /// The stored parameters cannot be read.
        ParametersLost = 5,
    }
}

numbered! {
    /// A [`Refusal`] without its details.
    RefusalKind {
        /// The command does not apply in this state.
        WrongState = 1,
        /// Tilted too much to be armed.
        Tilt = 2,
        /// The sensor is not delivering.
        Sensor = 3,
        /// The attitude has not settled.
        Settling = 4,
        /// The rudder's polarity has not been checked.
        Polarity = 5,
        /// The rudder answers the tilt.
        RudderAnswers = 6,
        /// The gyro's offset has not been learned.
        BiasUnknown = 7,
        /// The host's heartbeat is missing.
        HostSilent = 8,
        /// The fault is still there.
        FaultPersists = 9,
    }
}

impl StateKind {
    /// Whether the drone counts as armed: [`State::is_armed`].
    pub const fn is_armed(self) -> bool {
        matches!(self, Self::Armed | Self::Active)
    }
}

impl fmt::Display for StateKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Boot => "boot",
            Self::SelfTest => "self-test",
            Self::Standby => "standby",
            Self::Armed => "armed",
            Self::Active => "active",
            Self::Failsafe => "failsafe",
            Self::Latched => "latched fault",
        })
    }
}

impl fmt::Display for ReasonKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sensor => f.write_str("sensor fault"),
            Self::StaleData => f.write_str("sensor data too old"),
            Self::InvalidAttitude => f.write_str("attitude invalid"),
            Self::Tilt => write_tilt(f, FAILSAFE_TILT_DEG),
            Self::HostSilent => {
                write!(
                    f,
                    "host silent for {} s",
                    Whole((HOST_SILENCE_US / 1_000_000) as u32)
                )
            }
        }
    }
}

impl fmt::Display for LatchKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Watchdog => "watchdog reset",
            Self::BrownOut => "brown-out reset",
            Self::Panic => "panic",
            Self::HardFault => "hard fault",
            Self::ParametersLost => "stored parameters lost",
        })
    }
}

impl fmt::Display for RefusalKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::WrongState => "not in this state",
            Self::Tilt => return write_tilt(f, ARM_TILT_DEG),
            Self::Sensor => "sensor not ready",
            Self::Settling => "attitude still settling",
            Self::Polarity => "run tvc calibrate polarity first",
            Self::RudderAnswers => "rudder answers tilt: SRV_POLARITY 2",
            Self::BiasUnknown => "gyro offset unknown: hold still",
            Self::HostSilent => "no host heartbeat",
            Self::FaultPersists => "the fault is still there",
        })
    }
}

fn write_tilt(f: &mut fmt::Formatter<'_>, limit_deg: u32) -> fmt::Result {
    write!(f, "tilt beyond {} deg", Whole(limit_deg))
}

/// A state and the reason for it, as HEARTBEAT's `custom_mode` carries them: the [`StateKind`] in
/// the low byte, in the second one the kind of reason, 0 for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StateCode {
    /// [`State::Boot`].
    Boot,
    /// [`State::SelfTest`], and what ended the attempt before this one.
    SelfTest(Option<Failure>),
    /// [`State::Standby`].
    Standby,
    /// [`State::Armed`].
    Armed,
    /// [`State::Active`].
    Active,
    /// [`State::Failsafe`].
    Failsafe(ReasonKind),
    /// [`State::Latched`].
    Latched(LatchKind),
}

impl StateCode {
    /// The state alone.
    pub const fn kind(self) -> StateKind {
        match self {
            Self::Boot => StateKind::Boot,
            Self::SelfTest(_) => StateKind::SelfTest,
            Self::Standby => StateKind::Standby,
            Self::Armed => StateKind::Armed,
            Self::Active => StateKind::Active,
            Self::Failsafe(_) => StateKind::Failsafe,
            Self::Latched(_) => StateKind::Latched,
        }
    }

    /// As `custom_mode` has it.
    pub const fn number(self) -> u32 {
        let reason = match self {
            Self::SelfTest(Some(failure)) => failure.code(),
            Self::Failsafe(reason) => reason.code(),
            Self::Latched(latch) => latch.code(),
            Self::Boot | Self::SelfTest(None) | Self::Standby | Self::Armed | Self::Active => 0,
        };
        self.kind().code() as u32 | (reason as u32) << 8
    }
}

impl TryFrom<u32> for StateCode {
    type Error = UnknownCode;

    fn try_from(number: u32) -> Result<Self, UnknownCode> {
        let [state, reason, high @ ..] = number.to_le_bytes();
        let unknown = |_| UnknownCode(number);
        if high != [0; 2] {
            return Err(UnknownCode(number));
        }
        let code = match StateKind::try_from(state).map_err(unknown)? {
            StateKind::Boot => Self::Boot,
            StateKind::SelfTest if reason == 0 => Self::SelfTest(None),
            StateKind::SelfTest => {
                Self::SelfTest(Some(Failure::try_from(reason).map_err(unknown)?))
            }
            StateKind::Standby => Self::Standby,
            StateKind::Armed => Self::Armed,
            StateKind::Active => Self::Active,
            StateKind::Failsafe => Self::Failsafe(ReasonKind::try_from(reason).map_err(unknown)?),
            StateKind::Latched => Self::Latched(LatchKind::try_from(reason).map_err(unknown)?),
        };
        // A reason where there can be none is no code of this version.
        if code.number() == number {
            Ok(code)
        } else {
            Err(UnknownCode(number))
        }
    }
}

/// The words of [`State`], as far as a code has them.
impl fmt::Display for StateCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind())?;
        match self {
            Self::Boot => f.write_str(": waiting for the sensor"),
            Self::SelfTest(None) => f.write_str(": hold still"),
            Self::SelfTest(Some(failure)) => write!(f, ": {failure}"),
            Self::Standby | Self::Armed | Self::Active => Ok(()),
            Self::Failsafe(reason) => write!(f, ": {reason}"),
            Self::Latched(latch) => write!(f, ": {latch}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;
    use std::vec::Vec;

    fn all_codes() -> Vec<StateCode> {
        let mut codes = std::vec![
            StateCode::Boot,
            StateCode::SelfTest(None),
            StateCode::Standby,
            StateCode::Armed,
            StateCode::Active,
        ];
        codes.extend(Failure::ALL.iter().map(|f| StateCode::SelfTest(Some(*f))));
        codes.extend(ReasonKind::ALL.iter().map(|r| StateCode::Failsafe(*r)));
        codes.extend(LatchKind::ALL.iter().map(|l| StateCode::Latched(*l)));
        codes
    }

    #[test]
    fn every_state_and_reason_comes_back_from_its_number_and_no_other_number_means_one() {
        let codes = all_codes();
        let mut known = 0;
        for number in (0..0x1_0000).chain([0x1_0000, 0x0100_0002, u32::MAX]) {
            if let Ok(code) = StateCode::try_from(number) {
                assert_eq!(code.number(), number);
                assert!(codes.contains(&code));
                known += 1;
            }
        }
        assert_eq!(known, codes.len());
        assert_eq!(
            StateCode::try_from(0x105),
            Ok(StateCode::Failsafe(ReasonKind::Sensor))
        );
        assert_eq!(StateCode::try_from(7), Err(UnknownCode(7)));
    }

    #[test]
    fn kinds_come_back_from_their_numbers() {
        for kind in RefusalKind::ALL {
            assert_eq!(RefusalKind::try_from(kind.code()), Ok(*kind));
        }
        for (number, kind) in StateKind::ALL.iter().enumerate() {
            assert_eq!(StateKind::try_from(number as u8), Ok(*kind));
        }
        assert_eq!(RefusalKind::try_from(0), Err(UnknownCode(0)));
    }

    #[test]
    fn words_take_their_numbers_from_the_limits_and_fit_the_line() {
        assert_eq!(
            StateCode::Failsafe(ReasonKind::Tilt).to_string(),
            "failsafe: tilt beyond 60 deg"
        );
        assert_eq!(ReasonKind::HostSilent.to_string(), "host silent for 3 s");
        assert_eq!(RefusalKind::Tilt.to_string(), "tilt beyond 50 deg");
        for code in all_codes() {
            assert!(code.to_string().len() <= 50, "{code}");
        }
        for refusal in RefusalKind::ALL {
            assert!(
                refusal.to_string().len() + "pulse refused: ".len() <= 50,
                "{refusal}"
            );
        }
    }
}
