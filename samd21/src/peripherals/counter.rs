//! Up-counters: what TC and TCC have in common.

use super::access::ENABLE;
use super::clock::Rate;
use crate::board::Ticks;

/// CTRLA.PRESCALER of TC and TCC, bits 10:8.
fn prescaler(ctrla: u32) -> u64 {
    [1, 2, 4, 8, 16, 64, 256, 1024][(ctrla >> 8 & 7) as usize]
}

/// A running counter. It was at 0, the start of its cycle, when `start` counts had passed since
/// `origin` (before `origin`, where negative); the cycle ends after `length` counts. All times are
/// worked out from `origin`, so fractions of a tick do not add up.
#[derive(Clone, Copy, Debug)]
struct Run {
    rate: Rate,
    origin: Ticks,
    start: i64,
    length: u64,
}

impl Run {
    /// Counts on from `count` at `now`; the cycle's length is to be set.
    fn new(rate: Rate, now: Ticks, count: u32) -> Self {
        Self {
            rate,
            origin: now,
            start: -i64::from(count),
            length: 1 << 32,
        }
    }

    /// Lets the cycle end after `top`, or after `max` if COUNT is beyond `top` already.
    fn set_top(&mut self, now: Ticks, top: u32, max: u32) {
        self.length = u64::from(max) + 1;
        if self.count(now) <= top {
            self.length = u64::from(top) + 1;
        }
    }

    /// When the cycle ends.
    fn end(&self) -> Ticks {
        self.time_of(self.length).unwrap_or(Ticks::NEVER)
    }

    /// Goes on to the next cycle: from the exact end of this one, not from its tick.
    fn begin_next_cycle(&mut self) {
        self.start += self.length as i64;
    }

    /// When COUNT will meet `value` in this cycle, [`Ticks::NEVER`] if it has or will not.
    fn next_match(&self, now: Ticks, value: u32) -> Ticks {
        let value = u64::from(value);
        (value < self.length)
            .then(|| self.time_of(value))
            .flatten()
            .filter(|&at| at > now)
            .unwrap_or(Ticks::NEVER)
    }

    /// COUNT at `now`.
    fn count(&self, now: Ticks) -> u32 {
        let counts = self.rate.cycles_in(now.saturating_sub(self.origin)) as i64 - self.start;
        (counts.max(0) as u64 % self.length) as u32
    }

    /// When COUNT reaches `count` in this cycle, `None` if that is before `origin`.
    fn time_of(&self, count: u64) -> Option<Ticks> {
        let counts = u64::try_from(self.start + count as i64).ok()?;
        Some(self.origin + self.rate.duration(counts))
    }
}

/// The counter of a TC or TCC with `N` compare channels: it stands, or it runs.
#[derive(Clone, Debug)]
pub(crate) struct Counter<const N: usize> {
    clock: Option<Rate>,
    run: Option<Run>,
    /// COUNT while the counter stands.
    pub(crate) held: u32,
    /// STATUS.STOP.
    pub(crate) stopped: bool,
    pub(crate) next_overflow: Ticks,
    pub(crate) next_match: [Ticks; N],
}

impl<const N: usize> Default for Counter<N> {
    fn default() -> Self {
        Self {
            clock: None,
            run: None,
            held: 0,
            stopped: true,
            next_overflow: Ticks::NEVER,
            next_match: [Ticks::NEVER; N],
        }
    }
}

impl<const N: usize> Counter<N> {
    /// A counter that stands at 0 with the clock of this one: after a software reset.
    pub(crate) fn fresh(&self) -> Self {
        Self {
            clock: self.clock,
            ..Self::default()
        }
    }

    /// The next overflow or match.
    pub(crate) fn next(&self) -> Ticks {
        self.next_match
            .into_iter()
            .fold(self.next_overflow, Ticks::min)
    }

    pub(crate) fn count(&self, now: Ticks) -> u32 {
        self.run.map_or(self.held, |run| run.count(now))
    }

    /// Halts the counter if `clock` is another one than before; whether it is. The counter is
    /// then to be resumed.
    pub(crate) fn set_clock(&mut self, now: Ticks, clock: Option<Rate>) -> bool {
        let changed = self.clock != clock;
        if changed {
            self.halt(now);
            self.clock = clock;
        }
        changed
    }

    /// Stops counting; COUNT stays.
    pub(crate) fn halt(&mut self, now: Ticks) {
        if let Some(run) = self.run.take() {
            self.held = run.count(now);
        }
        self.next_overflow = Ticks::NEVER;
        self.next_match = [Ticks::NEVER; N];
    }

    /// Stops counting until a command or ENABLE starts the counter again; COUNT stays.
    pub(crate) fn stop(&mut self, now: Ticks) {
        self.halt(now);
        self.stopped = true;
    }

    /// Is to be resumed from 0.
    pub(crate) fn retrigger(&mut self, now: Ticks) {
        self.halt(now);
        self.held = 0;
        self.stopped = false;
    }

    /// Counts on from where COUNT stands, if it is enabled in `ctrla`, not stopped and clocked.
    /// What comes next is to be scheduled.
    pub(crate) fn resume(&mut self, now: Ticks, ctrla: u32) {
        if ctrla & ENABLE != 0
            && !self.stopped
            && let Some(clock) = self.clock
        {
            let rate = clock.divided(prescaler(ctrla));
            self.run = Some(Run::new(rate, now, self.held));
        }
    }

    /// A cycle has ended; whether another one begins.
    pub(crate) fn overflow(&mut self, now: Ticks, oneshot: bool) -> bool {
        if let Some(run) = &mut self.run {
            run.begin_next_cycle();
        }
        if oneshot {
            self.stop(now);
            self.held = 0;
        }
        !oneshot
    }

    /// The cycle ends after `top`, or at the counter's own end `max` if COUNT is beyond `top`.
    pub(crate) fn set_top(&mut self, now: Ticks, top: u32, max: u32) {
        if let Some(run) = &mut self.run {
            run.set_top(now, top, max);
            self.next_overflow = run.end();
        }
    }

    /// Finds the match with `cc` that is still to come in this cycle, if there is one.
    pub(crate) fn set_match(&mut self, now: Ticks, channel: usize, cc: u32) {
        self.next_match[channel] = self.run.map_or(Ticks::NEVER, |run| run.next_match(now, cc));
    }

    /// Finds the end of the cycle and the matches with `cc`.
    pub(crate) fn schedule(&mut self, now: Ticks, top: u32, max: u32, cc: &[u32]) {
        self.set_top(now, top, max);
        for (channel, &cc) in cc.iter().enumerate() {
            self.set_match(now, channel, cc);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_of_a_tick_do_not_add_up() {
        // 32,768 Hz, 100 counts a cycle: 146,484.375 ticks.
        let mut run = Run::new(Rate::from_hz(32_768), Ticks(7), 0);
        run.set_top(Ticks(7), 99, u32::MAX);
        for _ in 0..32_767 {
            run.begin_next_cycle();
        }
        assert_eq!(run.end(), Ticks(7) + Ticks::from_ms(100_000));
    }

    #[test]
    fn a_top_below_count_is_missed_once() {
        let mut run = Run::new(Rate::from_hz(48_000_000), Ticks(0), 500);
        run.set_top(Ticks(0), 99, 0xFFFF);
        assert_eq!(run.end(), Ticks(65_536 - 500));
        assert_eq!(run.next_match(Ticks(0), 400), Ticks::NEVER);
        assert_eq!(run.next_match(Ticks(0), 600), Ticks(100));
        run.begin_next_cycle();
        let now = Ticks(65_036);
        run.set_top(now, 99, 0xFFFF);
        assert_eq!(run.end(), now + Ticks(100));
    }
}
