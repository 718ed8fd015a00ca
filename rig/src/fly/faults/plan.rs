//! What a campaign tries.

use std::ops::RangeInclusive;

use super::{GLITCHES, Kind, Phase, SoundKind, SystemKind};
use crate::bno055::FaultKind;
use crate::lsm6ds3;
use crate::named_enum::named_enum;

named_enum! {
    /// What a campaign tries.
    Plan, "campaign";
    /// Faults of all kinds, at random instants.
    Faults = "faults",
    /// Glitches of the cable: faults that last for 4 to 40 ms, and in which no byte at all is
    /// acknowledged.
    Glitches = "glitches",
    /// What ends in a reset by the firmware itself, by a watchdog whose oscillator may run at any
    /// rate.
    Resets = "resets",
    /// Each bit of the servo timer's registers flips.
    TimerBits = "timer-bits",
    /// No fault at all: what the firmware does to a sound vehicle.
    Sound = "sound",
}

/// What ends in a reset by the firmware itself. A reboot is obeyed where nothing is armed.
const RESETS: [(SystemKind, Phase); 7] = [
    (SystemKind::Hang, Phase::Flight),
    (SystemKind::HangInterrupt, Phase::Flight),
    (SystemKind::HardFault, Phase::Flight),
    (SystemKind::StackOverflow, Phase::Flight),
    (SystemKind::FailedCheck, Phase::Flight),
    (SystemKind::Hang, Phase::Armed),
    (SystemKind::Reboot, Phase::Standby),
];
/// How long faults last, ms: as likely between 5 and 50 as between 50 and 500.
const LASTING_MS: RangeInclusive<f64> = 5.0..=super::LONGEST_MS;
/// Glitches are short enough to be ridden out.
const GLITCH_MS: RangeInclusive<f64> = 4.0..=40.0;

impl Plan {
    /// The kinds that it tries in a phase.
    pub fn kinds(self, phase: Phase) -> Vec<Kind> {
        let sensor = FaultKind::ALL.into_iter().map(Kind::Sensor);
        let system = SystemKind::ALL.into_iter().map(Kind::System);
        match self {
            Self::Faults if phase == Phase::Flight => {
                let onboard = lsm6ds3::Fault::ALL.into_iter().map(Kind::Onboard);
                sensor.chain(system).chain(onboard).collect()
            }
            Self::Faults => system.collect(),
            Self::Glitches => GLITCHES.map(Kind::Sensor).to_vec(),
            Self::Resets => {
                let of_phase = RESETS.into_iter().filter(|(_, in_phase)| *in_phase == phase);
                of_phase.map(|(kind, _)| Kind::System(kind)).collect()
            }
            Self::TimerBits => vec![Kind::System(SystemKind::TimerRegister)],
            Self::Sound => SoundKind::of(phase).into_iter().map(Kind::Sound).collect(),
        }
    }

    /// The phases that it tries by itself.
    pub fn phases(self) -> Vec<Phase> {
        match self {
            Self::Resets => vec![Phase::Flight, Phase::Armed, Phase::Standby],
            Self::Sound => {
                let mut phases = Phase::ALL.to_vec();
                phases.retain(|phase| !self.kinds(*phase).is_empty());
                phases
            }
            _ => vec![Phase::Flight],
        }
    }

    /// How long a fault lasts, ms.
    pub(super) fn lasting_ms(self) -> RangeInclusive<f64> {
        match self {
            Self::Glitches => GLITCH_MS,
            _ => LASTING_MS,
        }
    }

    /// Rates of the slow oscillator, relative to 32,768 Hz: those of the data sheet; or, where the
    /// watchdog is what matters, beyond them.
    pub(super) fn slow_clock(self) -> RangeInclusive<f64> {
        match self {
            Self::Resets => 0.87..=1.4,
            _ => 0.87..=1.25,
        }
    }
}
