//! The system timer (ARM DDI 0419, B3.3): a 24-bit down-counter of CPU cycles.
//!
//! It is computed from the time at which it next reaches zero; it goes on counting while the
//! core sleeps, unless the options stop it.
//!
//! | register | behaviour |
//! |---|---|
//! | CSR | ENABLE, TICKINT; COUNTFLAG is set when the count goes from 1 to 0, cleared when read |
//! | RVR | 24 bits; taken at the next reload; zero stops the counter there |
//! | CVR | reads the count; any write clears count and COUNTFLAG and pends nothing |
//! | CALIB | no reference clock (NOREF), no calibration |
//!
//! The chip feeds no reference clock to the core, so CLKSOURCE reads as one and ignores writes.

const ENABLE: u32 = 1 << 0;
const TICKINT: u32 = 1 << 1;
const CLKSOURCE: u32 = 1 << 2;
const COUNTFLAG: u32 = 1 << 16;
/// CALIB: NOREF and SKEW, TENMS unknown.
pub(super) const CALIBRATION: u32 = 0xC000_0000;
const MAX: u32 = 0x00FF_FFFF;

/// The timer. Times are the core's; `cycle` is the length of a CPU cycle in them.
#[derive(Clone)]
pub(super) struct SysTick {
    /// CSR: ENABLE, TICKINT and COUNTFLAG.
    pub(super) control: u32,
    /// RVR.
    pub(super) reload: u32,
    /// While stopped: the count.
    held: u32,
    /// While counting: when the count next reaches zero, `u64::MAX` when it stays there.
    pub(super) zero_at: u64,
    /// Cycles from the last zero to `zero_at`: that many left is the cycle in which the count is
    /// still zero.
    period: u64,
}

impl Default for SysTick {
    /// The state after reset (the architecture leaves RVR and CVR unknown; here zero).
    fn default() -> Self {
        Self { control: 0, reload: 0, held: 0, zero_at: u64::MAX, period: 0 }
    }
}

impl SysTick {
    /// Counts up to `now`; whether the exception pends.
    pub(super) fn advance(&mut self, now: u64, cycle: u64) -> bool {
        let mut pends = false;
        while self.zero_at <= now {
            self.control |= COUNTFLAG;
            pends |= self.control & TICKINT != 0;
            self.restart(self.zero_at, 0, cycle);
        }
        pends
    }

    /// The length of a CPU cycle changes at `now`.
    pub(super) fn change_cycle(&mut self, now: u64, old: u64, new: u64) {
        if self.zero_at != u64::MAX {
            self.zero_at = now + self.cycles_left(now, old) * new;
        }
    }

    /// It has stood still for a time.
    pub(super) fn pause(&mut self, time: u64) {
        self.zero_at = self.zero_at.saturating_add(time);
    }

    /// Reads CSR: COUNTFLAG is cleared.
    pub(super) fn read_control(&mut self) -> u32 {
        let control = CLKSOURCE | self.control;
        self.control &= !COUNTFLAG;
        control
    }

    /// Writes CSR; COUNTFLAG stays.
    pub(super) fn write_control(&mut self, value: u32, now: u64, cycle: u64) {
        let (before, count) = (self.control, self.count(now, cycle));
        self.control = before & COUNTFLAG | value & (ENABLE | TICKINT);
        match (before & ENABLE, value & ENABLE) {
            (0, ENABLE) => self.restart(now, self.held, cycle),
            (ENABLE, 0) => {
                self.held = count;
                self.zero_at = u64::MAX;
            }
            _ => {}
        }
    }

    /// Writes RVR.
    pub(super) fn set_reload(&mut self, value: u32) {
        self.reload = value & MAX;
    }

    /// Reads CVR.
    pub(super) fn count(&self, now: u64, cycle: u64) -> u32 {
        if self.control & ENABLE == 0 {
            return self.held;
        }
        if self.zero_at == u64::MAX {
            return 0;
        }
        let left = self.cycles_left(now, cycle);
        if left >= self.period { 0 } else { left as u32 }
    }

    /// Writes CVR.
    pub(super) fn clear(&mut self, now: u64, cycle: u64) {
        self.control &= !COUNTFLAG;
        self.held = 0;
        if self.control & ENABLE != 0 {
            self.restart(now, 0, cycle);
        }
    }

    /// Counts on from `count` at `now`. From zero the next cycle loads RVR.
    fn restart(&mut self, now: u64, count: u32, cycle: u64) {
        self.held = 0;
        if count != 0 {
            // One more than is left, so that no count on the way is taken for the zero.
            self.period = u64::from(count) + 1;
            self.zero_at = now + u64::from(count) * cycle;
        } else if self.reload != 0 {
            self.period = u64::from(self.reload) + 1;
            self.zero_at = now + self.period * cycle;
        } else {
            self.zero_at = u64::MAX;
        }
    }

    /// 0 once zero is reached: an instruction that waited for the flash may look at the count
    /// a little later than that, before the timer was advanced.
    fn cycles_left(&self, now: u64, cycle: u64) -> u64 {
        self.zero_at.saturating_sub(now).div_ceil(cycle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn running(reload: u32) -> SysTick {
        let mut timer = SysTick::default();
        timer.set_reload(reload);
        timer.clear(0, 1);
        timer.write_control(ENABLE | TICKINT, 0, 1);
        timer
    }

    #[test]
    fn a_reload_of_n_gives_a_period_of_n_plus_1_cycles() {
        let mut timer = running(9);
        assert_eq!(timer.count(0, 1), 0);
        assert_eq!(timer.count(1, 1), 9);
        assert_eq!(timer.count(9, 1), 1);
        assert!(!timer.advance(9, 1));
        assert!(timer.advance(10, 1));
        assert_eq!(timer.count(10, 1), 0);
        assert_eq!(timer.count(11, 1), 9);
        assert_eq!(timer.zero_at, 20);
    }

    #[test]
    fn countflag_is_cleared_by_reading_and_by_clearing_the_count() {
        let mut timer = running(9);
        timer.advance(10, 1);
        assert_eq!(timer.read_control(), 0x0001_0007);
        assert_eq!(timer.read_control(), 0x0000_0007);
        timer.advance(20, 1);
        timer.clear(23, 1);
        assert_eq!(timer.read_control(), 0x0000_0007);
        assert_eq!(timer.zero_at, 33);
    }

    #[test]
    fn a_stopped_counter_keeps_its_count_and_goes_on_from_it() {
        let mut timer = running(99);
        timer.write_control(0, 40, 1);
        assert_eq!(timer.zero_at, u64::MAX);
        assert_eq!(timer.count(70, 1), 60);
        timer.write_control(ENABLE, 100, 1);
        assert_eq!(timer.count(100, 1), 60);
        assert_eq!(timer.zero_at, 160);
        assert!(!timer.advance(160, 1), "TICKINT is off");
        assert_eq!(timer.read_control(), 0x0001_0005);
    }

    #[test]
    fn a_new_reload_waits_for_the_next_wrap_and_zero_stops_there() {
        let mut timer = running(9);
        timer.set_reload(4);
        assert_eq!(timer.zero_at, 10);
        timer.advance(10, 1);
        assert_eq!(timer.zero_at, 15);
        timer.set_reload(0);
        timer.advance(15, 1);
        assert_eq!(timer.zero_at, u64::MAX);
        assert_eq!(timer.count(100, 1), 0);
    }

    #[test]
    fn a_count_that_is_read_late_is_zero() {
        let timer = running(9);
        assert_eq!(timer.count(11, 1), 0);
    }

    #[test]
    fn a_change_of_clock_keeps_the_count() {
        let mut timer = SysTick::default();
        timer.set_reload(99);
        timer.write_control(ENABLE, 0, 48);
        assert_eq!(timer.count(40 * 48, 48), 60);
        timer.change_cycle(40 * 48, 48, 1);
        assert_eq!(timer.count(40 * 48, 1), 60);
        assert_eq!(timer.zero_at, 40 * 48 + 60);
    }
}
