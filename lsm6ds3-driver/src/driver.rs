//! The driver: the next transfer, and the consequences of its outcome.

use tvc_imu::judge::{Rules, Trust, Verdict, Words, received};
use tvc_imu::pace::Progress;
use tvc_imu::{
    Bursts, Imu, Micros, Next, RawSample, Refresh, Report, Sample, SensorFault, Transfer,
    Transferred,
};

use crate::chip::Chip;
use crate::config::Config;
use crate::sample;
use crate::self_test::SelfTest;
use crate::startup::{self, Startup};

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
    report: Report,
    chip: Option<Chip>,
    /// The temperature's count in the last good verification.
    temperature: Option<i16>,
    self_test: Option<SelfTest>,
}

impl Driver {
    /// A driver that sets the chip up by `config`.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            rules: config.rules(),
            config,
            phase: Phase::Startup(Startup::default()),
            chip: None,
            temperature: None,
            self_test: None,
            report: Report::new(Refresh::with_period(config.rate.period_us())),
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
        self.report.refresh = Refresh::with_period(config.rate.period_us());
        self.config = config;
        self.phase = Phase::Startup(Startup::default());
        self.report.fault = Some(SensorFault::Booting);
    }

    /// Begins the self-test, which takes 1.3 s; the chip must be at rest. Then it samples again,
    /// and [`self_test`](Self::self_test) has the result.
    #[cfg(feature = "self-test")]
    pub fn begin_self_test(&mut self) {
        self.self_test = None;
        self.phase = Phase::Startup(Startup::testing());
        self.report.fault = Some(SensorFault::Booting);
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

    /// The settings, with the address tried last.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The sample in the outcome of a burst, and its evidence on the chip.
    fn judge(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<RawSample, SensorFault> {
        let Phase::Sampling(Sampling { trust, .. }) = &mut self.phase else {
            return Err(self.report.cause());
        };
        let health = &mut self.report.health;
        let mut words = Words::default();
        // Rates of -1 on all axes come at rest by chance, but not after a lost burst.
        let verdict = match trust.received(outcome, sample::RATES.answer_len()) {
            Ok(bytes) => match sample::read(&mut words, trust.inspector(), bytes) {
                Ok(is_whole) => trust.judge(health, &self.rules, time, &words, is_whole),
                Err(fault) => trust.conclude(health, time, Err(fault)),
            },
            Err(fault) => trust.silent(health, time, fault),
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
        if let Verdict::Restart(fault) = verdict {
            self.restart(time, fault);
        }
        self.report.fault = verdict.result().err();
        verdict.result()
    }

    fn verified(&mut self, now: Micros, outcome: Transferred<'_>) {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return;
        };
        let judged = received(outcome, 0)
            .and_then(|bytes| startup::confirm(&self.config, self.chip, bytes))
            .map(|temperature| self.temperature = Some(temperature));
        let verdict = sampling.trust.verified(&mut self.report.health, now, judged);
        // Registers that read wrong are read again at once.
        sampling.due = sampling.trust.is_mismatched();
        match verdict {
            Verdict::Bad(fault) if fault.is_bus() => self.report.fault = Some(fault),
            Verdict::Good | Verdict::Bad(_) => {}
            Verdict::Restart(fault) => self.restart(now, fault),
        }
    }

    /// Sets the chip up anew, and reports `fault` until it samples again.
    fn restart(&mut self, now: Micros, fault: SensorFault) {
        self.report.restarted(fault);
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
            Phase::Startup(startup) => startup.pace.next(now, startup.transfer(&self.config)),
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
                let is_absent = self.report.progressed(outcome, &progress);
                if is_absent && self.config.either_address {
                    self.config.address = self.config.address.other();
                }
                match progress {
                    Progress::Going | Progress::Failed(_) => {}
                    Progress::Answered(result) => self.self_test = Some(result),
                    Progress::Reached => {
                        self.report.started(startup.pace.elapsed_us(now));
                        self.chip = startup.chip;
                        let trust = Trust::new(core::mem::take(&mut startup.inspector));
                        self.phase = Phase::Sampling(Sampling { trust, ..Sampling::default() });
                    }
                }
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
        Ok(self.report.refresh.read(self.config.convert(raw)))
    }

    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>) {
        // The counters have its evidence already.
        let _ = self.judge(time, outcome);
    }

    fn report(&self) -> &Report {
        &self.report
    }

    fn report_mut(&mut self) -> &mut Report {
        &mut self.report
    }
}
