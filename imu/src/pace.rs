//! The pace of a set-up: its steps' verdicts, pauses, repetitions and failed attempts.

use crate::judge::Judged;
use crate::{Micros, Next, SensorFault, Transfer, Transferred};

/// Pauses between the attempts to set a sensor up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pauses {
    /// Longest time for a sensor to answer and identify itself before the driver reports a fault,
    /// us.
    pub boot_us: u64,
    /// Pause between attempts to reach a sensor that does not answer, us.
    pub poll_us: u64,
    /// Pause after the first failure of a sensor that answered, us; each failure in a row doubles
    /// it.
    pub first_us: u64,
    /// Longest pause after a failure, us.
    pub longest_us: u64,
}

/// Where a step leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict<S, A> {
    /// To the next step, after a pause in microseconds.
    Go(S, u64),
    /// Once more after a pause in microseconds, for a limited time in microseconds; then this
    /// fault.
    Again(u64, u64, SensorFault),
    /// To the next step, with an answer.
    Answer(A, S),
    /// To the end of the set-up.
    Reached,
}

/// The result of a completed step for the driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress<A> {
    /// The set-up goes on.
    Going,
    /// The set-up goes on, and has an answer.
    Answered(A),
    /// An attempt failed with a fault to report.
    Failed(SensorFault),
    /// The set-up is over.
    Reached,
}

/// The pace of a set-up under way, and its step. The default begins at the first look at the clock.
#[derive(Clone, Debug, Default)]
pub struct Pace<S> {
    /// The step.
    pub step: S,
    /// Failed attempts in a row of a sensor that answered.
    pub failures: u8,
    /// Start of the set-up.
    began: Option<Micros>,
    step_since: Micros,
    not_before: Micros,
    /// A transfer has no outcome yet.
    outstanding: bool,
    /// Fresh, good bursts of this step.
    fresh: u8,
}

impl<S: Default> Pace<S> {
    /// The pace of a set-up that begins now.
    #[must_use]
    pub fn at(now: Micros) -> Self {
        Self { began: Some(now), ..Self::default() }
    }

    /// Time since the start of the set-up, us.
    #[must_use]
    pub fn elapsed_us(&self, now: Micros) -> u64 {
        now.since(self.began.unwrap_or(now))
    }

    /// The step's `transfer`, or the end of the pause before it.
    pub fn next(&mut self, now: Micros, transfer: Transfer) -> Next {
        self.began.get_or_insert(now);
        if now < self.not_before {
            return Next::Wait(self.not_before);
        }
        self.outstanding = true;
        Next::Transfer(transfer)
    }

    /// The answer to the step's `transfer`; `None` if [`next`](Self::next) did not give it.
    pub fn answer<'b>(
        &mut self,
        outcome: Transferred<'b>,
        transfer: &Transfer,
    ) -> Option<Result<&'b [u8], SensorFault>> {
        core::mem::take(&mut self.outstanding).then_some(match outcome {
            Ok(bytes) if bytes.len() != transfer.answer_len() => Err(SensorFault::Protocol),
            outcome => outcome.map_err(SensorFault::from),
        })
    }

    /// Looks at a judged burst of the last step. The second fresh burst shows that the data move.
    ///
    /// # Errors
    /// The fault to report if no better burst comes.
    pub fn look(&mut self, judged: Result<Judged, SensorFault>) -> Result<(), SensorFault> {
        let is_fresh = judged?.fresh;
        self.fresh += u8::from(is_fresh);
        if is_fresh && self.fresh > 1 { Ok(()) } else { Err(SensorFault::Frozen) }
    }

    /// Follows the verdict on the step. A fault leads to the first step. The sensor `is_unknown`
    /// until it has identified itself.
    pub fn follow<A>(
        &mut self,
        now: Micros,
        verdict: Result<Verdict<S, A>, SensorFault>,
        pauses: &Pauses,
        is_unknown: bool,
    ) -> Progress<A> {
        match verdict {
            Ok(Verdict::Go(step, pause_us)) => self.go(now, step, pause_us),
            Ok(Verdict::Answer(answer, step)) => {
                self.go(now, step, 0);
                return Progress::Answered(answer);
            }
            Ok(Verdict::Again(pause_us, limit_us, _)) if now.since(self.step_since) < limit_us => {
                self.not_before = now.after(pause_us);
            }
            Ok(Verdict::Again(_, _, fault)) | Err(fault) => {
                if self.fail(now, pauses, fault.is_bus() || is_unknown) {
                    return Progress::Failed(fault);
                }
            }
            Ok(Verdict::Reached) => return Progress::Reached,
        }
        Progress::Going
    }

    fn go(&mut self, now: Micros, step: S, pause_us: u64) {
        (self.step, self.step_since, self.not_before) = (step, now, now.after(pause_us));
        self.fresh = 0;
    }

    /// Starts over; whether the failure is to be reported. The driver polls a sensor that does not
    /// answer at a steady pace, and reports it only when it is late. A wrong answer is reported at
    /// once, and the next attempt comes after ever longer pauses.
    fn fail(&mut self, now: Micros, pauses: &Pauses, is_unreached: bool) -> bool {
        let mut pause_us = pauses.poll_us;
        if !is_unreached {
            pause_us = pauses.longest_us.min(pauses.first_us << self.failures.min(8));
            self.failures = self.failures.saturating_add(1);
        }
        self.go(now, S::default(), pause_us);
        !is_unreached || self.elapsed_us(now) >= pauses.boot_us
    }
}
