//! The driver: the next transfer, and the consequences of its outcome.

use tvc_imu::judge::{Rules, Trust, Verdict, Words, received};
use tvc_imu::{
    Bursts, BusError, Health, Imu, Micros, Next, RawSample, Refresh, Sample, SensorFault, Transfer,
    Transferred,
};

use crate::chip::Chip;
use crate::config::Config;
use crate::sample;
use crate::self_test::SelfTest;
use crate::startup::{self, Progress, Startup};

#[derive(Clone, Debug)]
enum Phase {
    Startup(Startup),
    Sampling(Sampling),
}

/// What the driver keeps while the chip samples.
#[derive(Clone, Debug, Default)]
struct Sampling {
    trust: Trust,
    /// A burst has been judged since the last verification, so the next verification may follow.
    due: bool,
    /// A verification from [`Imu::next`] has no outcome yet.
    verifying: bool,
}

/// An LSM6DS3, LSM6DSL or LSM6DSO, without its bus.
///
/// The owner of the bus asks [`next`](Imu::next) for a task, does it, and reports to
/// [`complete`](Imu::complete), one transfer at a time. After [`Next::Sample`], a timer of the
/// owner may start the same [`burst`](Self::burst) at every tick, and its outcome goes to
/// [`sample`](Imu::sample). After each burst, `next` has one verification of all control registers,
/// or two if a register read wrong. The driver judges every sample. It sets the chip up again, as
/// often as it takes, after a reset or a lost setting.
#[derive(Clone, Debug)]
pub struct Driver {
    config: Config,
    /// Of the settings.
    rules: Rules,
    phase: Phase,
    fault: Option<SensorFault>,
    health: Health,
    chip: Option<Chip>,
    /// The temperature's count in the last good verification.
    temperature: Option<i16>,
    self_test: Option<SelfTest>,
    refresh: Refresh,
}

impl Driver {
    /// A driver that sets the chip up by `config`.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            rules: config.rules(),
            config,
            phase: Phase::Startup(Startup::default()),
            fault: Some(SensorFault::Booting),
            health: Health::default(),
            chip: None,
            temperature: None,
            self_test: None,
            refresh: Refresh::with_period(config.rate.period_us()),
        }
    }

    /// The burst that reads rates and accelerations, 12 bytes.
    #[must_use]
    pub fn burst(&self) -> Transfer {
        sample::BURST
    }

    /// Sets the chip up anew with other settings.
    pub fn reconfigure(&mut self, config: Config) {
        self.rules = config.rules();
        self.refresh = Refresh::with_period(config.rate.period_us());
        self.config = config;
        self.phase = Phase::Startup(Startup::default());
        self.fault = Some(SensorFault::Booting);
    }

    /// Begins the self-test, which takes 1.3 s; the chip must be at rest. Then it samples again,
    /// and [`self_test`](Self::self_test) has the result.
    #[cfg(feature = "self-test")]
    pub fn begin_self_test(&mut self) {
        self.self_test = None;
        self.phase = Phase::Startup(Startup::testing());
        self.fault = Some(SensorFault::Booting);
    }

    /// The result of the last self-test.
    #[cfg(feature = "self-test")]
    #[must_use]
    pub fn self_test(&self) -> Option<SelfTest> {
        self.self_test
    }

    /// The chip that was found, known once it has been set up.
    #[must_use]
    pub fn chip(&self) -> Option<Chip> {
        self.chip
    }

    /// Temperature of the chip at the last verification, degrees Celsius.
    #[must_use]
    pub fn celsius(&self) -> Option<f32> {
        self.chip.zip(self.temperature).map(|(chip, count)| chip.celsius(count))
    }

    /// The counters.
    #[must_use]
    pub fn health(&self) -> &Health {
        &self.health
    }

    /// The settings, with the address tried last.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    fn cause(&self) -> SensorFault {
        self.fault.unwrap_or(SensorFault::Booting)
    }

    /// The sample in the outcome of a burst, and its evidence on the chip.
    fn judge(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<RawSample, SensorFault> {
        let Phase::Sampling(Sampling { trust, .. }) = &mut self.phase else {
            return Err(self.cause());
        };
        let mut words = Words::default();
        // Rates of -1 on all axes come at rest by chance, but not after a lost burst.
        let verdict = match trust.received(outcome, sample::RATES.answer_len()) {
            Ok(bytes) => match sample::read(&mut words, trust.inspector(), bytes) {
                Ok(is_whole) => trust.judge(&mut self.health, &self.rules, time, &words, is_whole),
                Err(fault) => trust.conclude(&mut self.health, time, Err(fault)),
            },
            Err(fault) => trust.silent(&mut self.health, time, fault),
        };
        let sample = trust.inspector().sample();
        self.take(time, verdict)?;
        sample.ok_or(SensorFault::Booting)
    }

    /// Takes the consequences of a burst.
    fn take(&mut self, time: Micros, verdict: Verdict) -> Result<(), SensorFault> {
        if let Phase::Sampling(sampling) = &mut self.phase {
            sampling.due = true;
        }
        match verdict {
            Verdict::Good => {
                self.fault = None;
                Ok(())
            }
            Verdict::Bad(fault) => {
                self.fault = Some(fault);
                Err(fault)
            }
            Verdict::Restart(fault) => {
                self.restart(time, fault);
                Err(fault)
            }
        }
    }

    fn verified(&mut self, now: Micros, outcome: Transferred<'_>) {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return;
        };
        let judged = received(outcome, 0)
            .and_then(|bytes| startup::confirm(&self.config, self.chip, bytes))
            .map(|temperature| self.temperature = Some(temperature));
        let verdict = sampling.trust.verified(&mut self.health, now, judged);
        // Registers that read wrong are read again at once.
        sampling.due = sampling.trust.is_mismatched();
        match verdict {
            Verdict::Good => {}
            Verdict::Bad(fault) if fault.is_bus() => self.fault = Some(fault),
            Verdict::Bad(_) => {}
            Verdict::Restart(fault) => self.restart(now, fault),
        }
    }

    fn advance(&mut self, now: Micros, progress: Progress) {
        let Phase::Startup(startup) = &self.phase else {
            return;
        };
        match progress {
            Progress::Going => {}
            Progress::Tested(result) => self.self_test = Some(result),
            Progress::Failed(fault) => {
                if !fault.is_bus() {
                    self.health.failed_setups = self.health.failed_setups.wrapping_add(1);
                }
                self.fault = Some(fault);
            }
            Progress::Reached => {
                self.health.starts = self.health.starts.wrapping_add(1);
                self.health.setup_us = now.since(startup.began());
                self.chip = startup.chip;
                self.fault = None;
                let trust = Trust::new(startup.inspector.clone());
                self.phase = Phase::Sampling(Sampling { trust, ..Sampling::default() });
            }
        }
    }

    /// Sets the chip up anew, and reports `fault` until it samples again.
    fn restart(&mut self, now: Micros, fault: SensorFault) {
        if fault == SensorFault::Reset {
            self.health.resets = self.health.resets.wrapping_add(1);
        }
        self.fault = Some(fault);
        let mut startup = Startup::at(now);
        if let Phase::Sampling(sampling) = &self.phase {
            startup.inspector = sampling.trust.inspector().anew();
        }
        self.phase = Phase::Startup(startup);
    }
}

impl Imu for Driver {
    fn next(&mut self, now: Micros) -> Next {
        match &mut self.phase {
            Phase::Startup(startup) => match startup.next(now, &self.config) {
                Ok(transfer) => Next::Transfer(transfer),
                Err(until) => Next::Wait(until),
            },
            Phase::Sampling(sampling) if sampling.due => {
                sampling.verifying = true;
                Next::Transfer(startup::STATUS)
            }
            Phase::Sampling(_) => Next::Sample,
        }
    }

    fn complete(&mut self, now: Micros, outcome: Transferred<'_>) {
        match &mut self.phase {
            Phase::Startup(startup) => {
                let progress = startup.complete(now, outcome, &self.config, &self.rules);
                if let Err(error) = outcome {
                    self.health.count(error.into());
                }
                let absent = matches!(progress, Progress::Failed(SensorFault::WrongChip { .. }))
                    || outcome == Err(BusError::Nak);
                if absent && self.config.either_address {
                    self.config.address = self.config.address.other();
                }
                self.advance(now, progress);
            }
            Phase::Sampling(sampling) => {
                if core::mem::take(&mut sampling.verifying) {
                    self.verified(now, outcome);
                }
            }
        }
    }

    fn is_sampling(&self) -> bool {
        matches!(self.phase, Phase::Sampling(_))
    }

    fn bursts(&self) -> Bursts {
        let (whole, rates) = match &self.phase {
            Phase::Startup(_) => (None, None),
            Phase::Sampling(sampling) => {
                let has_good = sampling.trust.inspector().has_good();
                (Some(sample::BURST), has_good.then_some(sample::RATES))
            }
        };
        Bursts { address: self.config.address.value(), whole, rates }
    }

    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault> {
        let raw = self.judge(time, outcome)?;
        Ok(self.refresh.read(self.config.convert(raw)))
    }

    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>) {
        // The counters have its evidence already.
        let _ = self.judge(time, outcome);
    }

    fn missed(&mut self) -> SensorFault {
        self.health.count(SensorFault::Late);
        *self.fault.get_or_insert(SensorFault::Late)
    }

    fn fault(&self) -> Option<SensorFault> {
        self.fault
    }

    fn failed_setups(&self) -> u32 {
        self.health.failed_setups
    }

    fn fresh(&self) -> u32 {
        self.health.fresh
    }

    fn refresh(&self) -> &Refresh {
        &self.refresh
    }
}
