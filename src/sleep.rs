//! When the processor may sleep, and how much it does.

use tvc_imu::Micros;

/// The system timer interrupts this often, us.
pub const TIMER_PERIOD_US: u64 = 1_000;

/// Load is measured over this long, us.
const LOAD_PERIOD_US: u64 = 1_000_000;

/// Whether the system timer, which `interrupted` last at that time, does so once more by `end`.
pub fn may_sleep(interrupted: Micros, end: Micros) -> bool {
    interrupted.after(TIMER_PERIOD_US) <= end
}

/// How busy the main loop is, without the interrupts.
#[derive(Clone, Debug)]
pub struct Load {
    since: Micros,
    asleep_us: u32,
    permille: u16,
}

impl Load {
    /// Nothing measured yet.
    pub const fn new(now: Micros) -> Self {
        Self { since: now, asleep_us: 0, permille: 0 }
    }

    /// The loop has slept for so long.
    pub fn slept(&mut self, us: u32) {
        self.asleep_us = self.asleep_us.saturating_add(us);
    }

    /// Draws the balance once a period.
    pub fn update(&mut self, now: Micros) {
        let elapsed_us = now.since(self.since);
        if elapsed_us >= LOAD_PERIOD_US {
            let elapsed_ms = elapsed_us as u32 / 1_000;
            let asleep_permille = self.asleep_us / elapsed_ms.max(1);
            self.permille = 1_000_u32.saturating_sub(asleep_permille) as u16;
            (self.since, self.asleep_us) = (now, 0);
        }
    }

    /// Share of the last whole period that the loop was awake, per mille.
    pub fn permille(&self) -> u16 {
        self.permille
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_sleeps_through_the_end() {
        let interrupted = Micros(5_000);
        assert!(may_sleep(interrupted, Micros(6_000)));
        assert!(!may_sleep(interrupted, Micros(5_999)));
        assert!(!may_sleep(interrupted, Micros(4_000)), "passed already");
        assert!(may_sleep(interrupted, Micros(u64::MAX)));
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
