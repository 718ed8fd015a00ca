//! When the watchdog may be fed: only as long as the whole loop does its work.

use tvc_imu::Micros;

/// Shortest time between two feeds, us: a feed takes some 5 ms to reach the watchdog. It is no
/// longer than that, since this clock stands still while flash is written.
const FEED_PERIOD_US: u64 = 6_000;

/// What the loop has done since the watchdog was fed.
#[derive(Clone, Debug)]
pub struct Work {
    tick: bool,
    step: bool,
    frame: bool,
    fed: Micros,
}

impl Work {
    /// Nothing yet.
    pub const fn new(now: Micros) -> Self {
        Self { tick: false, step: false, frame: false, fed: now }
    }

    /// A tick has come.
    pub fn tick_seen(&mut self) {
        self.tick = true;
    }

    /// The flight has been stepped. `taken` says whether the servo timer took the pulse.
    pub fn step_done(&mut self, taken: bool) {
        self.step |= taken;
    }

    /// `begun` says whether the servo timer has begun a frame since the last feed: it sends pulses.
    pub fn frame_begun(&mut self, begun: bool) {
        self.frame |= begun;
    }

    /// Whether the loop has ticked and stepped, and the timer has begun a frame, since the last
    /// feed, which is long enough ago.
    pub fn is_done(&self, now: Micros) -> bool {
        self.tick && self.step && self.frame && now.since(self.fed) >= FEED_PERIOD_US
    }

    /// The watchdog has been fed: all work is to be done again.
    pub fn fed(&mut self, now: Micros) {
        *self = Self::new(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATER: Micros = Micros(FEED_PERIOD_US);

    #[test]
    fn all_of_the_work_is_asked_for_and_some_time() {
        for left_out in 0..3 {
            let mut work = Work::new(Micros(0));
            if left_out != 0 {
                work.tick_seen();
            }
            work.step_done(left_out != 1);
            work.frame_begun(left_out != 2);
            assert!(!work.is_done(LATER), "{left_out}");
        }
        let mut work = Work::new(Micros(0));
        work.tick_seen();
        work.step_done(true);
        work.frame_begun(true);
        assert!(work.is_done(LATER) && !work.is_done(Micros(FEED_PERIOD_US - 1)));
        work.fed(LATER);
        assert!(!work.is_done(Micros(10 * FEED_PERIOD_US)), "it begins again");
    }
}
