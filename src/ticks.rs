//! When the sensor is sampled: ticks that are locked to the servo frame.
//!
//! The BNO055 refreshes its registers by a clock of its own, at about 100 Hz. Sampling it at 100 Hz
//! beats: about once a second a refresh is read twice or not at all, and with it goes the rotation
//! of 10 ms, up to 20 mrad of attitude in a flight from 0.8 rad. At 150 Hz every refresh is read,
//! some twice, and the errors of the time steps cancel.
//!
//! The last tick of a frame comes [`lead_us`] before the edge of the pulse that is to carry its
//! sample:
//!
//! ```text
//!  tick ── burst ── reserve ── burst due ── step ── edge
//!   |<------------- lead_us ------------------------>|
//!   |<------ burst_limit_us ------>|<STEP_BUDGET_US->|
//! ```

use bno055_driver::{Micros, Transfer};

/// From the last moment at which a burst may be over to the edge of its pulse, us: the step, with a
/// reserve.
pub const STEP_BUDGET_US: u32 = 1_200;

/// Reserve for a burst that takes longer than [`burst_us`], us.
const BURST_RESERVE_US: u32 = 1_000;

/// Clock stretching of a byte that is allowed for when a short transfer is put between two bursts,
/// us. A healthy chip needs 180 us; should it take longer for once, the next tick goes without its
/// burst.
const STRETCH_US: u64 = 250;

/// Slowest servo frame, Hz.
const SLOWEST_HZ: u32 = 50;
/// Fastest servo frame, Hz.
const FASTEST_HZ: u32 = 333;

/// Shortest time between two ticks, us: the burst, a short transfer to look after the sensor, and
/// some reserve. The bus at 100 kHz takes 1.4 ms longer for both.
const fn shortest_us(i2c_khz: u32) -> u32 {
    if is_slow(i2c_khz) { 9_000 } else { 6_500 }
}

/// Duration of a burst, us. Its 18 bytes with their two addresses and the register are 192 bit
/// times; the BNO055 stretches the clock by about 180 us in each of the 21 bytes.
const fn burst_us(i2c_khz: u32) -> u32 {
    if is_slow(i2c_khz) { 5_700 } else { 4_300 }
}

/// How long before the edge the frame's last tick comes, us.
pub const fn lead_us(i2c_khz: u32) -> u32 {
    burst_us(i2c_khz) + BURST_RESERVE_US + STEP_BUDGET_US
}

/// How long after its tick a burst may be over and still be in time for its step, us.
pub const fn burst_limit_us(i2c_khz: u32) -> u64 {
    (burst_us(i2c_khz) + BURST_RESERVE_US) as u64
}

const fn is_slow(i2c_khz: u32) -> bool {
    i2c_khz < 400
}

/// Ticks for a frame rate and a bus speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickPlan {
    /// Ticks in a frame, evenly spaced: 1 to [`TickPlan::MOST_TICKS`].
    pub ticks_per_frame: u8,
    /// Frames from tick to tick, where there is one or less in a frame.
    pub frames_per_tick: u8,
}

impl TickPlan {
    /// Most ticks in a frame.
    pub const MOST_TICKS: u8 = 3;

    /// As many ticks as there is time for.
    ///
    /// | servo frame | ticks at 400 kHz | at 100 kHz |
    /// |---|---|---|
    /// | 50 Hz | three a frame, 150 Hz | two, 100 Hz |
    /// | 100 Hz | one a frame, 100 Hz | the same |
    /// | 200 Hz | one in two frames, 100 Hz | the same |
    /// | 300 Hz | one in two frames, 150 Hz | one in three, 100 Hz |
    /// | 333 Hz | one in three frames, 111 Hz | the same |
    pub fn new(frame_hz: u32, i2c_khz: u32) -> Self {
        let (frame_us, shortest_us) = (1_000_000 / frame_hz, shortest_us(i2c_khz));
        let ticks = (frame_us / shortest_us).clamp(1, Self::MOST_TICKS.into());
        Self {
            ticks_per_frame: ticks as u8,
            frames_per_tick: shortest_us.div_ceil(frame_us) as u8,
        }
    }

    /// Time from tick to tick, us, rounded down.
    pub const fn period_us(&self, frame_hz: u32) -> u32 {
        1_000_000 * self.frames_per_tick as u32 / (frame_hz * self.ticks_per_frame as u32)
    }
}

/// A [`TickPlan`] as the values of the timer that makes frames and ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimerPlan {
    /// The ticks.
    pub plan: TickPlan,
    /// Timer counts in a frame.
    pub period: u32,
    /// Counts from the start of the frame to its ticks, the last first; those that there are not
    /// repeat it.
    pub ticks: [u32; TickPlan::MOST_TICKS as usize],
    /// Time from tick to tick, us, rounded down.
    pub tick_period_us: u32,
}

impl TimerPlan {
    /// For a timer with `counts_per_us`. Frame rates outside the servo's range are brought into it.
    pub fn new(counts_per_us: u32, frame_hz: u32, i2c_khz: u32) -> Self {
        let frame_hz = frame_hz.clamp(SLOWEST_HZ, FASTEST_HZ);
        let plan = TickPlan::new(frame_hz, i2c_khz);
        let period = counts_per_us * 1_000_000 / frame_hz;
        let spacing = period / plan.ticks_per_frame as u32;
        let last = period - 1 - (counts_per_us * lead_us(i2c_khz) - 1) % period;
        let middle = earlier(last, spacing, period);
        let first = earlier(middle, spacing, period);
        Self {
            plan,
            period,
            ticks: match plan.ticks_per_frame {
                1 => [last; 3],
                2 => [last, middle, last],
                _ => [last, middle, first],
            },
            tick_period_us: plan.period_us(frame_hz),
        }
    }
}

/// The tick before the one at `tick`, which may lie in the frame before.
const fn earlier(tick: u32, spacing: u32, period: u32) -> u32 {
    (if tick < spacing { tick + period } else { tick }) - spacing
}

/// The newest tick, and whether its step is still to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewestTick {
    at: Micros,
    /// When its burst, begun or not, is too late for its step; `None` once the step has been taken.
    burst_due: Option<Micros>,
}

impl NewestTick {
    /// No tick yet.
    pub const fn new(now: Micros) -> Self {
        Self {
            at: now,
            burst_due: None,
        }
    }

    /// A tick has come.
    pub fn came(&mut self, at: Micros, i2c_khz: u32) {
        self.at = at;
        self.burst_due = Some(at.after(burst_limit_us(i2c_khz)));
    }

    /// When the step is taken without a sample, if it is still to come.
    pub fn burst_due(&self) -> Option<Micros> {
        self.burst_due
    }

    /// A burst is over. Says whether its step is still to come, which is then taken.
    pub fn burst_over(&mut self) -> bool {
        self.burst_due.take().is_some()
    }

    /// Whether the step is to be taken without a sample now, once.
    pub fn is_missed(&mut self, now: Micros) -> bool {
        self.burst_due.take_if(|due| now >= *due).is_some()
    }

    /// Whether `transfer`, begun now, is over before the next tick.
    pub fn leaves_time_for(
        &self,
        now: Micros,
        transfer: &Transfer,
        i2c_khz: u32,
        tick_period_us: u32,
    ) -> bool {
        now.after(duration_us(transfer, i2c_khz)) < self.at.after(tick_period_us.into())
    }
}

/// The longest that a healthy chip takes for `transfer`.
fn duration_us(transfer: &Transfer, i2c_khz: u32) -> u64 {
    let payload = match transfer {
        Transfer::Read { len, .. } => usize::from(*len),
        Transfer::Write { bytes, .. } => bytes.len(),
    };
    let byte_us = if is_slow(i2c_khz) { 90 } else { 23 };
    // Two addresses and the register's number.
    (payload as u64 + 3) * (byte_us + STRETCH_US)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_many_ticks_as_the_table_says() {
        for (frame_hz, fast, slow) in [
            (50, (3, 1, 6_666), (2, 1, 10_000)),
            (100, (1, 1, 10_000), (1, 1, 10_000)),
            (200, (1, 2, 10_000), (1, 2, 10_000)),
            (300, (1, 2, 6_666), (1, 3, 10_000)),
            (333, (1, 3, 9_009), (1, 3, 9_009)),
        ] {
            for (i2c_khz, expected) in [(400, fast), (100, slow)] {
                let plan = TickPlan::new(frame_hz, i2c_khz);
                let found = (
                    plan.ticks_per_frame,
                    plan.frames_per_tick,
                    plan.period_us(frame_hz),
                );
                assert_eq!(found, expected, "{frame_hz} Hz, {i2c_khz} kHz");
            }
        }
    }

    /// Counts by hand, for a timer at 3 MHz.
    #[test]
    fn the_timer_ticks_its_lead_before_the_edge_and_evenly_before_that() {
        assert_eq!((lead_us(400), lead_us(100)), (6_500, 7_900));
        let plan = |frame_hz, i2c_khz| TimerPlan::new(3, frame_hz, i2c_khz);
        let slow = plan(50, 400);
        assert_eq!((slow.period, slow.tick_period_us), (60_000, 6_666));
        assert_eq!(slow.ticks, [40_500, 20_500, 500]);
        assert_eq!(plan(50, 100).ticks, [36_300, 6_300, 36_300]);
        let fast = plan(300, 400);
        assert_eq!((fast.period, fast.tick_period_us), (10_000, 6_666));
        assert_eq!((fast.ticks[0], fast.plan.frames_per_tick), (500, 2));
        assert_eq!(plan(0, 400), plan(50, 400));
        assert_eq!(plan(1_000, 400), plan(333, 400));
    }

    #[test]
    fn every_tick_lies_in_its_frame() {
        for frame_hz in [50, 100, 200, 300, 333] {
            for i2c_khz in [100, 400] {
                let plan = TimerPlan::new(3, frame_hz, i2c_khz);
                assert!(
                    plan.ticks.iter().all(|tick| *tick < plan.period),
                    "{plan:?}"
                );
            }
        }
    }

    #[test]
    fn a_burst_belongs_to_its_step_until_that_is_taken_without_it() {
        let mut tick = NewestTick::new(Micros(0));
        assert!(!tick.burst_over() && !tick.is_missed(Micros(1_000_000)));
        tick.came(Micros(10_000), 400);
        assert_eq!(tick.burst_due(), Some(Micros(15_300)));
        assert!(!tick.is_missed(Micros(15_299)));
        assert!(tick.burst_over(), "in time");
        assert!(!tick.is_missed(Micros(15_300)), "the step has been taken");
        tick.came(Micros(20_000), 100);
        assert!(tick.is_missed(Micros(26_700)));
        assert!(!tick.is_missed(Micros(26_701)), "once");
        assert!(!tick.burst_over(), "late");
    }

    #[test]
    fn a_short_transfer_goes_between_two_bursts_if_it_is_over_before_the_next() {
        let mut tick = NewestTick::new(Micros(0));
        tick.came(Micros(10_000), 400);
        let read = Transfer::Read {
            register: 0,
            len: 1,
        };
        // Four bytes of 273 us each, 6,666 us after the tick.
        let fits = |now| tick.leaves_time_for(Micros(now), &read, 400, 6_666);
        assert!(fits(15_573) && !fits(15_574));
        assert!(!tick.leaves_time_for(Micros(15_573), &read, 100, 6_666));
    }
}
