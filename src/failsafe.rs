//! Who may move the rudder: the states of the flight, and what leads from one to another.
//!
//! The firmware cannot cut the motors, so the safe output is the neutral pulse. Every state but
//! [`State::Active`] commands it, except while the operator sets up an [idle](State::is_idle)
//! servo.

mod code;
mod command;
mod reason;
mod state;

use tvc_fusion::BiasState;
use tvc_imu::{Micros, RawSample, SensorFault};

use crate::config::{
    COS_ARM_TILT_Q30, COS_FAILSAFE_TILT_Q30, DATA_AGE_LIMIT_US, FAILSAFE_TILT_US, HOST_SILENCE_US,
    RECOVERY_SAMPLES, SAMPLE_MAKES_UP_US,
};
use crate::self_test::{SelfTest, Verdict};
use crate::store::Loaded;
use crate::words::Words;

pub use crate::numbered::UnknownCode;
pub use code::{LatchKind, SelfCheck, StateCode, StateKind};
pub use command::{Command, Refusal, RefusalKind};
pub use reason::{Reason, ReasonKind};
pub use state::{BootReport, Crash, Latch, State};

/// Steps over which the share of lost samples is taken.
const LOST_STEPS: u32 = 1_024;
/// All samples, Q24.
const ALL_LOST: u32 = 1 << 24;
/// A share of lost samples that is worth telling: the steps that a new estimate of the attitude
/// takes are fewer.
const MANY_LOST: u32 = ALL_LOST / 100;

/// What the supervisor needs to know of the attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Health {
    /// It is a rotation.
    pub valid: bool,
    /// It has settled since start-up.
    pub settled: bool,
    /// What is known of the gyro's offset.
    pub bias: BiasState,
    /// The tilt is known to [`ARM_TILT_SD_DEG`](crate::config::ARM_TILT_SD_DEG).
    pub certain: bool,
    /// Cosine of the angle between the body's and the earth's vertical, Q30.
    pub cos_tilt_q30: i32,
}

impl Health {
    /// Nothing seen yet.
    const UNKNOWN: Self = Self {
        valid: true,
        settled: false,
        bias: BiasState::Unknown,
        certain: false,
        cos_tilt_q30: 1 << 30,
    };
}

/// Keeps the state, and changes it with samples, faults, time and commands.
#[derive(Clone, Debug)]
pub struct Supervisor {
    state: State,
    /// What of the start-up's report has not been acknowledged.
    report: BootReport,
    health: Health,
    /// The time that the data are of: that of the newest good sample, or one before it where few
    /// samples were good.
    fresh: Option<Micros>,
    /// Good samples in a row, up to [`RECOVERY_SAMPLES`].
    good_run: u8,
    /// The fault of the newest step without a sample.
    fault: Option<SensorFault>,
    missed: u32,
    /// Share of the steps without a usable sample over some ten seconds, Q24.
    lost: u32,
    /// Time of the newest of them.
    lost_at: Micros,
    host_seen: Option<Micros>,
    host_required: bool,
}

impl Supervisor {
    /// Start in [`State::Boot`], or in [`State::Latched`] where the board reports what must be
    /// acknowledged.
    pub fn new(report: BootReport) -> Self {
        Self {
            state: report.state(),
            report,
            health: Health::UNKNOWN,
            fresh: None,
            good_run: 0,
            fault: None,
            missed: 0,
            lost: 0,
            lost_at: Micros(0),
            host_seen: None,
            host_required: false,
        }
    }

    /// Words that are [told](Self::tell).
    pub(crate) const WORDS: usize = 2 + Option::<Micros>::WORDS;

    /// Shows the words of what no later step tells.
    pub(crate) fn tell(&self, each: &mut dyn FnMut(i32)) {
        (self.state.code() as i32).tell(each);
        self.good_run.tell(each);
        match self.state {
            State::Active { over_tilt_since } => over_tilt_since,
            _ => None,
        }
        .tell(each);
    }

    /// Goes on from the words that another one [told](Self::tell) behind a step with a sample of
    /// this time and an attitude of this health.
    pub(crate) fn resume(&mut self, at: Micros, health: Health, next: &mut dyn FnMut() -> i32) {
        let code = next() as u32;
        self.good_run = u8::told(next).min(RECOVERY_SAMPLES);
        let since = Words::told(next);
        let told = StateCode::try_from(code).ok().and_then(State::resumed);
        self.state = match told.unwrap_or(self.state) {
            State::Active { .. } => State::Active { over_tilt_since: since },
            state => state,
        };
        (self.fresh, self.fault, self.health) = (Some(at), None, health);
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

    /// A sample is part of the self-test, and [`Supervisor::test`] wants it.
    pub fn is_testing(&self) -> bool {
        matches!(self.state, State::Boot | State::SelfTest(_))
    }

    /// A sample of the self-test, calibrated.
    pub fn test(&mut self, raw: &RawSample) {
        let next = match &mut self.state {
            State::Boot => State::SelfTest(SelfTest::new(raw, None)),
            State::SelfTest(test) => match test.observe(raw) {
                Verdict::Running => return,
                Verdict::Failed(failure) => State::SelfTest(SelfTest::new(raw, Some(failure))),
                Verdict::Passed => State::Standby,
            },
            _ => return,
        };
        self.state = next;
    }

    /// The processor stood still for its flash, which may have cost samples.
    pub fn halted(&mut self) {
        if let State::SelfTest(test) = &mut self.state {
            test.halted();
        }
    }

    /// A step with a sample of this time, and the attitude after it.
    pub fn sample(&mut self, now: Micros, time: Micros, health: Health) {
        self.health = health;
        let age_us = now.0.abs_diff(time.0).max(self.debt_us(now));
        self.fresh = Some(Micros(now.0.saturating_sub(age_us)));
        self.good_run = (self.good_run + 1).min(RECOVERY_SAMPLES);
        self.lost -= self.lost / LOST_STEPS;
        self.fault = None;
        if !health.valid {
            self.fail(Reason::InvalidAttitude);
        }
        self.watch(now);
    }

    /// A step without a usable sample.
    pub fn miss(&mut self, now: Micros, fault: SensorFault) {
        self.missed = self.missed.wrapping_add(1);
        if fault != SensorFault::Booting {
            self.lost += (ALL_LOST - self.lost) / LOST_STEPS;
            self.lost_at = now;
        }
        self.good_run = 0;
        self.fault = Some(fault);
        if fault.ends_trust() {
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

    /// The estimate starts over: nothing is armed, and no failsafe of the sensor acknowledged,
    /// until it has settled and the gyro's offset is known. Only the tilt stays as it was last
    /// seen.
    pub fn attitude_lost(&mut self) {
        self.health = Health { cos_tilt_q30: self.health.cos_tilt_q30, ..Health::UNKNOWN };
    }

    /// Obey the operator, or say why not.
    ///
    /// # Errors
    /// The [`Refusal`]; the state stays.
    pub fn command(&mut self, now: Micros, command: Command) -> Result<(), Refusal> {
        let next = self.next(now, command)?;
        if let (Command::Disarm, State::Latched(latch)) = (command, self.state) {
            self.report.acknowledge(latch);
        }
        self.state = next;
        Ok(())
    }

    /// Whether a command would be obeyed.
    ///
    /// # Errors
    /// The [`Refusal`].
    pub fn may(&self, now: Micros, command: Command) -> Result<(), Refusal> {
        self.next(now, command).map(drop)
    }

    /// The self-test is passed, the attitude has settled, and the gyro's offset is known.
    pub fn is_calibrated(&self) -> bool {
        self.state == State::Standby && self.health.settled && self.health.bias == BiasState::Known
    }

    /// The state that a command leads to.
    fn next(&self, now: Micros, command: Command) -> Result<State, Refusal> {
        Ok(match (command, self.state) {
            (Command::Arm, State::Standby) => {
                self.ready(now)?;
                // In free flight, where nothing but the rates turns the attitude, it is certain no
                // longer, and a release is not to fail for that.
                if !self.health.certain {
                    return Err(Refusal::Uncertain);
                }
                State::Armed
            }
            (Command::Release, State::Armed) => {
                self.ready(now)?;
                State::Active { over_tilt_since: None }
            }
            (Command::Disarm, State::Armed | State::Active { .. }) => State::Standby,
            (Command::Disarm, State::Failsafe(reason)) => {
                if self.persists(now, reason) {
                    return Err(Refusal::FaultPersists(reason));
                }
                State::Standby
            }
            (Command::Disarm, State::Latched(latch)) => {
                let mut report = self.report;
                report.acknowledge(latch);
                report.state()
            }
            (Command::TestPulse(..), state) if state.is_idle() => state,
            (Command::Arm, State::Armed)
            | (Command::Release, State::Active { .. })
            | (Command::Disarm, State::Boot | State::SelfTest(_) | State::Standby) => self.state,
            (_, state) => return Err(Refusal::WrongState(state)),
        })
    }

    /// The conditions of arming and release.
    fn ready(&self, now: Micros) -> Result<(), Refusal> {
        let is_unknown = !self.health.settled || self.health.bias == BiasState::Unknown;
        if !self.sensor_is_healthy() {
            Err(Refusal::Sensor)
        } else if is_unknown && self.keeps_losing(now) {
            Err(Refusal::BurstsLost)
        } else if !self.health.valid || !self.health.settled {
            Err(Refusal::Settling)
        } else if self.health.bias == BiasState::Refused {
            Err(Refusal::BiasRefused)
        } else if self.health.bias == BiasState::Unknown {
            Err(Refusal::BiasUnknown)
        } else if self.health.cos_tilt_q30 < COS_ARM_TILT_Q30 {
            Err(Refusal::Tilt)
        } else if self.host_is_silent(now) {
            Err(Refusal::HostSilent)
        } else {
            Ok(())
        }
    }

    /// The age that a good sample leaves at `now`, us. Where few samples are good, the data of an
    /// armed vehicle grow old.
    fn debt_us(&self, now: Micros) -> u64 {
        if !self.state.is_armed() {
            return 0;
        }
        self.age_us(now).min(DATA_AGE_LIMIT_US).saturating_sub(SAMPLE_MAKES_UP_US)
    }

    /// Age of the data, us. A clock that has jumped back would make them young for ever.
    fn age_us(&self, now: Micros) -> u64 {
        self.fresh.map_or(0, |fresh| now.0.abs_diff(fresh.0))
    }

    /// Whether samples get lost again and again, the newest within the last second.
    fn keeps_losing(&self, now: Micros) -> bool {
        self.lost > MANY_LOST && now.since(self.lost_at) < 1_000_000
    }

    /// Whether the cause of a failsafe is still there. No failsafe ends without a healthy sensor.
    fn persists(&self, now: Micros, reason: Reason) -> bool {
        !self.sensor_is_healthy()
            || !self.health.valid
            || match reason {
                Reason::Tilt => self.health.cos_tilt_q30 < COS_FAILSAFE_TILT_Q30,
                Reason::HostSilent => self.host_is_silent(now),
                Reason::Sensor(_) | Reason::StaleData | Reason::InvalidAttitude => {
                    !self.health.settled
                }
            }
    }

    /// Whether the host has been heard in the last three seconds.
    pub fn host_is_heard(&self, now: Micros) -> bool {
        self.host_seen.is_some_and(|seen| now.since(seen) <= HOST_SILENCE_US)
    }

    fn host_is_silent(&self, now: Micros) -> bool {
        self.host_required && !self.host_is_heard(now)
    }

    /// Faults that come with time alone: data too old, a silent host, a tilt for too long.
    fn watch(&mut self, now: Micros) {
        if self.age_us(now) > DATA_AGE_LIMIT_US {
            self.good_run = 0;
            self.lose_sensor(self.fault.map_or(Reason::StaleData, Reason::Sensor));
        }
        if self.state.is_armed() && self.host_is_silent(now) {
            self.fail(Reason::HostSilent);
        }
        if let State::Active { over_tilt_since } = &mut self.state {
            if self.health.cos_tilt_q30 >= COS_FAILSAFE_TILT_Q30 {
                *over_tilt_since = None;
            } else {
                let since = *over_tilt_since.get_or_insert(now);
                if now.0.abs_diff(since.0) >= FAILSAFE_TILT_US {
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
        if matches!(self.state, State::Standby | State::Armed | State::Active { .. }) {
            self.state = State::Failsafe(reason);
        }
    }
}

#[cfg(test)]
mod tests;
