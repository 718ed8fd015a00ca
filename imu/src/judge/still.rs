//! The standstill of a sensor's words, and whether the sensor is dead.
//!
//! A live sensor has noise, which changes a word at nearly every refresh. The refresh rate of a
//! BNO055 without fusion is not documented. So the driver measures the mean time between two
//! changes. A sensor is dead after several mean times without a change.

use crate::Micros;

/// Mean times between two changes for which a dead sensor stands still.
///
/// At 23 Hz bandwidth the gyroscope's noise is 1.4 counts, and one refresh in 70 repeats its rates.
/// Five in a row are equal once in 10^9: a false alarm in half a year.
const PERIODS: u32 = 6;

/// Fewest equal bursts in a row that show a dead sensor, for slow readers.
const BURSTS: u8 = 5;

/// Longest counted time between two changes, and the mean before the first change, us: 10 Hz, the
/// slowest refresh for a flight.
const SLOWEST_US: u32 = 100_000;

/// Memory of the changes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Still {
    /// The burst in which a word changed last.
    since: Option<Micros>,
    /// Bursts since then, with that burst.
    bursts: u8,
    /// Whether the words jumped in the last refresh that changed them.
    behind_jump: bool,
    /// Mean time between two changes, us.
    mean_us: u32,
}

impl Default for Still {
    fn default() -> Self {
        Self { since: None, bursts: 0, behind_jump: false, mean_us: SLOWEST_US }
    }
}

impl Still {
    /// Of the same sensor, for the next burst.
    pub(super) fn anew(&self) -> Self {
        Self { since: None, ..*self }
    }

    /// Takes whether the words of a burst at `time` differ from the words before, and whether they
    /// jumped.
    pub(super) fn look(&mut self, time: Micros, differ: bool, jumped: bool) {
        if !differ {
            self.bursts = self.bursts.saturating_add(1);
            return;
        }
        if let Some(since) = self.since.replace(time) {
            let us = time.since(since).min(SLOWEST_US.into()) as u32;
            self.mean_us = (15 * self.mean_us + us) / 16;
        }
        // A refresh within a burst changes some words in this burst and the rest in the next.
        self.behind_jump = jumped || self.bursts <= 2 && self.behind_jump;
        self.bursts = 1;
    }

    /// Whether the words have stood still for `least_us` and for [`PERIODS`] mean times up to
    /// `time`.
    ///
    /// Behind a jump two thirds of that suffice: a gyroscope that dies shows other rates and keeps
    /// them. Four equal refreshes follow one sound jump in 10^7.
    pub(super) fn is_dead(&self, time: Micros, least_us: u32) -> bool {
        let limit_us = least_us.max(PERIODS * self.mean_us);
        let limit_us = if self.behind_jump { limit_us / 3 * 2 } else { limit_us };
        let stood = |since| time.since(since) >= limit_us.into();
        self.bursts >= BURSTS && self.since.is_some_and(stood)
    }
}
