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
use tvc_imu::judge::{Inspector, Rules, Words};
use tvc_imu::pace::{self, Pace, Pauses, Progress};
use tvc_imu::{Micros, SensorFault, Transfer, Transferred};

/// Longest time for a chip to answer and identify itself before the driver reports a fault. 850 ms
/// are common, and the identification can be wrong for another second.
pub const BOOT_DEADLINE_US: u64 = 1_850_000;

/// Pauses between attempts.
const PAUSES: Pauses =
    Pauses { boot_us: BOOT_DEADLINE_US, poll_us: 20_000, first_us: 50_000, longest_us: 800_000 };
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
pub(crate) enum SetupStep {
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
type Verdict = pace::Verdict<SetupStep, Answer>;
/// The verdict on a step, or the fault that ends the attempt.
type Judged = Result<Verdict, SensorFault>;

/// A set-up under way.
#[derive(Clone, Debug, Default)]
pub(crate) struct Startup {
    pub(crate) goal: Goal,
    /// The request to make on the way. `None` discards an answer still to come.
    pub(crate) request: Option<Request>,
    pub(crate) pace: Pace<SetupStep>,
    /// The judge that has seen the first bursts.
    pub(crate) inspector: Inspector,
    pub(crate) identity: Identity,
}

impl Startup {
    /// A set-up that begins at the first look at the clock.
    pub(crate) fn new(goal: Goal, request: Option<Request>) -> Self {
        Self { goal, request, ..Self::default() }
    }

    /// The transfer of a step.
    pub(crate) fn transfer(&self, config: &Config) -> Transfer {
        use SetupStep as Step;
        let read = Transfer::read;
        let write = |register, value| Transfer::write(register, [value]);
        match self.pace.step {
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
    fn judge(&mut self, now: Micros, bytes: &[u8], config: &Config, rules: &Rules) -> Judged {
        use SetupStep as Step;
        Ok(match self.pace.step {
            Step::Call => Verdict::Go(Step::Identify, 0),
            Step::Identify => identify(bytes, config, &mut self.identity)?,
            Step::Reset => Verdict::Go(Step::Call, RESET_US),
            Step::EnterConfig => Verdict::Go(Step::AwaitConfig, TO_CONFIG_US),
            Step::AwaitConfig => {
                await_mode(bytes, 0, self.request.map_or(self.purpose(), Step::Ask))
            }
            Step::Ask(request) if request.is_self_test() => {
                Verdict::Go(Step::AwaitSelfTest(request), SELF_TEST_US)
            }
            Step::Ask(request) => answer(request, bytes, self.purpose())?,
            Step::AwaitSelfTest(request) => await_self_test(request, bytes, self.purpose())?,
            Step::Diagnose => diagnose(bytes, config)?,
            Step::Write(setting) => Verdict::Go(Step::Confirm(setting), WRITE_US),
            Step::Confirm(setting) => confirm(setting, bytes, config, &mut self.identity),
            Step::AwaitClock => await_clock(bytes, Step::SelectClock, 500_000),
            Step::SelectClock => Verdict::Go(Step::ConfirmClock, CLOCK_SWITCH_US),
            Step::ConfirmClock => await_clock(bytes, Step::EnterMode, 1_200_000),
            Step::EnterMode => Verdict::Go(Step::AwaitMode, FROM_CONFIG_US),
            Step::AwaitMode => await_mode(bytes, config.mode as u8, Step::AwaitRunning),
            Step::AwaitRunning => {
                self.inspector = self.inspector.anew();
                await_running(bytes, config)?
            }
            Step::AwaitData => {
                let mut words = Words::default();
                let judged = sample::read(&mut words, config, &self.inspector, bytes)
                    .and_then(|whole| self.inspector.judge(rules, now, &words, whole, false));
                match self.pace.look(judged) {
                    Ok(()) => Verdict::Reached,
                    Err(fault) => Verdict::Again(10_000, 1_000_000, fault),
                }
            }
            Step::Suspend => Verdict::Reached,
        })
    }

    /// Takes the outcome of the transfer from [`Pace::next`]; ignores any other.
    pub(crate) fn complete(
        &mut self,
        now: Micros,
        outcome: Transferred<'_>,
        config: &Config,
        rules: &Rules,
    ) -> Progress<Answer> {
        let Some(answer) = self.pace.answer(outcome, &self.transfer(config)) else {
            return Progress::Going;
        };
        let verdict = answer.and_then(|bytes| self.judge(now, bytes, config, rules));
        let is_unknown = self.pace.step == SetupStep::Identify;
        let progress = self.pace.follow(now, verdict, &PAUSES, is_unknown);
        if let ResetPolicy::AfterFailures(limit) = config.reset
            && self.pace.failures >= limit.get()
        {
            self.pace.failures = 0;
            self.pace.step = SetupStep::Reset;
        }
        progress
    }

    /// The step after CONFIG mode is reached and the request answered.
    fn purpose(&self) -> SetupStep {
        match self.goal {
            Goal::Sampling => SetupStep::Diagnose,
            Goal::Suspended => SetupStep::Suspend,
        }
    }
}
