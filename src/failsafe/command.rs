//! What the operator may ask for, and why it may be refused.

use core::fmt;

use super::code::RefusalKind;
use super::state::{Reason, State};
use crate::servo::PulseUs;

/// What an operator may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Standby to armed.
    Arm,
    /// Armed to active: the drone is let go.
    Release,
    /// Back to standby from anywhere; acknowledges a failsafe or latched fault whose cause is gone.
    Disarm,
    /// Hold a pulse for [`TEST_PULSE_US`](crate::config::TEST_PULSE_US), to set the servo up, where
    /// nobody needs the rudder.
    TestPulse(PulseUs),
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Command::Arm => "arm",
            Command::Release => "release",
            Command::Disarm => "disarm",
            Command::TestPulse(_) => "pulse",
        })
    }
}

/// Why a command was not obeyed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// The command does not apply in this state.
    WrongState(State),
    /// Tilted more than [`ARM_TILT_DEG`](crate::config::ARM_TILT_DEG).
    Tilt,
    /// The sensor is not delivering.
    Sensor,
    /// The attitude has not settled since start-up or the last gap.
    Settling,
    /// Nobody has seen the rudder answer a tilt the right way, with the servo's direction and the
    /// mount as they are.
    Polarity,
    /// The rudder answers the tilt, for somebody who looks at its polarity (`SRV_POLARITY` = 2).
    RudderAnswers,
    /// The gyro's offset has not been learned since start-up or the last gap, which takes some
    /// seconds of rest.
    BiasUnknown,
    /// The host's heartbeat is missing, and `FS_HOST` asks for it.
    HostSilent,
    /// The fault is still there.
    FaultPersists(Reason),
}

impl Refusal {
    /// The refusal without its details.
    pub fn kind(&self) -> RefusalKind {
        match self {
            Refusal::WrongState(_) => RefusalKind::WrongState,
            Refusal::Tilt => RefusalKind::Tilt,
            Refusal::Sensor => RefusalKind::Sensor,
            Refusal::Settling => RefusalKind::Settling,
            Refusal::Polarity => RefusalKind::Polarity,
            Refusal::RudderAnswers => RefusalKind::RudderAnswers,
            Refusal::BiasUnknown => RefusalKind::BiasUnknown,
            Refusal::HostSilent => RefusalKind::HostSilent,
            Refusal::FaultPersists(_) => RefusalKind::FaultPersists,
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refusal::WrongState(state) => write!(f, "in {state}"),
            Refusal::FaultPersists(reason) => reason.fmt(f),
            _ => self.kind().fmt(f),
        }
    }
}
