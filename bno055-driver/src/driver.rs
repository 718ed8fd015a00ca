//! The driver: the next transfer, and the consequences of its outcome.

mod sampling;

use crate::config::Config;
use crate::fusion::{self, FusionSample};
use crate::request::{Answer, Request};
use crate::sample;
use crate::startup::{Goal, Startup};
use crate::status::Identity;
use sampling::{Errand, Sampling};
use tvc_imu::judge::{Rules, Verdict, Words, received};
use tvc_imu::pace::{Pace, Progress};
use tvc_imu::{
    Bursts, Imu, Micros, Next, RawSample, Refresh, Report, Sample, SensorFault, Transfer,
    Transferred,
};

#[derive(Clone, Debug)]
enum Phase {
    Startup(Startup),
    Sampling(Sampling),
    Suspended,
}

/// A BNO055, without its bus.
///
/// The owner of the bus asks [`next`](Imu::next) for a task, does it, and reports to
/// [`complete`](Imu::complete), one transfer at a time. After [`Next::Sample`], a timer of the
/// owner may start the same [`burst`](Self::burst) at every tick, and its outcome goes to
/// [`sample`](Imu::sample). After each burst, `next` has at most one short verification, or two if
/// a register read wrong. The driver judges every sample. It sets the chip up again, as often as it
/// takes, after a reset or a lost setting.
#[derive(Clone, Debug)]
pub struct Driver {
    config: Config,
    /// Of the settings.
    rules: Rules,
    phase: Phase,
    report: Report,
    identity: Identity,
    request: Option<Request>,
    answer: Option<Answer>,
}

impl Driver {
    /// A driver that sets the chip up by `config`.
    pub fn new(config: Config) -> Self {
        Self {
            rules: config.rules(),
            config,
            phase: Phase::Startup(Startup::new(Goal::Sampling, None)),
            identity: Identity::default(),
            request: None,
            answer: None,
            report: Report::new(Refresh::default()),
        }
    }

    /// The one burst that reads all sensors of the mode: 18 bytes from 0x08 in AMG mode.
    pub fn burst(&self) -> Transfer {
        sample::burst(self.config.mode)
    }

    /// A burst that reads the angular rates alone, 6 bytes, for owners that now and then have no
    /// time for a whole burst. It can replace [`burst`](Self::burst) after a good sample, whose
    /// other words complete it.
    pub fn rates_burst(&self) -> Option<Transfer> {
        match &self.phase {
            Phase::Sampling(sampling) if sampling.trust.inspector().has_good() => {
                sample::rates_burst(self.config.mode)
            }
            _ => None,
        }
    }

    /// The burst that reads all fusion outputs, in fusion modes: 26 bytes.
    ///
    /// Use it like [`burst`](Self::burst), with [`fusion`](Self::fusion) for its outcome.
    pub fn fusion_burst(&self) -> Transfer {
        fusion::BURST
    }

    /// Takes the outcome of a burst of fusion outputs that started at `time`.
    ///
    /// # Errors
    /// The fault that makes the data unusable, as for [`sample`](Imu::sample). Only `sample` finds
    /// frozen data.
    pub fn fusion(
        &mut self,
        time: Micros,
        outcome: Transferred<'_>,
    ) -> Result<FusionSample, SensorFault> {
        let Phase::Sampling(Sampling { trust, .. }) = &mut self.phase else {
            return Err(self.report.cause());
        };
        let judged = received(outcome, 0).map(|bytes| FusionSample::judge(time, bytes));
        let verdict = match judged {
            Ok(judged) => trust.fused(&mut self.report.health, time, judged.map(|_| ())),
            Err(fault) => trust.silent(&mut self.report.health, time, fault),
        };
        self.take(time, verdict)?;
        judged.and_then(|judged| judged)
    }

    /// Sets the chip up anew with other settings.
    pub fn reconfigure(&mut self, config: Config) {
        self.rules = config.rules();
        self.config = config;
        self.resume();
    }

    /// Asks the chip; [`answer`](Self::answer) has the answer once it has come. A newer request
    /// replaces an older request, and a suspended chip resumes.
    pub fn request(&mut self, request: Request) {
        self.cancel();
        self.request = Some(request);
        self.answer = None;
        if request.needs_config() || matches!(self.phase, Phase::Suspended) {
            self.resume();
        }
    }

    /// Drops the request without an answer, and discards an answer under way.
    pub fn cancel(&mut self) {
        self.request = None;
        if let Phase::Startup(startup) = &mut self.phase {
            startup.request = None;
        }
    }

    /// Whether a request has no answer yet.
    pub fn is_asking(&self) -> bool {
        self.request.is_some()
    }

    /// Whether the chip has been put into its suspend mode.
    pub fn is_suspended(&self) -> bool {
        matches!(self.phase, Phase::Suspended)
    }

    /// The answer to the last request, once.
    pub fn answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// Puts the chip into its suspend mode, without measurements; drops a request.
    pub fn suspend(&mut self) {
        self.request = None;
        self.phase = Phase::Startup(Startup::new(Goal::Suspended, None));
        self.report.fault = Some(SensorFault::Suspended);
    }

    /// Sets the chip up again, as after [`suspend`](Self::suspend).
    pub fn resume(&mut self) {
        self.phase = Phase::Startup(Startup::new(Goal::Sampling, self.request_in_config()));
        self.report.fault = Some(SensorFault::Booting);
    }

    /// Revisions and unique identification, known once the chip has been set up.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The settings, with the address tried last.
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
        // Rates of -1 on all axes come every few seconds at rest, but not after a lost burst.
        let verdict = match trust.received(outcome, sample::RATES.into()) {
            Ok(bytes) => match sample::read(&mut words, &self.config, trust.inspector(), bytes) {
                Ok(is_whole) => trust.judge(health, &self.rules, time, &words, is_whole),
                Err(fault) => trust.conclude(health, time, Err(fault)),
            },
            Err(fault) => trust.silent(health, time, fault),
        };
        self.take(time, verdict)?;
        match &self.phase {
            Phase::Sampling(Sampling { trust, .. }) => trust.inspector().sample(),
            _ => None,
        }
        .ok_or(SensorFault::Booting)
    }

    /// Takes the consequences of a burst.
    #[inline]
    fn take(&mut self, time: Micros, verdict: Verdict) -> Result<(), SensorFault> {
        if let Phase::Sampling(sampling) = &mut self.phase {
            sampling.burst_ended();
        }
        if let Verdict::Restart(fault) = verdict {
            self.restart(time, fault);
        }
        self.report.fault = verdict.result().err();
        verdict.result()
    }

    fn answered(&mut self, answer: Answer) {
        self.answer = Some(answer);
        self.request = None;
    }

    fn request_in_config(&self) -> Option<Request> {
        self.request.filter(|request| request.needs_config())
    }

    fn verified(&mut self, now: Micros, outcome: Transferred<'_>) {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return;
        };
        let check = sampling.check();
        let judged = received(outcome, 0).and_then(|bytes| check.judge(bytes, &self.config));
        let verdict = sampling.trust.verified(&mut self.report.health, now, judged);
        // A register that read wrong is read again at once.
        sampling.due = sampling.trust.is_mismatched();
        match verdict {
            Verdict::Good => sampling.passed(check),
            Verdict::Bad(fault) if fault.is_bus() => self.report.fault = Some(fault),
            Verdict::Bad(_) => {}
            Verdict::Restart(fault) => self.restart(now, fault),
        }
    }

    /// Notes a lost transfer between two bursts.
    fn bus_error(&mut self, now: Micros, fault: SensorFault) {
        let Phase::Sampling(sampling) = &mut self.phase else {
            return;
        };
        self.report.fault = Some(fault);
        if let Verdict::Restart(fault) = sampling.trust.silent(&mut self.report.health, now, fault)
        {
            self.restart(now, fault);
        }
    }

    /// Sets the chip up anew, and reports `fault` until it samples again.
    fn restart(&mut self, now: Micros, fault: SensorFault) {
        self.report.restarted(fault);
        let mut startup = Startup::new(Goal::Sampling, self.request_in_config());
        startup.pace = Pace::at(now);
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
            Phase::Sampling(sampling) => {
                if let Some(request) = self.request.filter(|request| !request.needs_config()) {
                    sampling.outstanding = Some(Errand::Ask(request));
                    Next::Transfer(request.read())
                } else if sampling.due {
                    sampling.outstanding = Some(Errand::Verify);
                    Next::Transfer(sampling.check().transfer(sampling.trust.is_mismatched()))
                } else {
                    Next::Sample
                }
            }
            Phase::Suspended => Next::Wait(Micros(u64::MAX)),
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
                    Progress::Answered(answer) => {
                        // The owner may have dropped the request meanwhile.
                        if startup.request.take().is_some() {
                            self.answered(answer);
                        }
                    }
                    Progress::Reached if startup.goal == Goal::Suspended => {
                        self.report.fault = Some(SensorFault::Suspended);
                        self.phase = Phase::Suspended;
                    }
                    Progress::Reached => {
                        self.report.started(startup.pace.elapsed_us(now));
                        self.identity = startup.identity;
                        let inspector = core::mem::take(&mut startup.inspector);
                        self.phase = Phase::Sampling(Sampling::new(inspector));
                    }
                }
            }
            Phase::Sampling(sampling) => match sampling.outstanding.take() {
                Some(Errand::Verify) => self.verified(now, outcome),
                Some(Errand::Ask(asked)) => match outcome.map(|bytes| asked.decode(bytes)) {
                    // The owner may have replaced or dropped the request meanwhile.
                    Ok(Some(_)) if self.request != Some(asked) => {}
                    Ok(Some(answer)) => self.answered(answer),
                    Ok(None) => self.bus_error(now, SensorFault::Protocol),
                    Err(error) => self.bus_error(now, error.into()),
                },
                None => {}
            },
            Phase::Suspended => {}
        }
    }

    fn is_sampling(&self) -> bool {
        matches!(self.phase, Phase::Sampling(_))
    }

    fn bursts(&self) -> Bursts {
        Bursts {
            address: self.config.address.value(),
            whole: self.is_sampling().then(|| self.burst()),
            rates: self.rates_burst(),
        }
    }

    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault> {
        let raw = self.judge(time, outcome)?;
        Ok(self.report.refresh.read(raw))
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
