//! An up-counter in motion: what TC and TCC have in common.

use super::clock::Rate;
use crate::board::Ticks;

/// CTRLA.PRESCALER of TC and TCC, bits 10:8.
pub(crate) fn prescaler(ctrla: u32) -> u64 {
    [1, 2, 4, 8, 16, 64, 256, 1024][(ctrla >> 8 & 7) as usize]
}

/// A running counter. It was at 0, the start of its cycle, when `start` counts had passed since
/// `origin` (before `origin`, where negative); the cycle ends after `length` counts. All times are
/// worked out from `origin`, so fractions of a tick do not add up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    rate: Rate,
    origin: Ticks,
    start: i64,
    length: u64,
}

impl Run {
    /// Counts on from `count` at `now`; the cycle's length is to be set.
    pub(crate) fn new(rate: Rate, now: Ticks, count: u32) -> Self {
        Self {
            rate,
            origin: now,
            start: -i64::from(count),
            length: 1 << 32,
        }
    }

    /// Lets the cycle end after `top`, or after `max` if COUNT is beyond `top` already.
    pub(crate) fn set_top(&mut self, now: Ticks, top: u32, max: u32) {
        self.length = u64::from(max) + 1;
        if self.count(now) <= top {
            self.length = u64::from(top) + 1;
        }
    }

    /// When the cycle ends.
    pub(crate) fn end(&self) -> Ticks {
        self.time_of(self.length).unwrap_or(Ticks::NEVER)
    }

    /// Goes on to the next cycle: from the exact end of this one, not from its tick.
    pub(crate) fn begin_next_cycle(&mut self) {
        self.start += self.length as i64;
    }

    /// When COUNT will meet `value` in this cycle, [`Ticks::NEVER`] if it has or will not.
    pub(crate) fn next_match(&self, now: Ticks, value: u32) -> Ticks {
        let value = u64::from(value);
        (value < self.length)
            .then(|| self.time_of(value))
            .flatten()
            .filter(|&at| at > now)
            .unwrap_or(Ticks::NEVER)
    }

    /// COUNT at `now`.
    pub(crate) fn count(&self, now: Ticks) -> u32 {
        let counts = self.rate.cycles_in(now.saturating_sub(self.origin)) as i64 - self.start;
        (counts.max(0) as u64 % self.length) as u32
    }

    /// When COUNT reaches `count` in this cycle, `None` if that is before `origin`.
    fn time_of(&self, count: u64) -> Option<Ticks> {
        let counts = u64::try_from(self.start + count as i64).ok()?;
        Some(self.origin + self.rate.duration(counts))
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
