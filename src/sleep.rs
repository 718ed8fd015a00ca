//! When the processor may sleep, and how much it does.

use bno055_driver::Micros;

/// The system timer wakes the processor this often at least, us.
pub const WAKE_PERIOD_US: u64 = 1_000;

/// Load is measured over this long, us.
const LOAD_PERIOD_US: u64 = 1_000_000;

/// Whether to sleep until the next interrupt: not where that may come after the deadline.
pub fn may_sleep(now: Micros, deadline: Option<Micros>) -> bool {
    deadline.is_none_or(|deadline| deadline >= now.after(WAKE_PERIOD_US))
}

/// How busy the processor is.
#[derive(Clone, Debug)]
pub struct Load {
    since: Micros,
    asleep_us: u64,
    permille: u16,
}

impl Load {
    /// Nothing measured yet.
    pub const fn new(now: Micros) -> Self {
        Self {
            since: now,
            asleep_us: 0,
            permille: 0,
        }
    }

    /// The processor has slept for this long.
    pub fn slept(&mut self, us: u32) {
        self.asleep_us += u64::from(us);
    }

    /// Draws the balance once a period.
    pub fn update(&mut self, now: Micros) {
        let elapsed_us = now.since(self.since);
        if elapsed_us >= LOAD_PERIOD_US {
            let awake_us = elapsed_us.saturating_sub(self.asleep_us);
            self.permille = (awake_us as u32 / (elapsed_us as u32 / 1_000)) as u16;
            (self.since, self.asleep_us) = (now, 0);
        }
    }

    /// Share of the last whole period that the processor was awake, per mille.
    pub fn permille(&self) -> u16 {
        self.permille
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_sleeps_through_a_deadline() {
        let now = Micros(5_300);
        assert!(may_sleep(now, None));
        assert!(may_sleep(now, Some(Micros(6_300))));
        assert!(!may_sleep(now, Some(Micros(6_299))));
        assert!(!may_sleep(now, Some(Micros(5_000))), "passed already");
    }

    #[test]
    fn load_is_the_share_of_a_second_awake() {
        let mut load = Load::new(Micros(0));
        load.slept(600_000);
        load.update(Micros(999_999));
        assert_eq!(load.permille(), 0, "not a second yet");
        load.update(Micros(1_000_000));
        assert_eq!(load.permille(), 400);
        load.slept(3_000_000);
        load.update(Micros(2_500_000));
        assert_eq!(load.permille(), 0);
    }
}
