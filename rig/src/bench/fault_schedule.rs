//! Faults by time.

use crate::bno055::Fault;
use samd21::board::Ticks;

/// A fault of the sensor or its cable for a time after each release of the drone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedFault {
    /// What fails.
    pub fault: Fault,
    /// When it begins, after the release.
    pub at: Ticks,
    /// When it ends, after the release.
    pub until: Ticks,
}

impl TimedFault {
    /// What becomes of it from one time after the release to the next: nothing, or whether it is on from then.
    pub(crate) fn switched(&self, from: Ticks, to: Ticks) -> Option<bool> {
        let within = from..to;
        if within.contains(&self.until) {
            Some(false)
        } else {
            within.contains(&self.at).then_some(true)
        }
    }
}
