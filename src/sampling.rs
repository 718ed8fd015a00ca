//! Which burst belongs to which step: ticks and transfers that are over become the main loop's
//! [`Event`]s.

use tvc_imu::{Micros, Transfer};

use crate::SelfCheck;
use crate::application::Event;
use crate::bus::{Completion, Origin};
use crate::config::HALTED_BURSTS;
use crate::ticks::{BurstGauge, BurstTimes, NewestTick, Timing};

/// Longest turn of the loop with a step, us.
const STEP_US: u64 = 900;

/// A tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// When it came.
    pub at: Micros,
    /// The next pulse carries its step.
    pub is_carried: bool,
    /// Its burst reads the rates alone.
    pub rates_only: bool,
}

/// The newest tick and its burst.
#[derive(Clone, Debug)]
pub struct Sampling {
    tick: NewestTick,
    carried_at: Micros,
    bursts: BurstGauge,
    /// Bursts that say nothing of the sensor: they may lie in a time for which the processor stood
    /// still, to write its flash, or still have the bus's former speed.
    halted: u8,
    errors: u16,
}

impl Sampling {
    /// No tick yet.
    pub fn new(now: Micros) -> Self {
        Self {
            tick: NewestTick::new(now),
            carried_at: now,
            bursts: BurstGauge::default(),
            halted: 0,
            errors: 0,
        }
    }

    /// A tick has come. Where the step of the one before is still to come, it goes without a
    /// sample.
    pub fn tick(&mut self, tick: Tick, timing: &Timing) -> Option<Event> {
        let is_overtaken = self.tick.came(tick.at, tick.rates_only, timing);
        if tick.is_carried {
            self.carried_at = before(tick.at, timing.later_us(tick.rates_only));
        }
        is_overtaken.then_some(Event::Missed)
    }

    /// A transfer is over.
    pub fn over(&mut self, completion: Completion, timing: &Timing) -> Event {
        let Completion { origin, mut outcome, took_us } = completion;
        let rates_only = origin == Origin::Tick { rates_only: true };
        outcome.started = before(outcome.started, timing.later_us(rates_only));
        match (origin, outcome.result) {
            (Origin::Tick { rates_only: false }, Ok(())) => {
                if self.halted > 0 {
                    self.halted -= 1;
                } else {
                    self.bursts.add(took_us);
                }
            }
            (_, Err(_)) => self.errors = self.errors.saturating_add(1),
            (_, Ok(())) => {}
        }
        match origin {
            Origin::Loop => Event::Reply(outcome),
            Origin::Tick { .. } if self.tick.burst_over() => Event::Burst(outcome),
            Origin::Tick { .. } => Event::Late(outcome),
        }
    }

    /// No transfer is over.
    ///
    /// # Errors
    /// The timer that makes the ticks is broken.
    pub fn none_over(&mut self, now: Micros) -> Result<Event, SelfCheck> {
        if self.tick.is_missed(now) {
            Ok(Event::Missed)
        } else if self.tick.is_lost(now) {
            Err(SelfCheck::Registers)
        } else {
            Ok(Event::Nothing)
        }
    }

    /// When the step is taken without a sample, if it is still to come.
    pub fn burst_due(&self) -> Option<Micros> {
        self.tick.burst_due()
    }

    /// When the newest tick came whose step a pulse carries, or would have come for a whole burst.
    pub fn carried_at(&self) -> Micros {
        self.carried_at
    }

    /// The processor stands still for its flash.
    pub fn halted(&mut self) {
        self.halted = HALTED_BURSTS;
    }

    /// The bus gets another speed: what has been measured is that of the one before.
    pub fn speed_changes(&mut self) {
        self.bursts = BurstGauge::default();
        self.halted();
    }

    /// How long whole bursts take.
    pub fn times(&self) -> BurstTimes {
        self.bursts.times()
    }

    /// Transfers that have failed.
    pub fn errors(&self) -> u16 {
        self.errors
    }

    /// Whether `transfer`, begun at `start`, is over before the next tick, on a bus whose STOP
    /// takes `stop_us`.
    pub fn leaves_time_for(
        &self,
        start: Micros,
        transfer: &Transfer,
        stop_us: u32,
        timing: &Timing,
        tick_period_us: u32,
    ) -> bool {
        // What the 21 bytes of a burst vary by may be one byte that is stretched for long.
        let reserve_us = stop_us + self.times().spread_us();
        self.tick.leaves_time_for(start, transfer, timing, reserve_us, tick_period_us)
    }

    /// Whether a sensor is so slow that a register can be read back only in front of the step, and
    /// not behind it.
    pub fn is_hurried(
        &self,
        now: Micros,
        stop_us: u32,
        timing: &Timing,
        tick_period_us: u32,
    ) -> bool {
        const ONE_REGISTER: Transfer = Transfer::Read { register: 0, len: 1 };
        let fits =
            |start| self.leaves_time_for(start, &ONE_REGISTER, stop_us, timing, tick_period_us);
        !fits(now.after(STEP_US)) && fits(now.after(stop_us.into()))
    }
}

fn before(at: Micros, us: u32) -> Micros {
    Micros(at.0.saturating_sub(us.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Params;
    use crate::application::Outcome;
    use tvc_imu::BusError;

    const LATER: Micros = Micros(100_000);

    fn sampling() -> (Sampling, Timing) {
        let timing = Params::default().timing();
        assert!(timing.is_split());
        (Sampling::new(Micros(0)), timing)
    }

    fn tick(rates_only: bool) -> Tick {
        Tick { at: LATER, is_carried: rates_only, rates_only }
    }

    fn over(origin: Origin, result: Result<(), BusError>) -> Completion {
        Completion { origin, outcome: Outcome { started: LATER, result }, took_us: 4_000 }
    }

    #[test]
    fn a_burst_is_its_steps_once() {
        let (mut sampling, timing) = sampling();
        let origin = Origin::Tick { rates_only: false };
        assert_eq!(sampling.tick(tick(false), &timing), None);
        let burst = over(origin, Ok(()));
        assert_eq!(sampling.over(burst, &timing), Event::Burst(burst.outcome));
        assert_eq!(sampling.over(burst, &timing), Event::Late(burst.outcome));
        let reply = over(Origin::Loop, Ok(()));
        assert_eq!(sampling.over(reply, &timing), Event::Reply(reply.outcome));
    }

    #[test]
    fn a_step_whose_burst_is_late_goes_without_once() {
        let (mut sampling, timing) = sampling();
        assert_eq!(sampling.tick(tick(false), &timing), None);
        let due = sampling.burst_due().unwrap();
        assert_eq!(sampling.none_over(before(due, 1)), Ok(Event::Nothing));
        assert_eq!(sampling.none_over(due), Ok(Event::Missed));
        assert_eq!(sampling.none_over(due), Ok(Event::Nothing));
        let burst = over(Origin::Tick { rates_only: false }, Ok(()));
        assert_eq!(sampling.over(burst, &timing), Event::Late(burst.outcome));
        // A second tick overtakes the first one's step.
        assert_eq!(sampling.tick(tick(false), &timing), None);
        assert_eq!(sampling.tick(tick(true), &timing), Some(Event::Missed));
        let lost = LATER.after(1_000_000);
        let _ = sampling.none_over(lost);
        assert_eq!(sampling.none_over(lost), Err(SelfCheck::Registers));
    }

    #[test]
    fn a_burst_of_the_rates_is_dated_as_a_whole_one() {
        let (mut sampling, timing) = sampling();
        assert_eq!(sampling.tick(tick(true), &timing), None);
        let whole = before(LATER, timing.later_us(true));
        assert!(whole < LATER);
        assert_eq!(sampling.carried_at(), whole);
        let event = sampling.over(over(Origin::Tick { rates_only: true }, Ok(())), &timing);
        let expected = Outcome { started: whole, result: Ok(()) };
        assert_eq!(event, Event::Burst(expected));
    }

    #[test]
    fn bursts_beside_a_write_of_flash_are_not_measured_and_errors_are_counted() {
        let (mut sampling, timing) = sampling();
        let origin = Origin::Tick { rates_only: false };
        sampling.halted();
        for _ in 0..u32::from(HALTED_BURSTS) + BurstGauge::WINDOW - 1 {
            let _ = sampling.over(over(origin, Ok(())), &timing);
        }
        assert_eq!(sampling.times(), BurstTimes::default());
        let _ = sampling.over(over(origin, Ok(())), &timing);
        assert_eq!(sampling.times().mean_us, 4_000);
        sampling.speed_changes();
        assert_eq!(sampling.times(), BurstTimes::default());
        let _ = sampling.over(over(origin, Err(BusError::Nak)), &timing);
        let _ = sampling.over(over(Origin::Loop, Err(BusError::Stuck)), &timing);
        assert_eq!(sampling.errors(), 2);
    }
}
