//! How long the words of a sensor have stood still, and whether it is dead.
//!
//! A live sensor has noise, which changes a word at nearly every refresh. How often a BNO055
//! refreshes its registers in the modes without fusion is not documented, so the mean time between
//! two changes is measured, and a sensor counts as dead when several of these have gone by.

use tvc_imu::Micros;

/// Mean times between two changes that a dead sensor has stood still for.
///
/// At 23 Hz bandwidth the gyroscope's noise is 1.4 counts, and one refresh in 70 has the rates of
/// the one before. Five in a row are equal once in 10^9: a false alarm in half a year.
const PERIODS: u32 = 6;

/// Fewest equal bursts in a row that show a dead sensor, for owners that read it seldom.
const BURSTS: u8 = 5;

/// Longest time between two changes that is counted, and the mean before the first one, us: the
/// slowest refresh that a loop could fly with is 10 Hz.
const SLOWEST_US: u32 = 100_000;

/// What is remembered of the changes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Still {
    /// The burst in which a word changed last.
    since: Option<Micros>,
    /// Bursts since, that one included.
    bursts: u8,
    /// Mean time between two changes, us.
    mean_us: u32,
}

impl Default for Still {
    fn default() -> Self {
        Self {
            since: None,
            bursts: 0,
            mean_us: SLOWEST_US,
        }
    }
}

impl Still {
    /// Of the same sensor, for the next burst.
    pub(super) fn anew(&self) -> Self {
        Self {
            since: None,
            ..*self
        }
    }

    /// Takes whether the words of a burst at `time` differ from those of the burst before.
    pub(super) fn look(&mut self, time: Micros, differ: bool) {
        if !differ {
            self.bursts = self.bursts.saturating_add(1);
            return;
        }
        if let Some(since) = self.since.replace(time) {
            let us = time.since(since).min(SLOWEST_US.into()) as u32;
            self.mean_us = (15 * self.mean_us + us) / 16;
        }
        self.bursts = 1;
    }

    /// Whether the words have stood still for `least_us` and for [`PERIODS`] mean times up to
    /// `time`.
    pub(super) fn is_dead(&self, time: Micros, least_us: u32) -> bool {
        let limit_us = least_us.max(PERIODS * self.mean_us);
        let stood = |since| time.since(since) >= limit_us.into();
        self.bursts >= BURSTS && self.since.is_some_and(stood)
    }
}
