//! States, reasons and refusals as numbers, the same for the vehicle and its hosts.
//!
//! HEARTBEAT's `custom_mode` carries a [`StateCode`], COMMAND_ACK's `result_param1` a
//! [`RefusalKind`](super::RefusalKind). Each number has a type that parses it (`TryFrom`) and
//! names it (`Display`). The lists that [`numbered!`](crate::numbered) and `detailed!` take
//! define each number once.

use core::fmt;

use super::reason::ReasonKind;
#[cfg(doc)]
use super::{Latch, State};
use crate::numbered::{UnknownCode, detailed, numbered};
use crate::self_test::Failure;

numbered! {
    /// A [`Latch`] without its details.
    LatchKind {
        /// The watchdog fired.
        Watchdog = 1, "watchdog reset";
        /// The supply dipped.
        BrownOut = 2, "brown-out reset";
        /// The firmware found something wrong with itself.
        SelfCheck = 3, "self-check failed";
        /// The processor met an instruction or access it cannot do.
        HardFault = 4, "hard fault";
        /// The stored parameters cannot be read.
        ParametersLost = 5, "stored parameters lost";
    }
}

numbered! {
    /// What the firmware has found wrong with itself, where it cannot go on: the servo goes to
    /// neutral, the chip is reset, and the next run tells this.
    SelfCheck {
        /// The stack has reached the statics.
        Stack = 1, "stack overflow";
        /// The servo's timer does not answer.
        ServoTimer = 2, "servo timer";
        /// An interrupt came that nobody enabled.
        Interrupt = 3, "interrupt";
        /// A clock could not be set up.
        Clock = 4, "clock";
        /// What is there once was taken twice: a defect of the program.
        TakenTwice = 5, "taken twice";
        /// The parameters make no estimator: a defect of the program.
        Configuration = 6, "configuration";
        /// `tvc bringup` asked for it.
        Ordered = 7, "ordered";
        /// The flight's state or settings are not as its last step or order left them.
        Memory = 9, "memory";
        /// The image in flash has changed.
        Flash = 10, "flash";
        /// A register of the servo's timer or of the watchdog is not as it was set, or ticks are
        /// lost.
        Registers = 11, "registers";
        /// The program panicked. No call of a panic is linked into the image, which a test holds.
        Panic = 8, "panic";
    }
}

detailed! {
    /// A state and the kind of reason for it, as HEARTBEAT's `custom_mode` carries them: the
    /// [`StateKind`] in the low byte, in the second one the reason, 0 for none.
    StateCode,
    /// A [`State`] without its details.
    StateKind {
        /// No sample yet.
        Boot = 0, "boot";
        /// Waiting for a second of rest, after a failed attempt or the first time.
        SelfTest(Option<Failure>) = 1, "self-test";
        /// Ready to be armed.
        Standby = 2, "standby";
        /// Held in hand or clamp.
        Armed = 3, "armed";
        /// The rudder is under control.
        Active = 4, "active";
        /// A fault in operation.
        Failsafe(ReasonKind) = 5, "failsafe";
        /// Something to acknowledge at start-up.
        Latched(LatchKind) = 6, "latched fault";
    }
}

impl StateKind {
    /// Whether the drone counts as armed: [`State::is_armed`].
    pub const fn is_armed(self) -> bool {
        matches!(self, Self::Armed | Self::Active)
    }
}

impl StateCode {
    /// How many there are.
    pub const COUNT: usize = 5 + Failure::ALL.len() + ReasonKind::ALL.len() + LatchKind::ALL.len();

    /// Every state with every reason that it can have.
    pub fn all() -> impl Iterator<Item = Self> {
        let failures = Failure::ALL.iter().map(|failure| Self::SelfTest(Some(*failure)));
        let reasons = ReasonKind::ALL.iter().map(|reason| Self::Failsafe(*reason));
        let latches = LatchKind::ALL.iter().map(|latch| Self::Latched(*latch));
        [Self::Boot, Self::SelfTest(None), Self::Standby, Self::Armed, Self::Active]
            .into_iter()
            .chain(failures)
            .chain(reasons)
            .chain(latches)
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
        Self::all().find(|code| code.number() == number).ok_or(UnknownCode(number))
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
    use crate::failsafe::{Crash, Latch, Refusal, RefusalKind, State};
    use std::format;
    use std::string::ToString;
    use std::vec::Vec;

    #[test]
    fn every_state_and_reason_comes_back_from_its_number_and_no_other_number_means_one() {
        let codes: Vec<_> = StateCode::all().collect();
        assert_eq!(codes.len(), StateCode::COUNT);
        let mut known = 0;
        for number in (0..0x1_0000).chain([0x1_0000, 0x0100_0002, u32::MAX]) {
            if let Ok(code) = StateCode::try_from(number) {
                assert_eq!(code.number(), number);
                assert!(codes.contains(&code));
                known += 1;
            }
        }
        assert_eq!(known, codes.len());
        assert_eq!(StateCode::try_from(0x105), Ok(StateCode::Failsafe(ReasonKind::Sensor)));
        assert_eq!(StateCode::try_from(7), Err(UnknownCode(7)));
    }

    /// MAVProxy knows the modes of a rocket (MAV_TYPE 9) by this file only.
    #[test]
    fn the_file_for_mavproxy_names_every_state() {
        let rows: Vec<_> =
            StateCode::all().map(|code| format!("  \"{}\": \"{code}\"", code.number())).collect();
        let file = include_str!("../../tools/custom_mode_map.json");
        assert_eq!(file, format!("{{\"9\": {{\n{}\n}}}}\n", rows.join(",\n")));
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
        for code in StateCode::all() {
            assert!(code.to_string().len() <= 50, "{code}");
        }
        for refusal in RefusalKind::ALL {
            assert!(refusal.to_string().len() + "pulse refused: ".len() <= 50, "{refusal}");
        }
        // With their longest details.
        let checks = SelfCheck::ALL.iter().map(|check| Crash::SelfCheck(*check));
        for crash in checks.chain([Crash::HardFault { pc: u32::MAX }]) {
            let state = State::Latched(Latch::Crash(crash));
            assert!(state.to_string().len() <= 50, "{state}");
            let refused = format!("calibration refused: {}", Refusal::WrongState(state));
            assert!(refused.len() <= 50, "{refused}");
        }
    }
}
