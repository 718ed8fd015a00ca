//! From power-on to the first good data, step by step, with every register read back.

mod judges;

use crate::config::{Config, ResetPolicy};
use crate::registers as reg;
use crate::request::{Answer, Request};
use crate::sample;
use crate::settings::Setting;
use crate::status::Identity;
use judges::{
    answer, await_clock, await_mode, await_running, await_self_test, confirm, diagnose, identify,
};
use tvc_imu::judge::{Inspector, Judged, Rules, Words};
use tvc_imu::{Micros, SensorFault, Transfer, Transferred};

/// Longest time for a chip to answer and identify itself before the driver reports a fault. 850 ms
/// are common, and the identification can be wrong for another second.
pub const BOOT_DEADLINE_US: u64 = 1_850_000;

/// Pause between attempts to reach a chip that does not answer.
const POLL_US: u64 = 20_000;
/// Pause after the first failure of a chip that answered; it doubles up to [`PAUSE_MAX_US`].
const PAUSE_US: u64 = 50_000;
const PAUSE_MAX_US: u64 = 800_000;
/// Any mode to CONFIG (data sheet table 3-6).
const TO_CONFIG_US: u64 = 19_000;
/// CONFIG to any mode (data sheet table 3-6).
const FROM_CONFIG_US: u64 = 7_000;
/// Pause between a write and its read-back. The data sheet asks for 2 us, but users report lost
/// writes within a few milliseconds.
const WRITE_US: u64 = 5_000;
/// After a reset command (data sheet table 1-2).
const RESET_US: u64 = 650_000;
/// The built-in self-test takes about 0.4 s (data sheet section 3.9.2).
const SELF_TEST_US: u64 = 400_000;
/// For this time after a change of clock, the clock status is the old clock's.
const CLOCK_SWITCH_US: u64 = 10_000;

/// PWR_MODE: everything off but the registers (data sheet section 3.2.3).
const SUSPEND: u8 = 2;

/// A step of the set-up. [`Startup::transfer`] has its transfer, [`Startup::judge`] its
/// consequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum SetupStep {
    /// Selects page 0, which shows whether the chip answers.
    #[default]
    Call,
    Identify,
    /// Only under [`ResetPolicy::AfterFailures`].
    Reset,
    EnterConfig,
    AwaitConfig,
    /// A request that the chip answers in CONFIG mode only.
    Ask(Request),
    AwaitSelfTest(Request),
    /// Self-test result, system status and error.
    Diagnose,
    Write(Setting),
    Confirm(Setting),
    AwaitClock,
    SelectClock,
    ConfirmClock,
    EnterMode,
    AwaitMode,
    AwaitRunning,
    /// Bursts, until the data are live.
    AwaitData,
    Suspend,
}

/// Goal of the set-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Goal {
    #[default]
    Sampling,
    Suspended,
}

/// Where a step leads.
enum Verdict {
    /// To the next step, after a pause in microseconds.
    Go(SetupStep, u64),
    /// Once more after a pause in microseconds, for a limited time; then this fault.
    Again(u64, u64, SensorFault),
    Fail(SensorFault),
    /// To the next step, with an answer.
    Answer(Answer, SetupStep),
    Reached,
}

/// The result of a completed step for the driver.
pub(crate) enum Progress {
    Going,
    /// The request has its answer; the set-up goes on.
    Answered(Answer),
    /// An attempt failed with a fault to report.
    Failed(SensorFault),
    /// The chip samples, or is suspended: the goal is reached.
    Reached(Goal),
}

/// A set-up under way.
#[derive(Clone, Debug, Default)]
pub(crate) struct Startup {
    goal: Goal,
    /// The request to make on the way. `None` discards an answer still to come.
    pub(crate) request: Option<Request>,
    step: SetupStep,
    step_since: Micros,
    not_before: Micros,
    /// Start of this set-up, known after the first look at the clock.
    began: Option<Micros>,
    /// Failed attempts in a row of a chip that answered.
    failures: u8,
    outstanding: bool,
    /// Fresh, good bursts so far while waiting for data.
    live: u8,
    /// The judge that has seen the first bursts.
    pub(crate) inspector: Inspector,
    pub(crate) identity: Identity,
}

impl Startup {
    /// A set-up that begins at the first look at the clock.
    pub(crate) fn new(goal: Goal, request: Option<Request>) -> Self {
        Self { goal, request, ..Self::default() }
    }

    /// It begins now.
    pub(crate) fn begin(&mut self, now: Micros) {
        (self.step_since, self.not_before, self.began) = (now, now, Some(now));
    }

    /// Start of this set-up.
    pub(crate) fn began(&self) -> Micros {
        self.began.unwrap_or(self.not_before)
    }

    /// The next transfer, or the time of the next one.
    pub(crate) fn next(&mut self, now: Micros, config: &Config) -> Result<Transfer, Micros> {
        self.began.get_or_insert(now);
        if now < self.not_before {
            return Err(self.not_before);
        }
        self.outstanding = true;
        Ok(self.transfer(config))
    }

    /// The transfer of a step.
    fn transfer(&self, config: &Config) -> Transfer {
        use SetupStep as Step;
        let read = Transfer::read;
        let write = |register, value| Transfer::write(register, [value]);
        match self.step {
            Step::Call => write(reg::PAGE_ID, 0),
            Step::Identify => read(reg::CHIP_ID, 8),
            Step::Reset => write(reg::SYS_TRIGGER, reg::RST_SYS),
            Step::EnterConfig => write(reg::OPR_MODE, 0),
            Step::AwaitConfig | Step::AwaitMode => read(reg::OPR_MODE, 1),
            Step::Ask(request) if request.is_self_test() => {
                // The clock stays.
                let clock = reg::CLK_SEL * u8::from(config.external_crystal);
                write(reg::SYS_TRIGGER, reg::SELF_TEST | clock)
            }
            Step::Ask(request) | Step::AwaitSelfTest(request) => request.read(),
            Step::Diagnose => read(reg::ST_RESULT, 5),
            Step::Write(setting) => setting.write(config),
            Step::Confirm(setting) => setting.read(config),
            Step::AwaitClock | Step::ConfirmClock => read(reg::SYS_CLK_STATUS, 1),
            Step::SelectClock => write(reg::SYS_TRIGGER, reg::CLK_SEL),
            Step::EnterMode => write(reg::OPR_MODE, config.mode as u8),
            Step::AwaitRunning => read(reg::SYS_STATUS, 2),
            Step::AwaitData => sample::burst(config.mode),
            Step::Suspend => write(reg::PWR_MODE, SUSPEND),
        }
    }

    /// The consequence of a step and of the chip's answer.
    fn judge(&mut self, now: Micros, bytes: &[u8], config: &Config, rules: &Rules) -> Verdict {
        use SetupStep as Step;
        match self.step {
            Step::Call => Verdict::Go(Step::Identify, 0),
            Step::Identify => identify(bytes, config, &mut self.identity),
            Step::Reset => Verdict::Go(Step::Call, RESET_US),
            Step::EnterConfig => Verdict::Go(Step::AwaitConfig, TO_CONFIG_US),
            Step::AwaitConfig => {
                await_mode(bytes, 0, self.request.map_or(self.purpose(), Step::Ask))
            }
            Step::Ask(request) if request.is_self_test() => {
                Verdict::Go(Step::AwaitSelfTest(request), SELF_TEST_US)
            }
            Step::Ask(request) => answer(request, bytes, self.purpose()),
            Step::AwaitSelfTest(request) => await_self_test(request, bytes, self.purpose()),
            Step::Diagnose => diagnose(bytes, config),
            Step::Write(setting) => Verdict::Go(Step::Confirm(setting), WRITE_US),
            Step::Confirm(setting) => confirm(setting, bytes, config, &mut self.identity),
            Step::AwaitClock => await_clock(bytes, Step::SelectClock, 500_000),
            Step::SelectClock => Verdict::Go(Step::ConfirmClock, CLOCK_SWITCH_US),
            Step::ConfirmClock => await_clock(bytes, Step::EnterMode, 1_200_000),
            Step::EnterMode => Verdict::Go(Step::AwaitMode, FROM_CONFIG_US),
            Step::AwaitMode => await_mode(bytes, config.mode as u8, Step::AwaitRunning),
            Step::AwaitRunning => {
                self.inspector = self.inspector.anew();
                self.live = 0;
                await_running(bytes, config)
            }
            Step::AwaitData => match self.look(now, bytes, config, rules) {
                // The second fresh burst shows that the data move.
                Ok(judged) if judged.fresh && self.live >= 1 => Verdict::Reached,
                Ok(judged) => {
                    self.live += u8::from(judged.fresh);
                    Verdict::Again(10_000, 1_000_000, SensorFault::Frozen)
                }
                Err(fault) => Verdict::Again(10_000, 1_000_000, fault),
            },
            Step::Suspend => Verdict::Reached,
        }
    }

    /// Judges a burst before the first sample.
    fn look(
        &mut self,
        now: Micros,
        bytes: &[u8],
        config: &Config,
        rules: &Rules,
    ) -> Result<Judged, SensorFault> {
        let mut words = Words::default();
        let is_whole = sample::read(&mut words, config, &self.inspector, bytes)?;
        self.inspector.judge(rules, now, &words, is_whole, false)
    }

    /// Takes the outcome of the transfer from [`Startup::next`]; ignores any other.
    pub(crate) fn complete(
        &mut self,
        now: Micros,
        outcome: Transferred<'_>,
        config: &Config,
        rules: &Rules,
    ) -> Progress {
        if !core::mem::take(&mut self.outstanding) {
            return Progress::Going;
        }
        let verdict = match outcome {
            Err(error) => Verdict::Fail(error.into()),
            Ok(bytes) if bytes.len() != self.transfer(config).answer_len() => {
                Verdict::Fail(SensorFault::Protocol)
            }
            Ok(bytes) => self.judge(now, bytes, config, rules),
        };
        match verdict {
            Verdict::Reached => return Progress::Reached(self.goal),
            Verdict::Go(step, pause_us) => {
                self.step = step;
                self.step_since = now;
                self.not_before = now.after(pause_us);
            }
            Verdict::Answer(answer, step) => {
                self.step = step;
                self.step_since = now;
                // The owner may have dropped the request meanwhile.
                if self.request.take().is_some() {
                    return Progress::Answered(answer);
                }
            }
            Verdict::Again(pause_us, timeout_us, fault) => {
                if now.since(self.step_since) >= timeout_us {
                    return self.fail(now, fault, config);
                }
                self.not_before = now.after(pause_us);
            }
            Verdict::Fail(fault) => return self.fail(now, fault, config),
        }
        Progress::Going
    }

    /// Starts over. The driver polls a chip that does not answer at a steady pace, and reports it
    /// only when it is late. A wrong answer is reported at once, and the next attempt comes after
    /// ever longer pauses.
    fn fail(&mut self, now: Micros, fault: SensorFault, config: &Config) -> Progress {
        let unreached = fault.is_bus() || self.step == SetupStep::Identify;
        let mut next = SetupStep::Call;
        let pause_us = if unreached {
            POLL_US
        } else {
            let pause_us = PAUSE_MAX_US.min(PAUSE_US << self.failures.min(8));
            self.failures = self.failures.saturating_add(1);
            if let ResetPolicy::AfterFailures(limit) = config.reset
                && self.failures >= limit.get()
            {
                self.failures = 0;
                next = SetupStep::Reset;
            }
            pause_us
        };
        self.step = next;
        self.step_since = now;
        self.not_before = now.after(pause_us);
        self.live = 0;
        if unreached && now.since(self.began()) < BOOT_DEADLINE_US {
            Progress::Going
        } else {
            Progress::Failed(fault)
        }
    }

    /// The step after CONFIG mode is reached and the request answered.
    fn purpose(&self) -> SetupStep {
        match self.goal {
            Goal::Sampling => SetupStep::Diagnose,
            Goal::Suspended => SetupStep::Suspend,
        }
    }
}
