//! Counters: what TC and TCC have in common.

use super::access::ENABLE;
use super::clock::Rate;
use crate::board::Ticks;

/// CTRLA.PRESCALER of TC and TCC, bits 10:8.
fn prescaler(ctrla: u32) -> u64 {
    [1, 2, 4, 8, 16, 64, 256, 1024][(ctrla >> 8 & 7) as usize]
}

/// A running counter on one ramp. COUNT was `from`, the ramp's begin, when `start` counts had
/// passed since `origin`; it goes up, or down, and the ramp ends after `length` counts. All times
/// are worked out from `origin`, so fractions of a tick do not add up.
#[derive(Clone, Copy, Debug)]
struct Run {
    rate: Rate,
    origin: Ticks,
    start: u64,
    from: u32,
    down: bool,
    length: u64,
}

impl Run {
    /// Counts on from `from` at `now`; the ramp's length is to be set.
    fn new(rate: Rate, now: Ticks, from: u32, down: bool) -> Self {
        Self { rate, origin: now, start: 0, from, down, length: 1 << 32 }
    }

    /// Lets a ramp up end behind `top`, or behind `max` if COUNT is beyond `top` already, and one
    /// down behind 0. Of two slopes it ends at these, where the other slope begins.
    fn set_top(&mut self, now: Ticks, top: u32, max: u32, two_slopes: bool) {
        let last = match self.down {
            true => self.from,
            false if self.count(now) <= top => top.saturating_sub(self.from),
            false => max.saturating_sub(self.from),
        };
        self.length = u64::from(last) + u64::from(!two_slopes);
        // A ramp has to last.
        self.length = self.length.max(1);
    }

    /// When the ramp ends.
    fn end(&self) -> Ticks {
        self.time_of(self.length)
    }

    /// Goes on to the next ramp: from the exact end of this one, not from its tick.
    fn begin_ramp(&mut self, from: u32, down: bool) {
        self.start += self.length;
        self.from = from;
        self.down = down;
    }

    /// When COUNT will meet `value` on this ramp, [`Ticks::NEVER`] if it has or will not.
    fn next_match(&self, now: Ticks, value: u32) -> Ticks {
        let way =
            if self.down { self.from.checked_sub(value) } else { value.checked_sub(self.from) };
        way.map(u64::from)
            .filter(|&way| way < self.length)
            .map(|way| self.time_of(way))
            .filter(|&at| at > now)
            .unwrap_or(Ticks::NEVER)
    }

    /// COUNT at `now`.
    fn count(&self, now: Ticks) -> u32 {
        let counts = self.rate.cycles_in(now.saturating_sub(self.origin));
        let way = counts.saturating_sub(self.start) % self.length;
        if self.down {
            self.from.saturating_sub(way as u32)
        } else {
            self.from.wrapping_add(way as u32)
        }
    }

    /// When this number of counts of the ramp has passed.
    fn time_of(&self, counts: u64) -> Ticks {
        self.origin + self.rate.duration(self.start + counts)
    }
}

/// The counter of a TC or TCC with `N` compare channels: it stands, or it runs.
#[derive(Clone, Debug)]
pub(crate) struct Counter<const N: usize> {
    clock: Option<Rate>,
    run: Option<Run>,
    /// COUNT while the counter stands.
    pub(crate) held: u32,
    /// It counts down.
    pub(crate) down: bool,
    /// It counts up and down in turn.
    pub(crate) two_slopes: bool,
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
            down: false,
            two_slopes: false,
            stopped: true,
            next_overflow: Ticks::NEVER,
            next_match: [Ticks::NEVER; N],
        }
    }
}

impl<const N: usize> Counter<N> {
    /// A counter that stands at 0 with the clock of this one: after a software reset.
    pub(crate) fn fresh(&self) -> Self {
        Self { clock: self.clock, ..Self::default() }
    }

    /// The next overflow or match.
    pub(crate) fn next(&self) -> Ticks {
        self.next_match.into_iter().fold(self.next_overflow, Ticks::min)
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

    /// Is to be resumed from `count`.
    pub(crate) fn retrigger(&mut self, now: Ticks, count: u32) {
        self.halt(now);
        self.held = count;
        self.stopped = false;
    }

    /// The time that this number of cycles of its clock takes, before its prescaler.
    pub(crate) fn cycles(&self, cycles: u64) -> Option<Ticks> {
        self.clock.map(|clock| clock.duration(cycles))
    }

    /// Counts on from where COUNT stands, if it is enabled in `ctrla`, not stopped and clocked.
    /// What comes next is to be scheduled.
    pub(crate) fn resume(&mut self, now: Ticks, ctrla: u32) {
        if ctrla & ENABLE != 0
            && !self.stopped
            && let Some(clock) = self.clock
        {
            let rate = clock.divided(prescaler(ctrla));
            self.run = Some(Run::new(rate, now, self.held, self.down));
        }
    }

    /// A ramp has ended; whether the next one begins, up to `top` or down from there.
    pub(crate) fn overflow(&mut self, now: Ticks, oneshot: bool, top: u32) -> bool {
        self.down ^= self.two_slopes;
        let from = if self.down { top } else { 0 };
        if let Some(run) = &mut self.run {
            run.begin_ramp(from, self.down);
        }
        if oneshot {
            self.stop(now);
            self.held = from;
        }
        !oneshot
    }

    /// Finds the end of the ramp, which is at `top` on the way up, or at the counter's own end
    /// `max` if COUNT is beyond `top`; and the matches with `cc` that are still to come on it.
    pub(crate) fn schedule(&mut self, now: Ticks, top: u32, max: u32, cc: &[u32]) {
        if let Some(run) = &mut self.run {
            run.set_top(now, top, max, self.two_slopes);
            self.next_overflow = run.end();
        }
        for (next, &cc) in self.next_match.iter_mut().zip(cc) {
            *next = self.run.map_or(Ticks::NEVER, |run| run.next_match(now, cc));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_of_a_tick_do_not_add_up() {
        // 32,768 Hz, 100 counts a cycle: 146,484.375 ticks.
        let mut run = Run::new(Rate::from_hz(32_768), Ticks(7), 0, false);
        run.set_top(Ticks(7), 99, u32::MAX, false);
        for _ in 0..32_767 {
            run.begin_ramp(0, false);
        }
        assert_eq!(run.end(), Ticks(7) + Ticks::from_ms(100_000));
    }

    #[test]
    fn a_top_below_count_is_missed_once() {
        let mut run = Run::new(Rate::from_hz(48_000_000), Ticks(0), 500, false);
        run.set_top(Ticks(0), 99, 0xFFFF, false);
        assert_eq!(run.end(), Ticks(65_536 - 500));
        assert_eq!(run.next_match(Ticks(0), 400), Ticks::NEVER);
        assert_eq!(run.next_match(Ticks(0), 600), Ticks(100));
        run.begin_ramp(0, false);
        let now = Ticks(65_036);
        run.set_top(now, 99, 0xFFFF, false);
        assert_eq!(run.end(), now + Ticks(100));
    }

    #[test]
    fn a_ramp_down_ends_behind_0() {
        let mut run = Run::new(Rate::from_hz(48_000_000), Ticks(0), 500, true);
        run.set_top(Ticks(0), 999, 0xFFFF, false);
        assert_eq!(run.count(Ticks(100)), 400);
        assert_eq!(run.next_match(Ticks(100), 300), Ticks(200));
        assert_eq!(run.next_match(Ticks(100), 450), Ticks::NEVER);
        assert_eq!(run.next_match(Ticks(100), 501), Ticks::NEVER);
        assert_eq!(run.end(), Ticks(501));
        run.begin_ramp(999, true);
        run.set_top(Ticks(501), 999, 0xFFFF, false);
        assert_eq!(run.end(), Ticks(1501));
    }

    #[test]
    fn two_slopes_last_twice_top() {
        let mut run = Run::new(Rate::from_hz(48_000_000), Ticks(0), 0, false);
        run.set_top(Ticks(0), 1000, 0xFFFF, true);
        assert_eq!(run.end(), Ticks(1000));
        run.begin_ramp(1000, true);
        run.set_top(Ticks(1000), 1000, 0xFFFF, true);
        assert_eq!(run.next_match(Ticks(1000), 300), Ticks(1700));
        assert_eq!(run.end(), Ticks(2000));
    }
}
