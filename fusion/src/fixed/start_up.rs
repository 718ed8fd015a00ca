//! The gains of a running mean at the start of an estimate.
//!
//! # The schedule
//! The gain of a channel (tilt or heading) is the share of its error that one sample removes. A
//! mean over `n` samples has the gain `1 / n`; the filter's own gain is smaller. Here every gain is
//! the filter's own times a power of two:
//!
//! ```text
//! gain = own gain * 2^max(gain_log2 - subtract, 0)
//! ```
//!
//! The first `gain_log2` gives the slower channel a gain from 1/8 up to 1/4. `subtract` is 0 for
//! the slower channel; for the faster channel it is the ratio of both own gains, as a power of two.
//!
//! At least 64 samples, and at least a block, have the first gain, which turns the estimate from
//! any attitude to the measured attitude. A mean over `2^6` samples then has the gain `2^-6`. So
//! `gain_log2` drops by `6 - 2` at once, then by 1 for each doubling of the number of samples,
//! until it is 0. Time is counted in the blocks of [`Rest`](super::rest::Rest), which have a power
//! of two of samples.
//!
//! # The formats
//! The tilt gain is a factor and a right shift ([`Gain`]): for `2^k` times the gain, the shift is
//! `k` less. The product with the error of any acceleration must fit 31 bits, and after the shift
//! it must stay below a quarter of a radian. With the error `|d x a| <= 2^15 * 2^15 sqrt(3)` (Q15
//! and counts), cut by 11 bits:
//!
//! ```text
//! factor <= 2^31 / (2^19 sqrt(3)) = 2364        MAX_FACTOR
//! 2^31 / 2^MIN_TILT_SHIFT = 2^29                a quarter of a radian in Q31
//! ```
//!
//! So the shift never falls below 2. The rest of `2^k` multiplies the factor, and meanwhile the
//! acceleration is limited to 1.9 g (sum of the components' sizes). With the largest first gain
//! `2^-2 * 2^26 / per_g * 2^MIN_TILT_SHIFT = 2^26 / per_g`, the product is at most
//! `2^26 * 1.9 * 2^4 < 2^31`.
//!
//! The heading gain is also a factor, below `2^13`, and a shift. The limits of the correction bound
//! its product.

use bytemuck::{Pod, Zeroable};

use super::filters::{EIGHTH, Gain, MAX_HEADING_TURN};
use super::format::{normalised, positive};
use crate::error::{ConfigError, in_range};

/// Largest factor of the tilt gain: its product with any acceleration fits 31 bits.
const MAX_FACTOR: u16 = 2_300;

/// Least right shift of a tilt correction: it stays below a quarter of a radian.
const MIN_TILT_SHIFT: u32 = 2;

/// The first gain, as a negative power of two, from half of it up to it: from 1/8 up to 1/4.
const FIRST_GAIN_LOG2: u8 = 2;

/// Base-2 logarithm of the fewest samples with the first gain.
const FIRST_SAMPLES_LOG2: u8 = 6;

/// Base-2 logarithm of the gain increase beyond which accelerations are limited even for a filter
/// that normalises them: it is to begin as the others do.
const NORMALISED_ROOM: i32 = 2;

/// Largest sum of the sizes of an acceleration's components, g, while the factor is beyond
/// [`MAX_FACTOR`]. Gravity has at most 1.73 in any direction.
const ACC_LIMIT_G: f32 = 1.9;

/// The gains of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Gains {
    pub(super) tilt: Gain,
    pub(super) heading: Gain,
    /// Largest correction of the heading in a step, Q(16 + `heading.shift`).
    pub(super) most_turn: i32,
    /// Largest sum of the sizes of an acceleration's components, counts, while the tilt factor is
    /// beyond [`MAX_FACTOR`]; else 0. A larger acceleration is ignored.
    pub(super) acc_limit: i32,
    /// The gains are the filter's own: 1, else 0.
    settled: u32,
}

impl Gains {
    #[inline(always)]
    pub(super) fn is_settled(&self) -> bool {
        self.settled != 0
    }
}

/// The gains of a channel.
#[derive(Clone, Debug, PartialEq)]
#[repr(C)]
pub(super) struct Channel {
    /// Subtracted from `gain_log2`.
    subtract: i32,
    /// The filter's own gain.
    pub(super) own: Gain,
}

impl Channel {
    fn new((factor, shift): (i32, u32), subtract: i32) -> Self {
        let own = Gain { factor, shift };
        Self { subtract, own }
    }

    /// Base-2 logarithm of the gain increase.
    pub(super) fn raised(&self, gain_log2: i32) -> i32 {
        positive(gain_log2 - self.subtract)
    }
}

/// The schedule of the gains: the filter's own gains, and the gains of the start.
#[derive(Clone, Debug, PartialEq)]
#[repr(C)]
pub(super) struct Schedule {
    /// Blocks that have the first gain.
    first_blocks: u32,
    pub(super) tilt: Channel,
    /// Largest reduction of the tilt's shift.
    tilt_shift_room: i32,
    /// Doublings of the tilt's gain before accelerations are limited.
    limit_room: i32,
    pub(super) heading: Channel,
    /// [`Gains::acc_limit`] while there is a limit.
    acc_limit: i32,
    /// `gain_log2` at the start.
    first_gain_log2: i32,
    /// `next_drop` at the start.
    first_drop: i32,
    /// Blocks after which the estimate counts as initialised.
    start_up_blocks: u32,
}

/// Progress of the schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ScheduleState {
    /// Blocks of samples so far, modulo 2^32.
    blocks: u32,
    /// Block count at the next drop of the gain.
    drop_at: u32,
    /// Blocks from the next drop to the drop after it.
    drop_interval: u32,
    /// Base-2 logarithm of the gain increase of the slower channel.
    pub(super) gain_log2: i32,
    /// Size of the next drop of `gain_log2`.
    next_drop: i32,
}

impl Schedule {
    /// `tilt` and `heading` are the filter's own gains per sample. `per_g` are the counts of
    /// standard gravity, `counts` the counts of a tilt error of a right angle. After `start_up_s`
    /// the estimate counts as initialised.
    #[inline(always)]
    pub(super) fn new(
        (tilt, heading): (f32, f32),
        (per_g, counts): (f32, f32),
        log2_block: u8,
        start_up_blocks: f32,
    ) -> Result<Self, ConfigError> {
        // An error of 1 is 2^15 counts / 2^11, and half an angle of 1/2 is 2^30 in Q31.
        let tilt_gain = tilt * 67_108_864.0 / counts;
        let max_gain = f32::from(MAX_FACTOR) / f32::from(1u8 << MIN_TILT_SHIFT);
        in_range(tilt_gain, 0.01, max_gain, "tilt gain")?;
        let tilt_own = normalised(tilt_gain, f32::from(MAX_FACTOR));
        in_range(heading, 1e-5, 0.1, "heading gain")?;
        let heading_own = normalised(heading * 32_768.0, 8_192.0);
        let (tilt_log2, heading_log2) = (doublings(tilt), doublings(heading));
        let gain_log2 = tilt_log2.max(heading_log2);
        let first_samples_log2 = FIRST_SAMPLES_LOG2.max(log2_block);
        let first_blocks = 1 << (first_samples_log2 - log2_block);
        let tilt_shift_room = tilt_own.1.saturating_sub(MIN_TILT_SHIFT) as i32;
        Ok(Self {
            first_blocks,
            tilt: Channel::new(tilt_own, gain_log2 - tilt_log2),
            tilt_shift_room,
            limit_room: if counts == per_g {
                tilt_shift_room
            } else {
                NORMALISED_ROOM.min(tilt_shift_room)
            },
            heading: Channel::new(heading_own, gain_log2 - heading_log2),
            acc_limit: (ACC_LIMIT_G * per_g) as i32,
            first_gain_log2: gain_log2,
            first_drop: (first_samples_log2 - FIRST_GAIN_LOG2).into(),
            start_up_blocks: ((start_up_blocks + 0.5) as u32).max(first_blocks),
        })
    }

    /// The schedule at its start, and the gains until its first block, which correct nothing.
    pub(super) fn start(&self) -> (ScheduleState, Gains) {
        let state = ScheduleState {
            blocks: 0,
            drop_at: self.first_blocks + 1,
            drop_interval: self.first_blocks,
            gain_log2: self.first_gain_log2,
            next_drop: self.first_drop,
        };
        let gains = Gains {
            tilt: Gain { factor: 0, shift: MIN_TILT_SHIFT },
            heading: self.heading.own,
            most_turn: most_turn(self.heading.own.shift),
            acc_limit: self.acc_limit,
            settled: 0,
        };
        (state, gains)
    }

    /// Samples were missing: the schedule begins anew with the next block.
    pub(super) fn restart(&self, state: &mut ScheduleState) {
        state.gain_log2 = self.first_gain_log2;
        state.next_drop = self.first_drop;
        state.drop_interval = self.first_blocks;
        state.drop_after(self.first_blocks);
    }

    /// Whether the start-up is over.
    pub(super) fn is_started(&self, state: &ScheduleState) -> bool {
        state.blocks > self.start_up_blocks
    }

    /// Limits accelerations from now on, as the next gains may require.
    #[inline(always)]
    pub(super) fn limit_acc(&self, gains: &mut Gains) {
        gains.acc_limit = self.acc_limit;
    }

    /// Once a block: the gains of the next.
    #[inline(never)]
    pub(super) fn next_block(&self, state: &mut ScheduleState, gains: &mut Gains) {
        state.blocks = state.blocks.wrapping_add(1);
        if state.blocks == state.drop_at {
            state.gain_log2 = positive(state.gain_log2 - state.next_drop);
            state.next_drop = 1;
            state.drop_at = state.drop_at.wrapping_add(state.drop_interval);
            state.drop_interval <<= 1;
        }
        gains.settled = (state.gain_log2 == 0).into();
        let tilt_log2 = self.tilt.raised(state.gain_log2);
        // The factor takes the doublings beyond the shift's range.
        let excess = positive(tilt_log2 - self.tilt_shift_room);
        // The limit beyond that range, 0 within it: all bits of the mask or none.
        gains.acc_limit = self.acc_limit & ((self.limit_room - tilt_log2) >> 31);
        gains.tilt.factor = self.tilt.own.factor << (excess & 31);
        gains.tilt.shift = self.tilt.own.shift - (tilt_log2 - excess) as u32;
        let heading_log2 = self.heading.raised(state.gain_log2);
        gains.heading.shift = self.heading.own.shift - heading_log2 as u32;
        gains.most_turn = most_turn(gains.heading.shift);
    }

    /// Whether an update can have left these numbers.
    pub(super) fn is_sound(&self, state: &ScheduleState, gains: &Gains) -> bool {
        let most = self.tilt.raised(self.first_gain_log2);
        let largest = self.tilt.own.factor << (positive(most - self.tilt_shift_room) & 31);
        let heading_log2 = self.heading.raised(self.first_gain_log2);
        let least_shift = self.heading.own.shift - heading_log2 as u32;
        let is_limited = gains.acc_limit == self.acc_limit;
        let fits = gains.tilt.factor <= MAX_FACTOR.into()
            || (is_limited && !gains.is_settled() && gains.tilt.factor <= largest);
        (0..=self.first_gain_log2).contains(&state.gain_log2)
            && (1..=self.first_drop).contains(&state.next_drop)
            && gains.tilt.factor >= 0
            && fits
            && (MIN_TILT_SHIFT..=31).contains(&gains.tilt.shift)
            && (least_shift..=self.heading.own.shift).contains(&gains.heading.shift)
            && gains.heading.factor == self.heading.own.factor
            && gains.most_turn == most_turn(gains.heading.shift)
            && (is_limited || gains.acc_limit == 0)
            && gains.settled <= 1
    }
}

impl ScheduleState {
    fn drop_after(&mut self, blocks: u32) {
        self.drop_at = self.blocks.wrapping_add(blocks + 1);
    }

    /// No block is over yet.
    pub(super) fn is_first_block(&self) -> bool {
        self.blocks == 0
    }
}

/// See [`Gains::most_turn`].
fn most_turn(heading_shift: u32) -> i32 {
    (EIGHTH << (heading_shift & 31)).min(MAX_HEADING_TURN)
}

/// Doublings of a gain up to a first gain.
fn doublings(gain: f32) -> i32 {
    let mut log2 = 0;
    let mut gain = gain;
    while gain < 1.0 / f32::from(1u8 << (FIRST_GAIN_LOG2 + 1)) {
        gain *= 2.0;
        log2 += 1;
    }
    log2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_gain_is_taken() {
        let largest = 575.0 / 65_536.0;
        let schedule =
            Schedule::new((largest, 0.01), (1_024.0, 1_024.0), 5, 0.0).expect("in range");
        assert_eq!(schedule.tilt_shift_room, 0);
        let error = Schedule::new((1.01 * largest, 0.01), (1_024.0, 1_024.0), 5, 0.0)
            .expect_err("too large");
        assert_eq!(error, ConfigError::OutOfRange("tilt gain"));
    }

    #[test]
    fn gains_fall_to_the_filters_own_as_those_of_a_running_mean() {
        // Own gains of 1/512 and 1/1024 are 2^6 and 2^7 times less than the first gain, 1/8. Blocks
        // have 32 samples.
        let schedule = Schedule::new((1.0 / 512.0, 1.0 / 1_024.0), (1_024.0, 1_024.0), 5, 0.0)
            .expect("in range");
        let (mut state, mut gains) = schedule.start();
        let mut tilt_gain = || {
            schedule.next_block(&mut state, &mut gains);
            let own = schedule.tilt.own.factor as f32 / (1 << schedule.tilt.own.shift) as f32;
            let gain = gains.tilt.factor as f32 / (1 << gains.tilt.shift) as f32;
            (gain / own / 512.0, gains.settled)
        };
        let first = 1.0 / 8.0;
        for (blocks, expected) in
            [(2, first), (2, first / 16.0), (4, first / 32.0), (8, first / 64.0)]
        {
            for _ in 0..blocks {
                assert_eq!(tilt_gain(), (expected, 0));
            }
        }
        assert_eq!(tilt_gain(), (1.0 / 512.0, 1));
    }
}
