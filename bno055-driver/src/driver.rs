//! The driver: which transfer comes next, and what its outcome means.

use crate::config::Config;
use crate::fault::SensorFault;
use crate::health::Health;
use crate::registers as reg;
use crate::sample::{self, Inspector, RawSample};
use crate::startup::{Goal, Progress, Startup};
use crate::status::{Identity, SystemError, SystemStatus};
use crate::transfer::{BusError, Micros, Transfer};

/// So many bursts or verifications in a row that fail on the bus, or so many bad samples, and the chip is set up anew.
const BUS_ERRORS_MAX: u8 = 3;
const BAD_SAMPLES_MAX: u8 = 5;

/// What the owner of the bus is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Perform this transfer and hand its outcome to [`Driver::complete`].
    Transfer(Transfer),
    /// Nothing before this moment; [`Micros`] at its maximum while suspended.
    Wait(Micros),
    /// Sampling: [`Driver::burst`] may be armed for the next tick.
    Sample,
}

/// The registers that must go on holding what was written, looked at in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Check {
    Mode,
    Page,
    Units,
    AxisMap,
    AxisSign,
    System,
    Power,
}

impl Check {
    const fn next(self) -> Self {
        match self {
            Self::Mode => Self::Page,
            Self::Page => Self::Units,
            Self::Units => Self::AxisMap,
            Self::AxisMap => Self::AxisSign,
            Self::AxisSign => Self::System,
            Self::System => Self::Power,
            Self::Power => Self::Mode,
        }
    }

    /// The registers are read one by one so that the transfer fits between two bursts; status and error go together.
    const fn transfer(self) -> Transfer {
        match self {
            Self::Mode => Transfer::read(reg::OPR_MODE, 1),
            Self::Page => Transfer::read(reg::PAGE_ID, 1),
            Self::Units => Transfer::read(reg::UNIT_SEL, 1),
            Self::AxisMap => Transfer::read(reg::AXIS_MAP_CONFIG, 1),
            Self::AxisSign => Transfer::read(reg::AXIS_MAP_SIGN, 1),
            Self::System => Transfer::read(reg::SYS_STATUS, 2),
            Self::Power => Transfer::read(reg::PWR_MODE, 1),
        }
    }

    /// What is wrong with the answer, if anything is.
    fn judge(self, bytes: &[u8], config: &Config) -> Result<(), SensorFault> {
        let [map, sign] = config.axes.registers();
        let (register, mask, expected) = match self {
            Self::Mode => (reg::OPR_MODE, 0x0F, config.mode as u8),
            Self::Page => (reg::PAGE_ID, 0xFF, 0),
            Self::Units => (reg::UNIT_SEL, 0x97, config.units.register()),
            Self::AxisMap => (reg::AXIS_MAP_CONFIG, 0x3F, map),
            Self::AxisSign => (reg::AXIS_MAP_SIGN, 0x07, sign),
            Self::Power => (reg::PWR_MODE, 0x03, config.power as u8),
            Self::System => {
                let &[status, error] = bytes else {
                    return Err(SensorFault::Protocol);
                };
                return match SystemStatus::from_register(status) {
                    SystemStatus::Fusion if config.mode.is_fusion() => Ok(()),
                    SystemStatus::NoFusion if !config.mode.is_fusion() => Ok(()),
                    SystemStatus::Error => Err(SensorFault::System {
                        error: SystemError::from_register(error),
                    }),
                    _ => Err(SensorFault::Reset),
                };
            }
        };
        let &[found] = bytes else {
            return Err(SensorFault::Protocol);
        };
        match found & mask {
            found if found == expected => Ok(()),
            0 if self == Self::Mode => Err(SensorFault::Reset),
            _ => Err(SensorFault::Configuration { register, found }),
        }
    }
}

/// What the driver keeps while the chip samples.
#[derive(Clone, Debug)]
struct Sampling {
    check: Check,
    /// A verification may follow this burst.
    due: bool,
    outstanding: bool,
    /// A register read wrong once: samples are withheld until it has been read again.
    doubt: Option<SensorFault>,
    bus_errors: u8,
    bad_samples: u8,
}

impl Sampling {
    const fn new() -> Self {
        Self {
            check: Check::Mode,
            due: false,
            outstanding: false,
            doubt: None,
            bus_errors: 0,
            bad_samples: 0,
        }
    }
}

#[derive(Clone, Debug)]
enum Phase {
    Startup(Startup),
    Sampling(Sampling),
    Suspended,
}

/// A BNO055, without its bus.
///
/// The owner of the bus asks [`next`](Self::next) what to do, does it, and reports to [`complete`](Self::complete), one
/// transfer at a time. Once that says [`Next::Sample`], a timer of the owner's may start the same [`burst`](Self::burst) at
/// every tick, whose outcome goes to [`sample`](Self::sample); after each, `next` has at most one short verification
/// to do (two if a register read wrong). The driver brings the chip up, judges every sample, notices when the chip resets
/// itself or loses its settings, and sets it up again, all by itself and for ever.
#[derive(Clone, Debug)]
pub struct Driver {
    config: Config,
    phase: Phase,
    fault: Option<SensorFault>,
    health: Health,
    identity: Identity,
    inspector: Inspector,
}

impl Driver {
    /// A driver that will make the chip what `config` says.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            phase: Phase::Startup(Startup::new(Goal::Sampling, None)),
            fault: Some(SensorFault::Booting),
            health: Health::default(),
            identity: Identity::default(),
            inspector: Inspector::default(),
        }
    }

    /// What to do now. Asking again without reporting gives the same answer.
    pub fn next(&mut self, now: Micros) -> Next {
        match &mut self.phase {
            Phase::Startup(startup) => match startup.next(now, &self.config) {
                Ok(transfer) => Next::Transfer(transfer),
                Err(until) => Next::Wait(until),
            },
            Phase::Sampling(sampling) if sampling.due => {
                sampling.outstanding = true;
                Next::Transfer(sampling.check.transfer())
            }
            Phase::Sampling(_) => Next::Sample,
            Phase::Suspended => Next::Wait(Micros(u64::MAX)),
        }
    }

    /// Takes the outcome of the transfer that [`next`](Self::next) gave out: the bytes read, none for a write.
    ///
    /// An outcome that nobody waits for, such as of a verification during which a burst showed a reset, is ignored.
    pub fn complete(&mut self, now: Micros, outcome: Result<&[u8], BusError>) {
        match &mut self.phase {
            Phase::Startup(startup) => {
                if let Err(error) = outcome {
                    self.health.count(error.into());
                }
                match startup.complete(
                    now,
                    outcome,
                    &self.config,
                    &mut self.inspector,
                    &mut self.identity,
                ) {
                    Progress::Going => {}
                    Progress::Failed(fault) => {
                        if !fault.is_bus() {
                            self.health.failed_setups = self.health.failed_setups.wrapping_add(1);
                        }
                        self.fault = Some(fault);
                    }
                    Progress::Reached(Goal::Suspended) => {
                        self.fault = Some(SensorFault::Suspended);
                        self.phase = Phase::Suspended;
                    }
                    Progress::Reached(Goal::Sampling) => {
                        self.health.starts = self.health.starts.wrapping_add(1);
                        self.health.setup_us = now.since(startup.began());
                        self.fault = None;
                        self.phase = Phase::Sampling(Sampling::new());
                    }
                }
            }
            Phase::Sampling(sampling) => {
                if !core::mem::take(&mut sampling.outstanding) {
                    return;
                }
                let judged = match outcome {
                    Ok(bytes) => sampling.check.judge(bytes, &self.config),
                    Err(error) => Err(error.into()),
                };
                match judged {
                    Ok(()) => {
                        self.health.verified = self.health.verified.wrapping_add(1);
                        sampling.check = sampling.check.next();
                        sampling.doubt = None;
                        sampling.due = false;
                    }
                    Err(fault) if fault.is_bus() => {
                        self.health.count(fault);
                        sampling.due = false;
                        self.bus_error(now, fault);
                    }
                    Err(fault) => {
                        self.health.mismatched = self.health.mismatched.wrapping_add(1);
                        // A wrong bit on the wire looks the same: read it again, and believe the second answer.
                        if sampling.doubt.replace(fault).is_some() {
                            self.restart(now, fault);
                        }
                    }
                }
            }
            Phase::Suspended => {}
        }
    }

    /// The one burst that reads all sensors of the mode: 18 bytes from 0x08 in AMG mode.
    #[must_use]
    pub fn burst(&self) -> Transfer {
        sample::burst(self.config.mode)
    }

    /// Takes the outcome of a burst that started at `time`.
    ///
    /// # Errors
    /// Whatever keeps the data from being believed. The driver goes on by itself; the owner has nothing to repair.
    pub fn sample(
        &mut self,
        time: Micros,
        outcome: Result<&[u8], BusError>,
    ) -> Result<RawSample, SensorFault> {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return Err(self.fault.unwrap_or(SensorFault::Booting));
        };
        sampling.due = true;
        let judged = match outcome {
            Ok(bytes) => self.inspector.judge(&self.config, time, bytes),
            Err(error) => Err(error.into()),
        };
        let fault = match judged {
            Ok(judged) => {
                self.health.fresh = self.health.fresh.wrapping_add(u32::from(judged.fresh));
                sampling.bus_errors = 0;
                sampling.bad_samples = 0;
                match sampling.doubt {
                    None => {
                        self.health.good = self.health.good.wrapping_add(1);
                        self.health.last_good = Some(time);
                        self.fault = None;
                        return Ok(judged.sample);
                    }
                    Some(fault) => {
                        self.health.withheld = self.health.withheld.wrapping_add(1);
                        fault
                    }
                }
            }
            Err(fault) => {
                self.health.count(fault);
                if fault.is_bus() {
                    self.bus_error(time, fault);
                } else {
                    self.bad_sample(time, fault);
                }
                fault
            }
        };
        self.fault = Some(fault);
        Err(fault)
    }

    /// Notes that a tick went by without its burst, and gives the fault to report for it.
    pub fn missed(&mut self) -> SensorFault {
        self.health.count(SensorFault::Late);
        *self.fault.get_or_insert(SensorFault::Late)
    }

    /// Sets the chip up anew with other settings.
    pub fn reconfigure(&mut self, config: Config) {
        self.config = config;
        self.resume();
    }

    /// Puts the chip into its suspend mode, in which it measures nothing.
    pub fn suspend(&mut self) {
        self.phase = Phase::Startup(Startup::new(Goal::Suspended, None));
    }

    /// Sets the chip up again, as after [`suspend`](Self::suspend).
    pub fn resume(&mut self) {
        self.phase = Phase::Startup(Startup::new(Goal::Sampling, None));
        self.fault = Some(SensorFault::Booting);
    }

    /// Why there are no good samples at the moment: the first cause, until the chip samples again or turns out
    /// to have a worse one.
    #[must_use]
    pub fn fault(&self) -> Option<SensorFault> {
        self.fault
    }

    /// The counters.
    #[must_use]
    pub fn health(&self) -> &Health {
        &self.health
    }

    /// Whether the chip is set up and bursts are welcome.
    #[must_use]
    pub fn is_sampling(&self) -> bool {
        matches!(self.phase, Phase::Sampling(_))
    }

    /// Revisions and unique identification, known once the chip has been set up.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The settings.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// One transfer lost proves nothing, but the next verification looks at the mode first: the chip may have reset.
    fn bus_error(&mut self, now: Micros, fault: SensorFault) {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return;
        };
        sampling.check = if sampling.doubt.is_some() {
            sampling.check
        } else {
            Check::Mode
        };
        sampling.bus_errors = sampling.bus_errors.saturating_add(1);
        if sampling.bus_errors >= BUS_ERRORS_MAX {
            self.restart(now, fault);
        }
    }

    fn bad_sample(&mut self, now: Micros, fault: SensorFault) {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return;
        };
        sampling.bad_samples = sampling.bad_samples.saturating_add(1);
        if fault == SensorFault::Reset && sampling.doubt.is_none() {
            sampling.check = Check::Mode;
        }
        let enough = match fault {
            // Two bursts of zeros, and the mode need not be asked.
            SensorFault::Reset => 2,
            SensorFault::Frozen => 1,
            _ => BAD_SAMPLES_MAX,
        };
        if sampling.bad_samples >= enough {
            self.restart(now, fault);
        }
    }

    /// Sets the chip up anew; `fault` is reported until it samples again.
    fn restart(&mut self, now: Micros, fault: SensorFault) {
        if fault == SensorFault::Reset {
            self.health.resets = self.health.resets.wrapping_add(1);
        }
        self.fault = Some(fault);
        self.phase = Phase::Startup(Startup::new(Goal::Sampling, Some(now)));
    }
}
