//! From power-on to the first good data: one step after another, every register read back.

use crate::config::{Config, ResetPolicy};
use crate::fault::SensorFault;
use crate::registers::{self as reg, IDS};
use crate::sample::{self, Inspector};
use crate::status::{Identity, SystemError, SystemStatus};
use crate::transfer::{BusError, Micros, Transfer};

/// How long a chip may take to answer and identify itself before that is reported as a fault: 850 ms are common,
/// and the identification can be wrong for another second.
pub const BOOT_DEADLINE_US: u64 = 1_850_000;

/// Pause between attempts to reach a chip that does not answer.
const POLL_US: u64 = 20_000;
/// Pause after the first failure of a chip that answered; doubles up to [`PAUSE_MAX_US`].
const PAUSE_US: u64 = 50_000;
const PAUSE_MAX_US: u64 = 800_000;
/// Any mode to CONFIG (data sheet table 3-6).
const TO_CONFIG_US: u64 = 19_000;
/// CONFIG to any mode (data sheet table 3-6).
const FROM_CONFIG_US: u64 = 7_000;
/// After a reset command (data sheet table 1-2).
const RESET_US: u64 = 650_000;
/// The clock status must not be read before this after a change of clock, or it is still the old clock's.
const CLOCK_SWITCH_US: u64 = 10_000;

/// PWR_MODE: everything off but the registers (data sheet section 3.2.3).
const SUSPEND: u8 = 2;

/// What the set-up does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Page 0: also asks whether anybody is there.
    Call,
    Identify,
    /// Only under [`ResetPolicy::AfterFailures`].
    Reset,
    EnterConfig,
    AwaitConfig,
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

/// What the set-up is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Goal {
    Sampling,
    Suspended,
}

/// Registers to write and read back, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Setting {
    Power,
    Units,
    Axes,
    SoftIron,
    Profile,
    PageOne,
    Sensors,
    /// Read only.
    UniqueId,
    PageZero,
}

impl Setting {
    /// The setting after this one that `config` asks for.
    fn next(self, config: &Config) -> Option<Self> {
        let next = match self {
            Self::Power => Self::Units,
            Self::Units => Self::Axes,
            Self::Axes => Self::SoftIron,
            Self::SoftIron => Self::Profile,
            Self::Profile => Self::PageOne,
            Self::PageOne => Self::Sensors,
            Self::Sensors => Self::UniqueId,
            Self::UniqueId => Self::PageZero,
            Self::PageZero => return None,
        };
        match next {
            Self::SoftIron if config.soft_iron.is_none() => Self::SoftIron.next(config),
            Self::Profile if config.profile.is_none() => Self::Profile.next(config),
            _ => Some(next),
        }
    }

    /// The transfer that writes it; for what is only read, the one that reads.
    fn write(self, config: &Config) -> Transfer {
        match self {
            Self::Power => Transfer::write(reg::PWR_MODE, [config.power as u8]),
            Self::Units => Transfer::write(reg::UNIT_SEL, [config.units.register()]),
            Self::Axes => Transfer::write(reg::AXIS_MAP_CONFIG, config.axes.registers()),
            Self::SoftIron => Transfer::write(
                reg::SIC_MATRIX,
                config.soft_iron.unwrap_or_default().registers(),
            ),
            Self::Profile => Transfer::write(
                reg::ACC_OFFSET,
                config.profile.unwrap_or_default().registers(),
            ),
            Self::PageOne => Transfer::write(reg::PAGE_ID, [1]),
            Self::Sensors => Transfer::write(reg::ACC_CONFIG, config.sensors.registers()),
            Self::UniqueId => Transfer::read(reg::UNIQUE_ID, 16),
            Self::PageZero => Transfer::write(reg::PAGE_ID, [0]),
        }
    }

    /// Bits of a byte that must read as written; the others are reserved or the chip's own business.
    fn mask(self, config: &Config, offset: usize) -> u8 {
        match (self, offset) {
            (Self::Power, _) => 0x03,
            (Self::Units, _) => 0x97,
            (Self::Axes, 0) => 0x3F,
            (Self::Axes, _) => 0x07,
            // In fusion modes the chip sets all but the accelerometer's range.
            (Self::Sensors, 0) if config.mode.is_fusion() => 0x03,
            (Self::Sensors, _) if config.mode.is_fusion() => 0x00,
            (Self::Sensors, 1) => 0x7F,
            (Self::Sensors, 2) => 0x3F,
            (Self::Sensors, 3) => 0x07,
            _ => 0xFF,
        }
    }
}

/// Where a step leads.
enum Verdict {
    /// To the next step, after so many microseconds.
    Go(Step, u64),
    /// Once more after so many microseconds, until the step's patience (also microseconds) ends with this fault.
    Again {
        pause_us: u64,
        patience_us: u64,
        fault: SensorFault,
    },
    Fail(SensorFault),
    Reached,
}

/// What the driver learns from a completed step.
pub(crate) enum Progress {
    Going,
    /// An attempt failed; the fault is to be reported.
    Failed(SensorFault),
    /// The chip samples, or is suspended, as was the goal.
    Reached(Goal),
}

/// The set-up under way.
#[derive(Clone, Debug)]
pub(crate) struct Startup {
    goal: Goal,
    step: Step,
    step_since: Micros,
    not_before: Micros,
    /// When this set-up began; known at the first look at the clock.
    began: Option<Micros>,
    /// Failed attempts in a row of a chip that answered.
    failures: u8,
    outstanding: bool,
    /// Fresh, good bursts so far while waiting for data.
    live: u8,
}

impl Startup {
    pub(crate) fn new(goal: Goal, began: Option<Micros>) -> Self {
        let now = began.unwrap_or_default();
        Self {
            goal,
            step: Step::Call,
            step_since: now,
            not_before: now,
            began,
            failures: 0,
            outstanding: false,
            live: 0,
        }
    }

    /// When this set-up began.
    pub(crate) fn began(&self) -> Micros {
        self.began.unwrap_or(self.not_before)
    }

    /// The next transfer, or the moment before which there is none.
    pub(crate) fn next(&mut self, now: Micros, config: &Config) -> Result<Transfer, Micros> {
        self.began.get_or_insert(now);
        if now < self.not_before {
            return Err(self.not_before);
        }
        self.outstanding = true;
        Ok(self.transfer(config))
    }

    fn transfer(&self, config: &Config) -> Transfer {
        match self.step {
            Step::Call => Transfer::write(reg::PAGE_ID, [0]),
            Step::Identify => Transfer::read(reg::CHIP_ID, 8),
            Step::Reset => Transfer::write(reg::SYS_TRIGGER, [reg::RST_SYS]),
            Step::EnterConfig => Transfer::write(reg::OPR_MODE, [0]),
            Step::AwaitConfig | Step::AwaitMode => Transfer::read(reg::OPR_MODE, 1),
            Step::Diagnose => Transfer::read(reg::ST_RESULT, 5),
            Step::Write(setting) => setting.write(config),
            Step::Confirm(setting) => match setting.write(config) {
                Transfer::Write { register, bytes } => Transfer::read(register, bytes.len() as u8),
                read @ Transfer::Read { .. } => read,
            },
            Step::AwaitClock | Step::ConfirmClock => Transfer::read(reg::SYS_CLK_STATUS, 1),
            Step::SelectClock => Transfer::write(reg::SYS_TRIGGER, [reg::CLK_SEL]),
            Step::EnterMode => Transfer::write(reg::OPR_MODE, [config.mode as u8]),
            Step::AwaitRunning => Transfer::read(reg::SYS_STATUS, 2),
            Step::AwaitData => sample::burst(config.mode),
            Step::Suspend => Transfer::write(reg::PWR_MODE, [SUSPEND]),
        }
    }

    /// Takes the outcome of the transfer that [`Startup::next`] gave out; ignores any other.
    pub(crate) fn complete(
        &mut self,
        now: Micros,
        outcome: Result<&[u8], BusError>,
        config: &Config,
        inspector: &mut Inspector,
        identity: &mut Identity,
    ) -> Progress {
        if !core::mem::take(&mut self.outstanding) {
            return Progress::Going;
        }
        let verdict = match outcome {
            Err(error) => Verdict::Fail(error.into()),
            Ok(bytes) if bytes.len() != self.transfer(config).answer_len() => {
                Verdict::Fail(SensorFault::Protocol)
            }
            Ok(bytes) => self.judge(now, bytes, config, inspector, identity),
        };
        match verdict {
            Verdict::Reached => return Progress::Reached(self.goal),
            Verdict::Go(step, pause_us) => {
                self.step = step;
                self.step_since = now;
                self.not_before = now.after(pause_us);
            }
            Verdict::Again {
                pause_us,
                patience_us,
                fault,
            } => {
                if now.since(self.step_since) >= patience_us {
                    return self.fail(now, fault, config);
                }
                self.not_before = now.after(pause_us);
            }
            Verdict::Fail(fault) => return self.fail(now, fault, config),
        }
        Progress::Going
    }

    /// Starts over. A chip that cannot be reached is polled at a steady pace and reported only when it is late;
    /// one that answers and yet is not as it should be is reported at once and left more and more in peace.
    fn fail(&mut self, now: Micros, fault: SensorFault, config: &Config) -> Progress {
        let unreached = fault.is_bus() || self.step == Step::Identify;
        let mut next = Step::Call;
        let pause_us = if unreached {
            POLL_US
        } else {
            self.failures = self.failures.saturating_add(1);
            if let ResetPolicy::AfterFailures(limit) = config.reset
                && self.failures.is_multiple_of(limit.get())
            {
                next = Step::Reset;
            }
            PAUSE_MAX_US.min(PAUSE_US << (self.failures - 1).min(8))
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

    fn judge(
        &mut self,
        now: Micros,
        bytes: &[u8],
        config: &Config,
        inspector: &mut Inspector,
        identity: &mut Identity,
    ) -> Verdict {
        match self.step {
            Step::Call => Verdict::Go(Step::Identify, 0),
            Step::Identify => identify(bytes, identity),
            Step::Reset => Verdict::Go(Step::Call, RESET_US),
            Step::EnterConfig => Verdict::Go(Step::AwaitConfig, TO_CONFIG_US),
            Step::AwaitConfig => await_mode(bytes, 0, Step::Diagnose),
            Step::Diagnose if self.goal == Goal::Suspended => Verdict::Go(Step::Suspend, 0),
            Step::Diagnose => diagnose(bytes, config),
            Step::Suspend => Verdict::Reached,
            Step::Write(setting) => Verdict::Go(Step::Confirm(setting), 0),
            Step::Confirm(setting) => confirm(setting, bytes, config, identity),
            Step::AwaitClock => match bytes {
                // Bit 0 set: the clock is being configured and must be left alone.
                [status] if status & 1 == 0 => Verdict::Go(Step::SelectClock, 0),
                _ => Verdict::Again {
                    pause_us: 10_000,
                    patience_us: 500_000,
                    fault: SensorFault::Clock,
                },
            },
            Step::SelectClock => Verdict::Go(Step::ConfirmClock, CLOCK_SWITCH_US),
            Step::ConfirmClock => match bytes {
                [status] if status & 1 == 0 => Verdict::Go(Step::EnterMode, 0),
                _ => Verdict::Again {
                    pause_us: 10_000,
                    patience_us: 1_200_000,
                    fault: SensorFault::Clock,
                },
            },
            Step::EnterMode => Verdict::Go(Step::AwaitMode, FROM_CONFIG_US),
            Step::AwaitMode => await_mode(bytes, config.mode as u8, Step::AwaitRunning),
            Step::AwaitRunning => {
                let verdict = await_running(bytes, config);
                if let Verdict::Go(Step::AwaitData, _) = verdict {
                    *inspector = Inspector::default();
                    self.live = 0;
                }
                verdict
            }
            Step::AwaitData => {
                let fault = match inspector.judge(config, now, bytes) {
                    Ok(judged) => {
                        self.live += u8::from(judged.fresh);
                        // The second fresh burst shows that the data move.
                        if self.live >= 2 {
                            return Verdict::Reached;
                        }
                        SensorFault::Frozen
                    }
                    Err(fault) => fault,
                };
                Verdict::Again {
                    pause_us: 10_000,
                    patience_us: 1_000_000,
                    fault,
                }
            }
        }
    }
}

fn identify(bytes: &[u8], identity: &mut Identity) -> Verdict {
    let &[
        chip,
        acc,
        mag,
        gyr,
        software_low,
        software_high,
        bootloader,
        page,
    ] = bytes
    else {
        return Verdict::Fail(SensorFault::Protocol);
    };
    let [right_chip, right @ ..] = IDS;
    if chip != right_chip {
        return Verdict::Fail(SensorFault::WrongChip { found: chip });
    }
    for (register, (found, right)) in (1..).zip([acc, mag, gyr].into_iter().zip(right)) {
        if found != right {
            return Verdict::Fail(SensorFault::DeadSensor { register, found });
        }
    }
    if page != 0 {
        return Verdict::Fail(SensorFault::Configuration {
            register: reg::PAGE_ID,
            found: page,
        });
    }
    identity.software = u16::from_le_bytes([software_low, software_high]);
    identity.bootloader = bootloader;
    Verdict::Go(Step::EnterConfig, 0)
}

fn await_mode(bytes: &[u8], mode: u8, next: Step) -> Verdict {
    let found = bytes.first().map_or(u8::MAX, |found| found & 0x0F);
    if found == mode {
        return Verdict::Go(next, 0);
    }
    let fault = SensorFault::Configuration {
        register: reg::OPR_MODE,
        found,
    };
    Verdict::Again {
        pause_us: 5_000,
        patience_us: 100_000,
        fault,
    }
}

fn diagnose(bytes: &[u8], config: &Config) -> Verdict {
    let &[result, _, _, status, error] = bytes else {
        return Verdict::Fail(SensorFault::Protocol);
    };
    let error = SystemError::from_register(error);
    match SystemStatus::from_register(status) {
        SystemStatus::Error => return Verdict::Fail(SensorFault::System { error }),
        status if status.is_starting() => {
            return Verdict::Again {
                pause_us: 10_000,
                patience_us: 600_000,
                fault: SensorFault::System { error },
            };
        }
        _ => {}
    }
    if result & 0x0F != 0x0F {
        return Verdict::Fail(SensorFault::SelfTest { result });
    }
    if let Some(profile) = config.profile
        && let Err(crate::ProfileError::Range { register, .. }) =
            profile.check(config.mode, &config.sensors)
    {
        return Verdict::Fail(SensorFault::Profile { register });
    }
    Verdict::Go(Step::Write(Setting::Power), 0)
}

fn confirm(setting: Setting, bytes: &[u8], config: &Config, identity: &mut Identity) -> Verdict {
    match setting.write(config) {
        Transfer::Write {
            register,
            bytes: written,
        } => {
            for (offset, (&found, &written)) in bytes.iter().zip(written.as_slice()).enumerate() {
                if (found ^ written) & setting.mask(config, offset) != 0 {
                    let register = register.saturating_add(offset as u8);
                    return Verdict::Fail(SensorFault::Configuration { register, found });
                }
            }
        }
        Transfer::Read { .. } => {
            if let Ok(unique_id) = bytes.try_into() {
                identity.unique_id = unique_id;
            }
        }
    }
    match setting.next(config) {
        // What is only read needs no writing first.
        Some(next @ Setting::UniqueId) => Verdict::Go(Step::Confirm(next), 0),
        Some(next) => Verdict::Go(Step::Write(next), 0),
        None if config.external_crystal => Verdict::Go(Step::AwaitClock, 0),
        None => Verdict::Go(Step::EnterMode, 0),
    }
}

fn await_running(bytes: &[u8], config: &Config) -> Verdict {
    let &[status, error] = bytes else {
        return Verdict::Fail(SensorFault::Protocol);
    };
    let fault = SensorFault::System {
        error: SystemError::from_register(error),
    };
    match SystemStatus::from_register(status) {
        SystemStatus::Error => Verdict::Fail(fault),
        SystemStatus::Fusion if config.mode.is_fusion() => Verdict::Go(Step::AwaitData, 0),
        SystemStatus::NoFusion if !config.mode.is_fusion() => Verdict::Go(Step::AwaitData, 0),
        _ => Verdict::Again {
            pause_us: 5_000,
            patience_us: 500_000,
            fault,
        },
    }
}
