//! Runs of one instruction after the other: cycles by address and exception, and breakpoints.

use std::collections::BTreeMap;

use super::{Core, parts};
use crate::board::Ticks;
use crate::bus::Bus;
use crate::core::Stop;

/// Cycles awake since a profile was begun, by what was executed.
///
/// Entering an exception counts for the first instruction of its handler, and returning for the
/// last one. What an instruction waits for flash counts for it. Sleep is not in it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Profile {
    cycles: BTreeMap<(u8, u32), u64>,
}

impl Profile {
    /// Exception number (0 in Thread mode), address of the instruction, cycles.
    pub fn iter(&self) -> impl Iterator<Item = (u8, u32, u64)> {
        self.cycles.iter().map(|(&(e, pc), &cycles)| (e, pc, cycles))
    }

    /// All cycles: as much as [`Counters::cycles`](super::Counters::cycles) has grown by.
    pub fn total(&self) -> u64 {
        self.cycles.values().sum()
    }
}

impl Core {
    /// As `run`, and notes what each instruction takes: a burst for each. A loop of its own, so
    /// that `run` pays nothing for it.
    pub(super) fn run_profiled(&mut self, bus: &mut Bus<'_>, until: Ticks) -> Stop {
        self.deadline = 0;
        loop {
            let before = self.counters().cycles;
            let attended = self.attend_if_due(bus, until);
            // An exception that was entered has changed both.
            let place = (self.ipsr, self.pc);
            let stop = attended.or_else(|| self.single(bus));
            let cycles = self.counters().cycles - before;
            if cycles != 0
                && let Some(profile) = &mut self.profile
            {
                *profile.cycles.entry(place).or_default() += cycles;
            }
            if let Some(stop) = stop {
                return stop;
            }
        }
    }

    /// As `run`, up to an instruction at whose address `stops` says so.
    pub(crate) fn run_watched(
        &mut self,
        bus: &mut Bus<'_>,
        until: Ticks,
        stops: &dyn Fn(u32) -> bool,
    ) -> Stop {
        self.deadline = 0;
        loop {
            if let Some(stop) = self.attend_if_due(bus, until) {
                return stop;
            }
            if stops(self.pc) {
                return Stop::Breakpoint;
            }
            if let Some(stop) = self.single(bus) {
                return stop;
            }
        }
    }

    fn attend_if_due(&mut self, bus: &mut Bus<'_>, until: Ticks) -> Option<Stop> {
        if self.now >= self.deadline { self.attend(bus, parts(until)) } else { None }
    }

    /// Executes one instruction: a burst that ends behind it.
    fn single(&mut self, bus: &mut Bus<'_>) -> Option<Stop> {
        let due = std::mem::replace(&mut self.deadline, self.now + 1);
        let is_left_out = self.burst(bus.memory);
        self.deadline = due;
        if is_left_out { self.rest(bus) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use crate::board::{Ticks, Unconnected};
    use crate::chip::Chip;
    use crate::options::Options;

    #[test]
    fn a_hand_written_image_gives_the_cycles_of_the_manual() {
        let mut chip = Chip::new(Options::default());
        // Stack pointer and entry point; then MOVS R0, #3; SUBS R0, #1; BNE back; B to itself.
        let code = [0, 0x80, 0, 0x20, 9, 0, 0, 0, 3, 0x20, 1, 0x38, 0xFD, 0xD1, 0xFE, 0xE7];
        chip.load_flash(0, &code);
        chip.boot(0);
        let before = chip.counters().cycles;
        chip.begin_profile();
        chip.run_until(Ticks::from_us(200), &mut Unconnected);
        let profile = chip.end_profile();
        let all: Vec<_> = profile.iter().collect();
        // A taken branch is 2 cycles, one that is not taken 1.
        assert_eq!(all[..3], [(0, 8, 1), (0, 10, 3), (0, 12, 5)]);
        assert_eq!(profile.total(), chip.counters().cycles - before);
        assert_eq!(all.len(), 4);
    }

    #[test]
    fn a_profile_changes_nothing() {
        let mut plain = Chip::new(Options::default());
        plain.load_flash(0, &[0, 0x80, 0, 0x20, 9, 0, 0, 0, 0xFE, 0xE7]);
        plain.boot(0);
        let mut profiled = plain.clone();
        profiled.begin_profile();
        for chip in [&mut plain, &mut profiled] {
            chip.run_until(Ticks::from_us(500), &mut Unconnected);
        }
        assert_eq!(plain.counters(), profiled.counters());
        assert_eq!(plain.now(), profiled.now());
    }
}
