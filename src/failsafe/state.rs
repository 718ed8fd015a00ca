//! The states of the flight, and why it is in one.

use core::fmt;

use tvc_imu::{Micros, SensorFault};

use super::code::{LatchKind, SelfCheck, StateCode, StateKind};
use super::reason::{Reason, ReasonKind};
use crate::format::Hex;
use crate::self_test::SelfTest;
use crate::store::Loaded;

/// Where the flight stands.
///
/// ```text
///  clean reset ──▶ Boot ──first sample──▶ SelfTest ──a still second──▶ Standby
///                  ▲  ▲                      │                          │   ▲
///                  │  └──────sensor lost─────┘                       arm│   │disarm
///  disarm          │                                                    ▼   │
///  (acknowledge)   │                                                   Armed ───release──▶ Active
///                  │                                                    │   ▲                │
///  reset after ──▶ Latched                          disarm leads from Active to Standby too ─┘
///  watchdog, brown-out, crash,
///  or with its parameters lost
///
///  Standby, Armed, Active ──fault──▶ Failsafe ──disarm, once the fault is gone──▶ Standby
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// No sample yet.
    Boot,
    /// Waiting for a second of rest.
    SelfTest(SelfTest),
    /// Ready to be armed.
    Standby,
    /// Held in hand or clamp; released next.
    Armed,
    /// The rudder is under control.
    Active {
        /// Since when the tilt has been beyond the limit.
        over_tilt_since: Option<Micros>,
    },
    /// A fault in operation. The operator leads out of it.
    Failsafe(Reason),
    /// Something that the operator must have seen before anything is armed.
    Latched(Latch),
}

impl State {
    /// The state of a code, where the code says enough. A sensor fault comes back as any of its
    /// kind. `None` before standby, and for a fault that is to be acknowledged.
    pub(super) fn resumed(code: StateCode) -> Option<Self> {
        Some(match code {
            StateCode::Standby => State::Standby,
            StateCode::Armed => State::Armed,
            StateCode::Active => State::Active { over_tilt_since: None },
            StateCode::Failsafe(reason) => State::Failsafe(match reason {
                ReasonKind::Sensor => Reason::Sensor(SensorFault::Nak),
                ReasonKind::StaleData => Reason::StaleData,
                ReasonKind::InvalidAttitude => Reason::InvalidAttitude,
                ReasonKind::Tilt => Reason::Tilt,
                ReasonKind::HostSilent => Reason::HostSilent,
            }),
            StateCode::Boot | StateCode::SelfTest(_) | StateCode::Latched(_) => return None,
        })
    }

    /// Whether this is where [`Flight::tell`](crate::Flight::tell) is all that there is: from
    /// standby on, with nothing to acknowledge.
    pub fn is_past_start_up(&self) -> bool {
        matches!(self, State::Standby | State::Armed | State::Active { .. } | State::Failsafe(_))
    }

    /// Whether the controller moves the rudder.
    pub fn is_active(&self) -> bool {
        matches!(self, State::Active { .. })
    }

    /// Whether the drone counts as armed: parameters that would make the rudder jump are refused.
    pub fn is_armed(&self) -> bool {
        matches!(self, State::Armed | State::Active { .. })
    }

    /// Whether nobody needs the rudder: before arming, and with nothing to acknowledge.
    pub fn is_idle(&self) -> bool {
        matches!(self, State::Boot | State::SelfTest(_) | State::Standby)
    }

    /// The state and the kind of its reason, without details.
    pub fn summary(&self) -> StateCode {
        match self {
            State::Boot => StateCode::Boot,
            State::SelfTest(test) => StateCode::SelfTest(test.failure),
            State::Standby => StateCode::Standby,
            State::Armed => StateCode::Armed,
            State::Active { .. } => StateCode::Active,
            State::Failsafe(reason) => StateCode::Failsafe(reason.kind()),
            State::Latched(latch) => StateCode::Latched(latch.kind()),
        }
    }

    /// The state alone.
    pub fn kind(&self) -> StateKind {
        self.summary().kind()
    }

    /// [`State::summary`] as one number, as HEARTBEAT's `custom_mode` carries it.
    pub fn code(&self) -> u32 {
        self.summary().number()
    }
}

/// The words of the [`StateCode`], with the details of the reason.
impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            State::Failsafe(reason) => write!(f, "{}: {reason}", StateKind::Failsafe),
            State::Latched(latch) => write!(f, "{}: {latch}", StateKind::Latched),
            _ => self.summary().fmt(f),
        }
    }
}

/// What the operator must acknowledge at start-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Latch {
    /// The last run ended badly.
    Crash(Crash),
    /// The stored parameters cannot be read: they have their defaults.
    ParametersLost,
}

impl Latch {
    /// What is to be acknowledged, without its details.
    pub fn kind(&self) -> LatchKind {
        match self {
            Latch::Crash(crash) => crash.kind(),
            Latch::ParametersLost => LatchKind::ParametersLost,
        }
    }
}

impl fmt::Display for Latch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Latch::Crash(crash) => crash.fmt(f),
            Latch::ParametersLost => self.kind().fmt(f),
        }
    }
}

/// How the last run ended, where it ended badly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crash {
    /// The watchdog fired: the loop hung.
    Watchdog,
    /// The supply dipped.
    BrownOut,
    /// The firmware found this wrong with itself.
    SelfCheck(SelfCheck),
    /// The processor met an instruction or access it cannot do.
    HardFault {
        /// Address of the instruction.
        pc: u32,
    },
}

impl Crash {
    /// How it ended, without addresses.
    pub fn kind(&self) -> LatchKind {
        match self {
            Crash::Watchdog => LatchKind::Watchdog,
            Crash::BrownOut => LatchKind::BrownOut,
            Crash::SelfCheck(_) => LatchKind::SelfCheck,
            Crash::HardFault { .. } => LatchKind::HardFault,
        }
    }
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind().fmt(f)?;
        match self {
            Crash::Watchdog | Crash::BrownOut => Ok(()),
            Crash::SelfCheck(check) => write!(f, ": {check}"),
            Crash::HardFault { pc } => write!(f, " at {}", Hex(*pc)),
        }
    }
}

/// What the board found at start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BootReport {
    /// Why the last run ended, if it ended badly: the crash record where there is one, else the
    /// reset cause.
    pub crash: Option<Crash>,
    /// What was found of stored parameters.
    pub stored: Loaded,
}

impl BootReport {
    /// What is to be acknowledged first.
    pub(super) fn latch(&self) -> Option<Latch> {
        match self.crash {
            Some(crash) => Some(Latch::Crash(crash)),
            None => (self.stored == Loaded::Corrupt).then_some(Latch::ParametersLost),
        }
    }

    /// What is left when that is acknowledged.
    pub(super) fn acknowledge(&mut self, latch: Latch) {
        match latch {
            Latch::Crash(_) => self.crash = None,
            Latch::ParametersLost => self.stored = Loaded::Nothing,
        }
    }

    /// The state to be in.
    pub(super) fn state(&self) -> State {
        self.latch().map_or(State::Boot, State::Latched)
    }
}
