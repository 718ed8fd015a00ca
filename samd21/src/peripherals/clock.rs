//! Clock rates and synchronisation flags, exact in ticks.

use super::access::{Refusal, Write};
use crate::board::Ticks;

/// The core counts its time in parts of a tick, 2^`FRACTION` of them: so a cycle of any clock that
/// the chip's oscillators give is a whole number.
pub(crate) const FRACTION: u32 = 16;

/// A clock's rate: `cycles` of it last `ticks`. Rational, because 32,768 Hz is no whole number of
/// ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rate {
    ticks: u64,
    cycles: u64,
}

impl Rate {
    /// A clock of `hz`.
    pub(crate) const fn from_hz(hz: u64) -> Self {
        Self::reduced(Ticks::PER_SECOND, hz)
    }

    /// A clock whose cycle lasts this many parts of a tick, at least one.
    pub(crate) const fn of_period(parts: u64) -> Self {
        Self::reduced(parts, 1 << FRACTION)
    }

    const fn reduced(ticks: u64, cycles: u64) -> Self {
        let (mut a, mut b) = (ticks, cycles);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        Self { ticks: ticks / a, cycles: cycles / a }
    }

    /// This clock divided by `divisor`, at least 1.
    pub(crate) const fn divided(self, divisor: u64) -> Self {
        Self::reduced(self.ticks * divisor, self.cycles)
    }

    /// The least time in which `cycles` have passed.
    pub(crate) const fn duration(self, cycles: u64) -> Ticks {
        Ticks((cycles * self.ticks).div_ceil(self.cycles))
    }

    /// Whole cycles in `elapsed`.
    pub(crate) const fn cycles_in(self, elapsed: Ticks) -> u64 {
        elapsed.0 * self.cycles / self.ticks
    }

    /// Length of a cycle in parts of a tick, rounded up.
    pub(crate) const fn cycle(self) -> u64 {
        (self.ticks << FRACTION).div_ceil(self.cycles)
    }

    /// Frequency in Hz.
    pub(crate) fn hz(self) -> f64 {
        Ticks::PER_SECOND as f64 * self.cycles as f64 / self.ticks as f64
    }
}

/// SYNCBUSY flags: each bit has its own end.
#[derive(Clone, Debug)]
pub(crate) struct SyncFlags<const N: usize> {
    hold: Ticks,
    /// Whether there is a clock to synchronise to.
    pub(crate) clocked: bool,
    until: [Ticks; N],
}

impl<const N: usize> Default for SyncFlags<N> {
    fn default() -> Self {
        Self::new(Ticks::ZERO)
    }
}

impl<const N: usize> SyncFlags<N> {
    /// Flags of a peripheral whose generic clock does not run yet.
    pub(crate) fn new(hold: Ticks) -> Self {
        Self { hold, clocked: false, until: [Ticks::ZERO; N] }
    }

    /// The clock runs from now on, or no longer. When it starts, flags that hung without it end
    /// the hold time from now.
    pub(crate) fn set_clocked(&mut self, now: Ticks, clocked: bool) {
        self.clocked = clocked;
        if clocked {
            for until in &mut self.until {
                if *until == Ticks::NEVER {
                    *until = now + self.hold;
                }
            }
        }
    }

    /// Sets flag `bit` for the hold time, or without a clock for ever.
    pub(crate) fn begin(&mut self, now: Ticks, bit: usize) {
        self.until[bit] = if self.clocked { now + self.hold } else { Ticks::NEVER };
    }

    /// Whether flag `bit` is set.
    pub(crate) fn is_busy(&self, now: Ticks, bit: usize) -> bool {
        now < self.until[bit]
    }

    /// How long flag `bit` stays set.
    pub(crate) fn remaining(&self, now: Ticks, bit: usize) -> Ticks {
        self.until[bit].saturating_sub(now)
    }

    /// How long a write stalls the bus because flag `bit` is set. Without a clock that is for
    /// ever, and refused.
    pub(crate) fn stall(&self, now: Ticks, bit: usize) -> Write {
        match self.until[bit] {
            Ticks::NEVER => Err(Refusal::Forbidden("no generic clock: the bus stalls for ever")),
            _ => Ok(self.remaining(now, bit)),
        }
    }

    /// All flags as a register.
    pub(crate) fn bits(&self, now: Ticks) -> u32 {
        (0..N).fold(0, |bits, bit| bits | u32::from(self.is_busy(now, bit)) << bit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_exact() {
        let crystal = Rate::from_hz(32_768);
        // 1464.84375 ticks a cycle.
        assert_eq!(crystal.duration(32_768), Ticks::from_ms(1000));
        assert_eq!(crystal.duration(1), Ticks(1465));
        assert_eq!(crystal.cycles_in(Ticks(1464)), 0);
        assert_eq!(crystal.cycles_in(Ticks(1465)), 1);
        assert_eq!(Rate::from_hz(48_000_000).divided(16).duration(3), Ticks(48));
        for cycles in 0..1000 {
            let end = crystal.duration(cycles);
            assert_eq!(crystal.cycles_in(end), cycles);
            assert!(cycles == 0 || crystal.cycles_in(end - Ticks(1)) == cycles - 1);
        }
    }

    #[test]
    fn flags_end_one_by_one() {
        let mut flags = SyncFlags::<3>::new(Ticks(10));
        flags.set_clocked(Ticks(0), true);
        flags.begin(Ticks(100), 0);
        flags.begin(Ticks(105), 2);
        assert_eq!(flags.bits(Ticks(105)), 0b101);
        assert_eq!(flags.bits(Ticks(110)), 0b100);
        assert_eq!(flags.remaining(Ticks(110), 2), Ticks(5));
        assert_eq!(flags.bits(Ticks(115)), 0);
    }
}
