//! Who may move the rudder: the states of the flight, and what leads from one to another.
//!
//! The firmware cannot cut the motors, so the safe output is the neutral pulse. Every state but [`State::Active`]
//! commands it, unless the operator sets up a servo that is [idle](State::is_idle).

use core::fmt;

use bno055_driver::{Micros, RawSample, SensorFault};

use crate::config::{
    COS_ARM_TILT, COS_FAILSAFE_TILT, DATA_AGE_LIMIT_US, FAILSAFE_TILT_US, HOST_SILENCE_US,
    RECOVERY_SAMPLES,
};
use crate::format::Hex;
use crate::self_test::{Failure, SelfTest, Verdict};
use crate::servo::PulseUs;
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

    /// State (low byte) and reason (second byte) as one number, as HEARTBEAT's `custom_mode` carries it. States count
    /// from 0 in the order of the enum; reason 0 is none.
    pub fn code(&self) -> u32 {
        let (state, reason) = match self {
            State::Boot => (0, 0),
            State::SelfTest(test) => (1, test.failure.map_or(0, |failure| 1 + failure as u32)),
            State::Standby => (2, 0),
            State::Armed => (3, 0),
            State::Active { .. } => (4, 0),
            State::Failsafe(reason) => (5, reason.code()),
            State::Latched(latch) => (6, latch.code()),
        };
        state | reason << 8
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            State::Boot => f.write_str("boot: waiting for the sensor"),
            State::SelfTest(test) => match test.failure {
                None => f.write_str("self-test: hold still"),
                Some(Failure::Moving) => f.write_str("self-test: gyro moves"),
                Some(Failure::Gravity) => f.write_str("self-test: acceleration is not 1 g"),
                Some(Failure::Slow) => f.write_str("self-test: too few samples"),
            },
            State::Standby => f.write_str("standby"),
            State::Armed => f.write_str("armed"),
            State::Active { .. } => f.write_str("active"),
            State::Failsafe(reason) => write!(f, "failsafe: {reason}"),
            State::Latched(latch) => write!(f, "latched fault: {latch}"),
        }
    }
}

/// Why control was given up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// The sensor gave nothing usable for too long, or lost its configuration.
    Sensor(SensorFault),
    /// Steps came without samples being asked for, or samples too old to use.
    StaleData,
    /// The attitude is not a rotation: not a number, or not of unit length.
    InvalidAttitude,
    /// Tilted beyond the limit.
    Tilt,
    /// The host fell silent, where `FS_HOST` asks for it.
    HostSilent,
}

impl Reason {
    fn code(&self) -> u32 {
        match self {
            Reason::Sensor(_) => 1,
            Reason::StaleData => 2,
            Reason::InvalidAttitude => 3,
            Reason::Tilt => 4,
            Reason::HostSilent => 5,
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reason::Sensor(fault) => fault.fmt(f),
            Reason::StaleData => f.write_str("sensor data too old"),
            Reason::InvalidAttitude => f.write_str("attitude invalid"),
            Reason::Tilt => f.write_str("tilt beyond 60 deg"),
            Reason::HostSilent => f.write_str("host silent for 3 s"),
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
    fn code(&self) -> u32 {
        match self {
            Latch::Crash(crash) => crash.code(),
            Latch::ParametersLost => 5,
        }
    }
}

impl fmt::Display for Latch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Latch::Crash(crash) => crash.fmt(f),
            Latch::ParametersLost => f.write_str("stored parameters lost"),
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
    /// The program panicked.
    Panic {
        /// Return addresses, innermost first, the first or two in the core library; `addr2line` makes function, file
        /// and line of them.
        callers: [u32; 3],
    },
    /// The processor met an instruction or access it cannot do.
    HardFault {
        /// Address of the instruction.
        pc: u32,
    },
}

impl Crash {
    fn code(&self) -> u32 {
        match self {
            Crash::Watchdog => 1,
            Crash::BrownOut => 2,
            Crash::Panic { .. } => 3,
            Crash::HardFault { .. } => 4,
        }
    }
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Crash::Watchdog => f.write_str("watchdog reset"),
            Crash::BrownOut => f.write_str("brown-out reset"),
            Crash::Panic { callers: [a, b, c] } => {
                write!(f, "panic {} {} {}", Hex(*a), Hex(*b), Hex(*c))
            }
            Crash::HardFault { pc } => write!(f, "hard fault at {}", Hex(*pc)),
        }
    }
}

/// What the board found at start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BootReport {
    /// Why the last run ended, if it ended badly: the crash record where there is one, else the reset cause.
    pub crash: Option<Crash>,
    /// What was found of stored parameters.
    pub stored: Loaded,
}

impl BootReport {
    /// What is to be acknowledged first.
    fn latch(&self) -> Option<Latch> {
        match self.crash {
            Some(crash) => Some(Latch::Crash(crash)),
            None => (self.stored == Loaded::Corrupt).then_some(Latch::ParametersLost),
        }
    }

    /// What is left when that is acknowledged.
    fn acknowledge(&mut self, latch: Latch) {
        match latch {
            Latch::Crash(_) => self.crash = None,
            Latch::ParametersLost => self.stored = Loaded::Nothing,
        }
    }

    /// The state to be in.
    fn state(&self) -> State {
        self.latch().map_or(State::Boot, State::Latched)
    }
}

/// What an operator may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Standby to armed.
    Arm,
    /// Armed to active: the drone is let go.
    Release,
    /// Back to standby from anywhere; acknowledges a failsafe or latched fault whose cause is gone.
    Disarm,
    /// Hold a pulse for the servo's set-up, for a while, where nobody needs the rudder.
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
    /// Tilted more than 50 deg.
    Tilt,
    /// The sensor is not delivering.
    Sensor,
    /// The attitude has not settled since start-up or the last gap.
    Settling,
    /// Nobody has seen the rudder answer a tilt the right way, with the servo's direction and the mount as they are.
    Polarity,
    /// The rudder answers the tilt, for somebody who looks at its polarity (`SRV_POLARITY` = 2).
    RudderAnswers,
    /// The gyro's offset has not been learned since then, which takes some seconds of rest.
    BiasUnknown,
    /// The host's heartbeat is missing, and `FS_HOST` asks for it.
    HostSilent,
    /// The fault is still there.
    FaultPersists(Reason),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refusal::WrongState(state) => write!(f, "in {state}"),
            Refusal::Tilt => f.write_str("tilt beyond 50 deg"),
            Refusal::Sensor => f.write_str("sensor not ready"),
            Refusal::Settling => f.write_str("attitude still settling"),
            Refusal::Polarity => f.write_str("run tvc calibrate polarity first"),
            Refusal::RudderAnswers => f.write_str("rudder answers tilt: SRV_POLARITY 2"),
            Refusal::BiasUnknown => f.write_str("gyro offset unknown: hold still"),
            Refusal::HostSilent => f.write_str("no host heartbeat"),
            Refusal::FaultPersists(reason) => reason.fmt(f),
        }
    }
}

/// What the supervisor is told of the attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Health {
    /// It is a rotation.
    pub valid: bool,
    /// It has settled since start-up.
    pub settled: bool,
    /// The gyro's offset has been learned at rest.
    pub bias_known: bool,
    /// Cosine of the angle between the body's and the earth's vertical.
    pub cos_tilt: f32,
}

impl Health {
    /// Nothing seen yet.
    const UNKNOWN: Self = Self {
        valid: true,
        settled: false,
        bias_known: false,
        cos_tilt: 1.0,
    };
}

/// Keeps the state, and changes it by what happens and by what the operator asks.
#[derive(Clone, Debug)]
pub struct Supervisor {
    state: State,
    /// What of the start-up's report has not been acknowledged.
    report: BootReport,
    health: Health,
    /// Time of the newest good sample.
    fresh: Option<Micros>,
    /// Good samples in a row, up to [`RECOVERY_SAMPLES`].
    good_run: u8,
    /// The fault of the newest step without a sample.
    fault: Option<SensorFault>,
    missed: u32,
    host_seen: Option<Micros>,
    host_required: bool,
}

impl Supervisor {
    /// Start in [`State::Boot`], or in [`State::Latched`] where the board reports what must be acknowledged.
    pub fn new(report: BootReport) -> Self {
        Self {
            state: report.state(),
            report,
            health: Health::UNKNOWN,
            fresh: None,
            good_run: 0,
            fault: None,
            missed: 0,
            host_seen: None,
            host_required: false,
        }
    }

    /// Whether silence of the host is a failsafe.
    pub fn require_host(&mut self, required: bool) {
        self.host_required = required;
    }

    /// The host has been heard.
    pub fn host_heard(&mut self, now: Micros) {
        self.host_seen = Some(now);
    }

    /// Where the flight stands.
    pub fn state(&self) -> State {
        self.state
    }

    /// What was found of stored parameters at start-up.
    pub fn stored(&self) -> Loaded {
        self.report.stored
    }

    /// Steps without a usable sample since start-up.
    pub fn missed(&self) -> u32 {
        self.missed
    }

    /// Why the newest step had no usable sample, if it had none: control holds its last command.
    pub fn fault(&self) -> Option<SensorFault> {
        self.fault
    }

    /// Whether the sensor has been delivering without a break lately.
    pub fn sensor_is_healthy(&self) -> bool {
        self.good_run == RECOVERY_SAMPLES
    }

    /// A step with a sample, calibrated, and the attitude after it.
    pub fn sample(&mut self, now: Micros, raw: &RawSample, health: Health) {
        self.health = health;
        self.fresh = Some(raw.time);
        self.good_run = (self.good_run + 1).min(RECOVERY_SAMPLES);
        self.fault = None;
        self.state = match self.state {
            State::Boot => State::SelfTest(SelfTest::new(raw, None)),
            State::SelfTest(mut test) => match test.observe(raw) {
                Verdict::Running => State::SelfTest(test),
                Verdict::Failed(failure) => State::SelfTest(SelfTest::new(raw, Some(failure))),
                Verdict::Passed => State::Standby,
            },
            other => other,
        };
        if !health.valid {
            self.fail(Reason::InvalidAttitude);
        }
        self.watch(now);
    }

    /// A step without a usable sample.
    pub fn miss(&mut self, now: Micros, fault: SensorFault) {
        self.missed = self.missed.wrapping_add(1);
        self.good_run = 0;
        self.fault = Some(fault);
        if ends_trust(fault) {
            self.lose_sensor(Reason::Sensor(fault));
        }
        self.watch(now);
    }

    /// Back to the self-test, for an attitude that begins anew.
    ///
    /// # Errors
    /// The [`Refusal`] unless the state is [`State::Standby`] or before; the state stays.
    pub fn restart(&mut self) -> Result<(), Refusal> {
        match self.state {
            State::Boot | State::SelfTest(_) | State::Standby => {
                self.state = State::Boot;
                self.attitude_lost();
                Ok(())
            }
            state => Err(Refusal::WrongState(state)),
        }
    }

    /// The estimate starts over: nothing is armed, and no failsafe of the sensor acknowledged, until it has settled and
    /// the gyro's offset is known. Only the tilt stays as it was last seen.
    pub fn attitude_lost(&mut self) {
        self.health = Health {
            cos_tilt: self.health.cos_tilt,
            ..Health::UNKNOWN
        };
    }

    /// Obey the operator, or say why not.
    ///
    /// # Errors
    /// The [`Refusal`]; the state stays.
    pub fn command(&mut self, now: Micros, command: Command) -> Result<(), Refusal> {
        self.state = match (command, self.state) {
            (Command::Arm, State::Standby) => {
                self.ready(now)?;
                State::Armed
            }
            (Command::Release, State::Armed) => {
                self.ready(now)?;
                State::Active {
                    over_tilt_since: None,
                }
            }
            (Command::Disarm, State::Armed | State::Active { .. }) => State::Standby,
            (Command::Disarm, State::Failsafe(reason)) => {
                if self.persists(now, reason) {
                    return Err(Refusal::FaultPersists(reason));
                }
                State::Standby
            }
            (Command::Disarm, State::Latched(latch)) => {
                self.report.acknowledge(latch);
                self.report.state()
            }
            (Command::TestPulse(_), state) if state.is_idle() => state,
            (Command::Arm, State::Armed)
            | (Command::Release, State::Active { .. })
            | (Command::Disarm, State::Boot | State::SelfTest(_) | State::Standby) => self.state,
            (_, state) => return Err(Refusal::WrongState(state)),
        };
        Ok(())
    }

    /// What arming and release ask for.
    fn ready(&self, now: Micros) -> Result<(), Refusal> {
        if !self.sensor_is_healthy() {
            Err(Refusal::Sensor)
        } else if !self.health.valid || !self.health.settled {
            Err(Refusal::Settling)
        } else if !self.health.bias_known {
            Err(Refusal::BiasUnknown)
        } else if self.health.cos_tilt < COS_ARM_TILT {
            Err(Refusal::Tilt)
        } else if self.host_is_silent(now) {
            Err(Refusal::HostSilent)
        } else {
            Ok(())
        }
    }

    /// Whether the cause of a failsafe is still there. No failsafe ends without a healthy sensor.
    fn persists(&self, now: Micros, reason: Reason) -> bool {
        !self.sensor_is_healthy()
            || !self.health.valid
            || match reason {
                Reason::Tilt => self.health.cos_tilt < COS_FAILSAFE_TILT,
                Reason::HostSilent => self.host_is_silent(now),
                Reason::Sensor(_) | Reason::StaleData | Reason::InvalidAttitude => {
                    !self.health.settled
                }
            }
    }

    fn host_is_silent(&self, now: Micros) -> bool {
        self.host_required
            && self
                .host_seen
                .is_none_or(|seen| now.0.saturating_sub(seen.0) > HOST_SILENCE_US)
    }

    /// What time alone can bring about.
    fn watch(&mut self, now: Micros) {
        let age_us = self.fresh.map_or(0, |fresh| now.0.saturating_sub(fresh.0));
        if age_us > DATA_AGE_LIMIT_US {
            self.good_run = 0;
            self.lose_sensor(self.fault.map_or(Reason::StaleData, Reason::Sensor));
        }
        if self.state.is_armed() && self.host_is_silent(now) {
            self.fail(Reason::HostSilent);
        }
        if let State::Active { over_tilt_since } = &mut self.state {
            if self.health.cos_tilt >= COS_FAILSAFE_TILT {
                *over_tilt_since = None;
            } else {
                let since = *over_tilt_since.get_or_insert(now);
                if now.0.saturating_sub(since.0) >= FAILSAFE_TILT_US {
                    self.fail(Reason::Tilt);
                }
            }
        }
    }

    /// The sensor is gone: a failsafe in operation, a fresh start before.
    fn lose_sensor(&mut self, reason: Reason) {
        match self.state {
            State::SelfTest(_) => self.state = State::Boot,
            _ => self.fail(reason),
        }
    }

    /// Go to failsafe from where a fault matters. The first reason stays.
    fn fail(&mut self, reason: Reason) {
        if matches!(
            self.state,
            State::Standby | State::Armed | State::Active { .. }
        ) {
            self.state = State::Failsafe(reason);
        }
    }
}

/// Faults that do not wait for the data to age: the samples before them were wrong already.
fn ends_trust(fault: SensorFault) -> bool {
    matches!(
        fault,
        SensorFault::Reset
            | SensorFault::Configuration { .. }
            | SensorFault::Frozen
            | SensorFault::Unreliable
    )
}
