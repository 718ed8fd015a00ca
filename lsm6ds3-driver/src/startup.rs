//! From power-on to the first good data, step by step, with every register read back.

use tvc_imu::judge::{Inspector, Rules, Words};
use tvc_imu::{Micros, SensorFault, Transfer, Transferred};

use crate::chip::Chip;
use crate::config::Config;
use crate::registers as reg;
use crate::sample;
use crate::self_test::{self, Half, SelfTest, Sums};

/// Longest time for a chip to answer and identify itself before the driver reports a fault, us. A
/// chip boots in 15 ms (data sheet section 5.6).
pub const BOOT_DEADLINE_US: u64 = 100_000;

/// Pause between attempts to reach a chip that does not answer.
const POLL_US: u64 = 5_000;
/// Pause after the first failure of a chip that answered; it doubles up to [`PAUSE_MAX_US`].
const PAUSE_US: u64 = 20_000;
const PAUSE_MAX_US: u64 = 640_000;
/// A software reset takes 50 us (data sheet section 9.14).
const RESET_US: u64 = 1_000;
/// Until the gyroscope gives data, from power-down (data sheet table 4: 70 ms).
const TURN_ON_US: u64 = 80_000;
/// Pause between the first bursts, and the longest time until they are good.
const LOOK_US: u64 = 10_000;
const LOOKS_US: u64 = 500_000;

/// A step of the set-up. [`Startup::transfer`] has its transfer, [`Startup::judge`] its
/// consequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Step {
    /// Closes the embedded functions' registers, which shows whether the chip answers.
    #[default]
    Call,
    Identify,
    Reset,
    AwaitReset,
    /// Sets a half of the self-test up.
    Test(Half),
    /// Its bursts.
    Measure(Half),
    Write,
    Confirm,
    /// Bursts, until the data are live.
    AwaitData,
}

/// Where a step leads.
enum Verdict {
    /// To the next step, after a pause in microseconds.
    Go(Step, u64),
    /// Once more after a pause in microseconds, for a limited time; then this fault.
    Again(u64, u64, SensorFault),
    Fail(SensorFault),
    Tested(SelfTest),
    Reached,
}

/// The result of a completed step for the driver.
pub(crate) enum Progress {
    Going,
    /// The self-test is over; the set-up goes on.
    Tested(SelfTest),
    /// An attempt failed with a fault to report.
    Failed(SensorFault),
    /// The chip samples.
    Reached,
}

/// A set-up under way.
#[derive(Clone, Debug, Default)]
pub(crate) struct Startup {
    /// The self-test that is to be made on the way.
    test: Option<Half>,
    step: Step,
    step_since: Micros,
    not_before: Micros,
    /// Start of this set-up, known after the first look at the clock.
    began: Option<Micros>,
    /// Failed attempts in a row of a chip that answered.
    failures: u8,
    outstanding: bool,
    /// Bursts so far of a self-test, or fresh, good ones while waiting for data.
    bursts: u8,
    sums: Sums,
    /// The judge that has seen the first bursts.
    pub(crate) inspector: Inspector,
    pub(crate) chip: Option<Chip>,
}

impl Startup {
    /// A set-up that makes the self-test on its way.
    #[cfg(feature = "self-test")]
    pub(crate) fn testing() -> Self {
        Self { test: Some(Half::FIRST), ..Self::default() }
    }

    /// A set-up that begins now.
    pub(crate) fn at(now: Micros) -> Self {
        Self { step_since: now, not_before: now, began: Some(now), ..Self::default() }
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
        // A chip is identified before its control registers are written.
        let chip = self.chip.unwrap_or(Chip::Lsm6ds3);
        match self.step {
            Step::Call => Transfer::write(reg::FUNC_CFG_ACCESS, [0]),
            Step::Identify => Transfer::read(reg::WHO_AM_I, 1),
            Step::Reset => Transfer::write(reg::CTRL3_C, [reg::IF_INC | reg::SW_RESET]),
            Step::AwaitReset => Transfer::read(reg::CTRL3_C, 1),
            Step::Test(half) => Transfer::write(reg::CTRL1_XL, half.controls(chip)),
            Step::Measure(_) | Step::AwaitData => sample::BURST,
            Step::Write => Transfer::write(reg::CTRL1_XL, config.controls(chip)),
            Step::Confirm => STATUS,
        }
    }

    /// The consequence of a step and of the chip's answer.
    fn judge(&mut self, now: Micros, bytes: &[u8], config: &Config, rules: &Rules) -> Verdict {
        match (self.step, bytes) {
            (Step::Call, _) => Verdict::Go(Step::Identify, 0),
            (Step::Identify, &[0xFF]) => Verdict::Fail(SensorFault::AllOnes),
            (Step::Identify, &[id]) => {
                self.chip = Chip::from_id(id);
                match self.chip {
                    Some(_) => Verdict::Go(Step::Reset, 0),
                    None => Verdict::Fail(SensorFault::WrongChip { found: id }),
                }
            }
            (Step::Reset, _) => Verdict::Go(Step::AwaitReset, RESET_US),
            (Step::AwaitReset, &[control]) if control & reg::SW_RESET == 0 => {
                Verdict::Go(self.test.map_or(Step::Write, Step::Test), 0)
            }
            (Step::AwaitReset, &[found]) => Verdict::Again(
                RESET_US,
                50 * RESET_US,
                SensorFault::Configuration { register: reg::CTRL3_C, found },
            ),
            (Step::Test(half), _) => {
                self.bursts = 0;
                Verdict::Go(Step::Measure(half), half.settle_us())
            }
            (Step::Measure(half), _) => self.measure(half, bytes),
            (Step::Write, _) => Verdict::Go(Step::Confirm, 0),
            (Step::Confirm, _) => match confirm(config, self.chip, bytes) {
                Ok(_) => {
                    self.inspector = self.inspector.anew();
                    self.bursts = 0;
                    Verdict::Go(Step::AwaitData, TURN_ON_US)
                }
                Err(fault) => Verdict::Fail(fault),
            },
            (Step::AwaitData, _) => self.look(now, bytes, rules),
            (Step::Identify | Step::AwaitReset, _) => Verdict::Fail(SensorFault::Protocol),
        }
    }

    /// Takes a burst of the self-test.
    fn measure(&mut self, half: Half, bytes: &[u8]) -> Verdict {
        let mut words = Words::default();
        if let Err(fault) = sample::read(&mut words, &self.inspector, bytes) {
            return Verdict::Fail(fault);
        }
        self.sums.add(half, &words);
        self.bursts += 1;
        if self.bursts < self_test::BURSTS {
            return Verdict::Go(Step::Measure(half), self_test::BURST_US);
        }
        match self.chip.map(|chip| half.next(&self.sums, chip)) {
            Some(Ok(half)) => Verdict::Go(Step::Test(half), 0),
            Some(Err(result)) => Verdict::Tested(result),
            None => Verdict::Fail(SensorFault::Protocol),
        }
    }

    /// Judges a burst before the first sample. The second fresh one shows that the data move.
    fn look(&mut self, now: Micros, bytes: &[u8], rules: &Rules) -> Verdict {
        let mut words = Words::default();
        let judged = sample::read(&mut words, &self.inspector, bytes)
            .and_then(|is_whole| self.inspector.judge(rules, now, &words, is_whole, false));
        match judged {
            Ok(judged) if judged.fresh && self.bursts >= 1 => Verdict::Reached,
            Ok(judged) => {
                self.bursts += u8::from(judged.fresh);
                Verdict::Again(LOOK_US, LOOKS_US, SensorFault::Frozen)
            }
            Err(fault) => Verdict::Again(LOOK_US, LOOKS_US, fault),
        }
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
            Verdict::Reached => return Progress::Reached,
            Verdict::Go(step, pause_us) => self.go(step, now, pause_us),
            Verdict::Tested(result) => {
                // The set-up proper begins, with the time that it may take.
                *self = Self { step: Step::Reset, chip: self.chip, ..Self::at(now) };
                return Progress::Tested(result);
            }
            Verdict::Again(pause_us, timeout_us, fault) => {
                if now.since(self.step_since) >= timeout_us {
                    return self.fail(now, fault);
                }
                self.not_before = now.after(pause_us);
            }
            Verdict::Fail(fault) => return self.fail(now, fault),
        }
        Progress::Going
    }

    fn go(&mut self, step: Step, now: Micros, pause_us: u64) {
        (self.step, self.step_since, self.not_before) = (step, now, now.after(pause_us));
    }

    /// Starts over. The driver polls a chip that does not answer at a steady pace, and reports it
    /// only when it is late. A wrong answer is reported at once, and the next attempt comes after
    /// ever longer pauses.
    fn fail(&mut self, now: Micros, fault: SensorFault) -> Progress {
        let unreached = fault.is_bus() || self.step == Step::Identify;
        let pause_us = if unreached {
            POLL_US
        } else {
            let pause_us = PAUSE_MAX_US.min(PAUSE_US << self.failures.min(8));
            self.failures = self.failures.saturating_add(1);
            pause_us
        };
        self.go(Step::Call, now, pause_us);
        (self.bursts, self.sums) = (0, Sums::default());
        if unreached && now.since(self.began()) < BOOT_DEADLINE_US {
            Progress::Going
        } else {
            Progress::Failed(fault)
        }
    }
}

/// The read of all control registers, and the temperature behind them.
pub(crate) const STATUS: Transfer =
    Transfer::read(reg::CTRL1_XL, reg::OUT_TEMP_L + 2 - reg::CTRL1_XL);

/// The temperature's count, if the control registers hold the settings.
///
/// # Errors
/// The fault. A chip that has its defaults again, without a rate, has reset itself.
pub(crate) fn confirm(
    config: &Config,
    chip: Option<Chip>,
    bytes: &[u8],
) -> Result<i16, SensorFault> {
    let right = chip.map(|chip| config.controls(chip)).ok_or(SensorFault::Protocol)?;
    let (Some(controls), Some(temperature)) = (bytes.get(..right.len()), bytes.last_chunk()) else {
        return Err(SensorFault::Protocol);
    };
    if let [0, 0, ..] = controls {
        return Err(SensorFault::Reset);
    }
    let mut registers = (reg::CTRL1_XL..).zip(controls.iter().zip(right));
    match registers.find(|(_, (found, right))| **found != *right) {
        None => Ok(i16::from_le_bytes(*temperature)),
        Some((register, (found, _))) => Err(SensorFault::Configuration { register, found: *found }),
    }
}
