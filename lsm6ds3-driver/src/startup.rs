//! From power-on to the first good data, step by step, with every register read back.

use tvc_imu::judge::{Inspector, Rules, Words};
use tvc_imu::pace::{self, Pace, Pauses, Progress};
use tvc_imu::{Micros, SensorFault, Transfer, Transferred};

use crate::chip::Chip;
use crate::config::Config;
use crate::registers as reg;
use crate::sample;
use crate::self_test::{self, Half, SelfTest, Sums};

/// Longest time for a chip to answer and identify itself before the driver reports a fault, us. A
/// chip boots in 15 ms (data sheet section 5.6).
pub const BOOT_DEADLINE_US: u64 = 100_000;

/// Pauses between attempts.
const PAUSES: Pauses =
    Pauses { boot_us: BOOT_DEADLINE_US, poll_us: 5_000, first_us: 20_000, longest_us: 640_000 };
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
pub(crate) enum Step {
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
type Verdict = pace::Verdict<Step, SelfTest>;
/// The verdict on a step, or the fault that ends the attempt.
type Judged = Result<Verdict, SensorFault>;

/// A set-up under way.
#[derive(Clone, Debug, Default)]
pub(crate) struct Startup {
    /// The self-test that is to be made on the way.
    test: Option<Half>,
    pub(crate) pace: Pace<Step>,
    /// Bursts so far of a half of the self-test.
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
        Self { pace: Pace::at(now), ..Self::default() }
    }

    /// The transfer of a step.
    pub(crate) fn transfer(&self, config: &Config) -> Transfer {
        // A chip is identified before its control registers are written.
        let chip = self.chip.unwrap_or(Chip::Lsm6ds3);
        match self.pace.step {
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
    fn judge(&mut self, now: Micros, bytes: &[u8], config: &Config, rules: &Rules) -> Judged {
        Ok(match (self.pace.step, bytes) {
            (Step::Call, _) => Verdict::Go(Step::Identify, 0),
            (Step::Identify, &[0xFF]) => return Err(SensorFault::AllOnes),
            (Step::Identify, &[id]) => {
                self.chip = Chip::from_id(id);
                self.chip.ok_or(SensorFault::WrongChip { found: id })?;
                Verdict::Go(Step::Reset, 0)
            }
            (Step::Reset, _) => Verdict::Go(Step::AwaitReset, RESET_US),
            (Step::AwaitReset, &[control]) if control & reg::SW_RESET == 0 => {
                self.sums = Sums::default();
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
            (Step::Measure(half), _) => self.measure(now, half, bytes)?,
            (Step::Write, _) => Verdict::Go(Step::Confirm, 0),
            (Step::Confirm, _) => {
                confirm(config, self.chip, bytes)?;
                self.inspector = self.inspector.anew();
                Verdict::Go(Step::AwaitData, TURN_ON_US)
            }
            (Step::AwaitData, _) => {
                let mut words = Words::default();
                let judged = sample::read(&mut words, &self.inspector, bytes)
                    .and_then(|whole| self.inspector.judge(rules, now, &words, whole, false));
                match self.pace.look(judged) {
                    Ok(()) => Verdict::Reached,
                    Err(fault) => Verdict::Again(LOOK_US, LOOKS_US, fault),
                }
            }
            (Step::Identify | Step::AwaitReset, _) => return Err(SensorFault::Protocol),
        })
    }

    /// Takes a burst of the self-test.
    fn measure(&mut self, now: Micros, half: Half, bytes: &[u8]) -> Judged {
        let mut words = Words::default();
        sample::read(&mut words, &self.inspector, bytes)?;
        self.sums.add(half, &words);
        self.bursts += 1;
        if self.bursts < self_test::BURSTS {
            return Ok(Verdict::Go(Step::Measure(half), self_test::BURST_US));
        }
        match self.chip.map(|chip| half.next(&self.sums, chip)) {
            Some(Ok(half)) => Ok(Verdict::Go(Step::Test(half), 0)),
            Some(Err(result)) => {
                // The set-up proper begins, with the time that it may take.
                *self = Self { chip: self.chip, ..Self::at(now) };
                Ok(Verdict::Answer(result, Step::Reset))
            }
            None => Err(SensorFault::Protocol),
        }
    }

    /// Takes the outcome of the transfer from [`Pace::next`]; ignores any other.
    pub(crate) fn complete(
        &mut self,
        now: Micros,
        outcome: Transferred<'_>,
        config: &Config,
        rules: &Rules,
    ) -> Progress<SelfTest> {
        let Some(answer) = self.pace.answer(outcome, &self.transfer(config)) else {
            return Progress::Going;
        };
        let verdict = answer.and_then(|bytes| self.judge(now, bytes, config, rules));
        let is_unknown = self.pace.step == Step::Identify;
        self.pace.follow(now, verdict, &PAUSES, is_unknown)
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
