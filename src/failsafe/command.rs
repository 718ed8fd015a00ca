//! What the operator may ask for, and why it may be refused.

use core::fmt;

use super::reason::Reason;
use super::state::State;
use crate::axis::Axis;
use crate::config::ARM_TILT_DEG;
use crate::format::Whole;
use crate::numbered::detailed;
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
    TestPulse(Axis, PulseUs),
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Command::Arm => "arm",
            Command::Release => "release",
            Command::Disarm => "disarm",
            Command::TestPulse(..) => "pulse",
        })
    }
}

// The words name this limit.
const _: () = assert!(ARM_TILT_DEG == 50);

detailed! {
    /// Why a command was not obeyed.
    Refusal,
    /// A [`Refusal`] without its details.
    RefusalKind {
        /// The command does not apply in this state.
        WrongState(State) = 1, "not in this state";
        /// Tilted more than [`ARM_TILT_DEG`].
        Tilt = 2, "tilt beyond 50 deg";
        /// The sensor is not delivering.
        Sensor = 3, "sensor not ready";
        /// The attitude has not settled since start-up or the last gap.
        Settling = 4, "attitude still settling";
        /// Nobody has seen the rudder answer a tilt the right way, with the servo's direction and
        /// the mount as they are.
        Polarity = 5, "run tvc calibrate polarity first";
        /// The rudder answers the tilt, for somebody who looks at its polarity (`SRV_POLARITY` =
        /// 2).
        RudderAnswers = 6, "rudder answers tilt: SRV_POLARITY 2";
        /// The gyro's offset has not been learned since start-up or the last gap, which takes some
        /// seconds of rest.
        BiasUnknown = 7, "gyro offset unknown: hold still";
        /// The host's heartbeat is missing, and `FS_HOST` asks for it.
        HostSilent = 8, "no host heartbeat";
        /// The fault is still there.
        FaultPersists(Reason) = 9, "the fault is still there";
        /// The sensor's bursts take so long, us, that it cannot be sampled 100 times a second.
        SlowBus(u32) = 10, "IMU bursts too slow";
        /// A test pulse for the servo of an axis that is not steered.
        NotSteered = 11, "no servo there: AXES 1";
        /// The times of the gain schedule's rows do not rise.
        Schedule = 12, "schedule: times must rise";
        /// At rest the gyro reads a rate that is too large for an offset, or the vehicle turns
        /// steadily about the vertical.
        BiasRefused = 13, "gyro offset too large: calibrate";
        /// The standard deviation of the tilt is beyond
        /// [`ARM_TILT_SD_DEG`](crate::config::ARM_TILT_SD_DEG).
        Uncertain = 14, "tilt uncertain: hold still";
        /// More than one burst in a hundred is lost, and what is to settle does not.
        BurstsLost = 15, "IMU bursts lost: check the cable";
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // Its reason has been told, and with it the text would be cut.
            Refusal::WrongState(state) => write!(f, "in {}", state.kind()),
            Refusal::FaultPersists(reason) => reason.fmt(f),
            Refusal::SlowBus(us) => write!(f, "IMU bursts of {} us too slow", Whole(*us)),
            _ => self.kind().fmt(f),
        }
    }
}
