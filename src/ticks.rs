//! When the sensor is sampled: ticks that are locked to the servo frame.
//!
//! The sensor refreshes its registers by a clock of its own, at about 100 Hz. Sampling it at 100 Hz
//! beats: about once a second a refresh is read twice or not at all, and with it goes the rotation
//! of 10 ms, up to 20 mrad of attitude in a flight from 0.8 rad. At 150 Hz every refresh is read,
//! some twice, and [`Refresh`](tvc_imu::Refresh) tells which.
//!
//! The last tick of a frame comes [`Timing::lead_us`] before the edge of the pulse that is to carry
//! its sample:
//!
//! ```text
//!  tick ── burst ── reserve ── burst due ── step ── edge
//!   |<------------- lead_us ------------------------>|
//!   |<------ burst_limit_us ------>|<STEP_BUDGET_US->|
//! ```
//!
//! A whole burst reads accelerometer, magnetometer and, last, the rates. Where a frame has several
//! ticks, the burst of the last one reads the rates alone: it begins later, by what the other two
//! would have taken, and reads the rates at the same moment. So that all readings of the rates are
//! evenly spaced, the time of such a sample is that at which a whole burst would have begun.

use core::num::NonZeroU32;

use tvc_imu::{Micros, Transfer};

use crate::sensor::Kind;
use crate::words::words;

/// From the last moment at which a burst may be over to the edge of its pulse, us: the step, with a
/// reserve.
pub const STEP_BUDGET_US: u32 = 320;

/// Shortest time between two ticks, us: sampling faster would read nothing new.
const SHORTEST_US: u32 = 6_500;

/// Longest time between two ticks with which the drone is flown, us.
const LONGEST_TICK_US: u32 = 10_000;

/// Between two ticks beside the burst and a short transfer, us, at least: a STOP, which the sensor
/// holds up as it does its bytes.
const STOP_US: u32 = 190;

/// Spare time for a short transfer that starts in the middle of a step, us: another STOP (190) and
/// half a turn of the loop (490).
const HALF_STEP_US: u32 = 680;

/// Clock stretching of a byte that is allowed for beyond the mean, us, when a short transfer is put
/// between two bursts. Should the sensor take longer for once, the next tick goes without its
/// burst.
const STRETCH_RESERVE_US: u32 = 40;

/// Bytes of a transfer beside its data: two addresses and the register's number.
const FRAMING_BYTES: u32 = 3;

/// Bytes of the longest transfer that is always to fit between two bursts: the verification of one
/// register, with two addresses and its number.
const SHORT_BYTES: u32 = 4;

/// Slowest servo frame, Hz.
const SLOWEST_HZ: u32 = 50;
/// Fastest servo frame, Hz.
const FASTEST_HZ: u32 = 333;

/// What the loop's timing follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// The sensor.
    pub sensor: Kind,
    /// Rate of the servo frame, Hz.
    pub frame_hz: u32,
    /// Speed of the sensor bus, kHz: 400, or any smaller number for 100.
    pub i2c_khz: u32,
    /// How long the sensor stretches the clock in a byte, us, as [`BurstTimes`] measure it.
    pub stretch_us: u32,
}

impl Timing {
    /// Duration of a whole burst, us: its bytes, stretched, start and end.
    pub const fn burst_us(&self) -> u32 {
        self.unstretched_us() + self.burst_bytes() * self.stretch_us
    }

    /// The stretch of a byte with which a burst takes so long, us.
    pub const fn stretch_of(&self, burst_us: u32) -> u32 {
        burst_us.saturating_sub(self.unstretched_us()) / self.burst_bytes()
    }

    /// Whether the last burst of a frame reads the rates alone: where other ticks read the rest.
    pub fn is_split(&self) -> bool {
        TickPlan::new(self).ticks_per_frame > 1
    }

    /// How long before the edge the frame's last tick comes, us.
    pub fn lead_us(&self) -> u32 {
        self.sample_lead_us() - if self.is_split() { self.skipped_us() } else { 0 }
    }

    /// How long before the edge the time of the sample is that the pulse carries, us.
    pub const fn sample_lead_us(&self) -> u32 {
        self.burst_us() + self.sensor.description().reserve_us + STEP_BUDGET_US
    }

    /// By how much a burst of the rates `alone` begins later than a whole one that reads them at
    /// the same moment, us.
    pub const fn later_us(&self, alone: bool) -> u32 {
        if alone { self.skipped_us() } else { 0 }
    }

    /// How long after its tick a burst reads the second rate, which says whether all are new, us.
    pub const fn second_rate_us(&self) -> u32 {
        self.skipped_us() + (FRAMING_BYTES + 2) * (self.byte_us() + self.stretch_us)
    }

    /// How long after its tick a burst, of the rates `alone` or whole, may be over and still be in
    /// time for its step, us.
    pub const fn burst_limit_us(&self, alone: bool) -> u32 {
        self.burst_us() + self.sensor.description().reserve_us - self.later_us(alone)
    }

    const fn skipped_us(&self) -> u32 {
        self.sensor.description().rates_at * (self.byte_us() + self.stretch_us)
    }

    /// Whether the sensor's bus is too slow to fly with: less than 100 bursts a second, each with a
    /// verification behind it.
    pub const fn is_too_slow(&self) -> bool {
        self.needed_us() > LONGEST_TICK_US
    }

    /// Shortest time between two ticks, us. It stays below [`LONGEST_TICK_US`], even where not
    /// every burst then leaves time for a short transfer.
    fn shortest_us(&self) -> u32 {
        if self.is_too_slow() {
            return self.needed_us();
        }
        // Three frames at 300 Hz are 9,999 us.
        (self.needed_us() + HALF_STEP_US).clamp(SHORTEST_US, LONGEST_TICK_US - 1)
    }

    const fn needed_us(&self) -> u32 {
        let short_us = SHORT_BYTES * (self.byte_us() + self.stretch_us);
        self.burst_us() + short_us + STOP_US
    }

    const fn burst_bytes(&self) -> u32 {
        self.sensor.description().burst_bytes + FRAMING_BYTES
    }

    const fn unstretched_us(&self) -> u32 {
        self.burst_bytes() * self.byte_us() + if self.is_slow() { 70 } else { 37 }
    }

    /// A byte that is not stretched, us.
    const fn byte_us(&self) -> u32 {
        if self.is_slow() { 90 } else { 23 }
    }

    const fn is_slow(&self) -> bool {
        self.i2c_khz < 400
    }

    /// The same for a transfer with this sensor, which may not stretch the clock.
    #[must_use]
    pub fn with(&self, sensor: Kind) -> Self {
        let stretch_us = if sensor.description().stretch_us == 0 { 0 } else { self.stretch_us };
        Self { stretch_us, ..*self }
    }

    /// The longest that a healthy chip takes for `transfer`, us.
    fn transfer_us(&self, transfer: &Transfer) -> u64 {
        let payload = match transfer {
            Transfer::Read { len, .. } => usize::from(*len),
            Transfer::Write { bytes, .. } => bytes.len(),
        };
        let bytes = payload as u32 + FRAMING_BYTES;
        u64::from(bytes * (self.byte_us() + self.stretch_us + STRETCH_RESERVE_US))
    }
}

/// How long the newest bursts took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BurstTimes {
    /// Mean of all but the longest, us.
    pub mean_us: u32,
    /// Longest but one, us: the longest may be one during which the processor stood still, to write
    /// its flash.
    pub max_us: u32,
}

impl BurstTimes {
    /// By how much the longest exceeds the mean, us.
    pub fn spread_us(&self) -> u32 {
        self.max_us.saturating_sub(self.mean_us)
    }

    /// The duration to plan with, us: the mean, and where single bursts take longer than its
    /// reserve allows for, as much more. A STOP that the sensor holds up for `stop_us`, longer than
    /// its reserve allows for, counts for the burst and for the verification behind it, as far as
    /// the sensor does not become too slow by that.
    pub fn planned_us(&self, stop_us: u32) -> u32 {
        /// Of the sensor's reserve, what rare long bytes may take.
        const RARE_US: u32 = 400;
        /// A burst with which a sensor is just not too slow.
        const SLOWEST_US: u32 = 7_950;
        /// Two STOPs for which there is room.
        const STOPS_US: u32 = 400;
        let burst_us = self.mean_us.max(self.max_us.saturating_sub(RARE_US));
        let stops_us = (2 * stop_us).saturating_sub(STOPS_US);
        burst_us.max(SLOWEST_US.min(burst_us + stops_us))
    }
}

/// Measures bursts, [`BurstGauge::WINDOW`] at a time.
#[derive(Clone, Debug, Default)]
pub struct BurstGauge {
    count: u32,
    sum_us: u32,
    longest_us: u32,
    second_us: u32,
    times: BurstTimes,
}

impl BurstGauge {
    /// Bursts that a measurement takes.
    pub const WINDOW: u32 = 65;

    /// A burst took so long, us.
    pub fn add(&mut self, us: u32) {
        self.count += 1;
        let rest_us = us.min(self.longest_us);
        self.sum_us = self.sum_us.saturating_add(rest_us);
        self.second_us = self.second_us.max(rest_us);
        self.longest_us = self.longest_us.max(us);
        if self.count == Self::WINDOW {
            *self = Self {
                times: BurstTimes {
                    mean_us: self.sum_us / (Self::WINDOW - 1),
                    max_us: self.second_us,
                },
                ..Self::default()
            };
        }
    }

    /// The newest whole measurement, zero before the first.
    pub fn times(&self) -> BurstTimes {
        self.times
    }
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
    /// Longest time that is left for a burst, us. One that takes longer is too old for its step
    /// anyway, and the watchdog's early warning comes after three such steps.
    const LONGEST_FRAME_US: u32 = 20_000;

    /// As many ticks as there is time for. Where a byte is stretched by 180 us:
    ///
    /// | servo frame | ticks at 400 kHz | at 100 kHz |
    /// |---|---|---|
    /// | 50 Hz | three a frame, 150 Hz | two, 100 Hz |
    /// | 100 Hz | one a frame, 100 Hz | the same |
    /// | 200 Hz | one in two frames, 100 Hz | the same |
    /// | 300 Hz | one in two frames, 150 Hz | one in three, 100 Hz |
    /// | 333 Hz | one in three frames, 111 Hz | the same |
    #[inline(never)]
    pub fn new(timing: &Timing) -> Self {
        let frame_us = 1_000_000 / divisor(timing.frame_hz);
        let shortest_us = timing.shortest_us().min(Self::LONGEST_FRAME_US);
        let ticks = (frame_us / divisor(shortest_us)).clamp(1, Self::MOST_TICKS.into());
        Self {
            ticks_per_frame: ticks as u8,
            frames_per_tick: ((shortest_us + frame_us - 1) / divisor(frame_us)) as u8,
        }
    }

    /// Time from tick to tick, us, rounded down.
    pub fn period_us(&self, frame_hz: u32) -> u32 {
        let ticks_hz = frame_hz * u32::from(self.ticks_per_frame);
        1_000_000 * u32::from(self.frames_per_tick) / divisor(ticks_hz)
    }
}

words! {
    /// Which ticks the pulses carry, by the vehicle's clock: the last one in each frame. The frame
    /// is locked to that clock, so that one of them tells all later ones.
    #[derive(Clone, Debug, Default)]
    pub struct CarriedTicks {
        /// When one of them came.
        at: Micros,
        /// Ticks from the newest to the next that is carried.
        to_go: u8,
    }
}

impl CarriedTicks {
    /// A tick that is carried came then.
    pub fn seen(&mut self, at: Micros) {
        self.at = at;
    }

    /// Whether this tick is carried.
    pub fn tick(&mut self, ticks: &Ticks, at: Micros) -> bool {
        // Division takes the chip as long as all the rest.
        let since_us = (at.since(self.at) as u32).wrapping_add(ticks.period_us / 2);
        let per_frame = u32::from(ticks.per_frame);
        let frame_us = per_frame * ticks.period_us;
        let mut behind_us =
            if since_us < frame_us { since_us } else { since_us % divisor(frame_us) };
        self.to_go = ticks.per_frame;
        while behind_us >= ticks.period_us {
            behind_us -= ticks.period_us;
            self.to_go -= 1;
        }
        let is_carried = self.to_go == ticks.per_frame;
        if is_carried {
            self.to_go = 0;
        }
        is_carried
    }

    /// A tick without a sample, one period after the last: whether it is carried.
    pub fn missed(&mut self, ticks: &Ticks) -> bool {
        // Another plan may have fewer.
        let last = ticks.per_frame - 1;
        self.to_go = self.to_go.checked_sub(1).unwrap_or(last).min(last);
        self.to_go == 0
    }
}

/// The ticks of a frame, by the vehicle's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticks {
    period_us: u32,
    per_frame: u8,
}

impl Ticks {
    /// By the parameters' timing.
    #[inline(never)]
    pub fn new(timing: &Timing) -> Self {
        let plan = TickPlan::new(timing);
        Self { period_us: plan.period_us(timing.frame_hz), per_frame: plan.ticks_per_frame }
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
    /// repeat the one behind them.
    pub ticks: [u32; TickPlan::MOST_TICKS as usize],
    /// Time from tick to tick, us, rounded down.
    pub tick_period_us: u32,
}

impl TimerPlan {
    /// For a timer with `counts_per_us`. Frame rates outside the servo's range are brought into it.
    pub fn new(counts_per_us: u32, timing: &Timing) -> Self {
        let timing = &Timing { frame_hz: timing.frame_hz.clamp(SLOWEST_HZ, FASTEST_HZ), ..*timing };
        let plan = TickPlan::new(timing);
        let period = counts_per_us * 1_000_000 / divisor(timing.frame_hz);
        let spacing = period / divisor(plan.ticks_per_frame.into());
        let before_edge = |us| period - 1 - (counts_per_us * us - 1) % divisor(period);
        let last = before_edge(timing.lead_us());
        let middle = earlier(before_edge(timing.sample_lead_us()), spacing, period);
        let first = earlier(middle, spacing, period);
        Self {
            plan,
            period,
            ticks: match plan.ticks_per_frame {
                1 => [last; 3],
                2 => [last, middle, middle],
                _ => [last, middle, first],
            },
            tick_period_us: plan.period_us(timing.frame_hz),
        }
    }
}

/// What is divided by, at least 1: no timing that is not within its ranges panics.
fn divisor(number: u32) -> NonZeroU32 {
    NonZeroU32::new(number).unwrap_or(NonZeroU32::MIN)
}

/// The tick before the one at `tick`, which may lie in the frame before.
const fn earlier(tick: u32, spacing: u32, period: u32) -> u32 {
    (if tick < spacing { tick + period } else { tick }) - spacing
}

/// The newest tick, and whether its step is still to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewestTick {
    at: Micros,
    /// Its burst reads the rates alone.
    alone: bool,
    /// When its burst, begun or not, is too late for its step; `None` once the step has been taken.
    burst_due: Option<Micros>,
}

impl NewestTick {
    /// No tick yet.
    pub const fn new(now: Micros) -> Self {
        Self { at: now, alone: false, burst_due: None }
    }

    /// A tick has come, whose burst reads the rates `alone` or all. Says whether the step of the
    /// tick before is still to come: it is taken without a sample, which the new burst has
    /// overtaken.
    #[must_use]
    pub fn came(&mut self, at: Micros, alone: bool, timing: &Timing) -> bool {
        (self.at, self.alone) = (at, alone);
        let due = at.after(timing.burst_limit_us(alone).into());
        self.burst_due.replace(due).is_some()
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

    /// Whether the timer that makes the ticks is broken: no tick has come for longer than two of
    /// the slowest take.
    pub fn is_lost(&self, now: Micros) -> bool {
        now.since(self.at) > 2 * u64::from(TickPlan::LONGEST_FRAME_US)
    }

    /// Whether `transfer`, begun now, is over before the next tick, `reserve_us` for its STOP and
    /// for bytes that are stretched for longer left over.
    pub fn leaves_time_for(
        &self,
        now: Micros,
        transfer: &Transfer,
        timing: &Timing,
        reserve_us: u32,
        tick_period_us: u32,
    ) -> bool {
        let over = now.after(timing.transfer_us(transfer) + u64::from(reserve_us));
        // Behind a tick that has come later than it would for a whole burst the next does not.
        let next_us = tick_period_us - timing.later_us(self.alone);
        over < self.at.after(next_us.into())
    }
}

#[cfg(test)]
mod tests;
