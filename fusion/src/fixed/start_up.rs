//! The gains of a running mean, with which an estimate begins, or begins anew.
//!
//! # The schedule
//! The gain of a channel (tilt or heading) is the share of its error that one sample takes away. A
//! mean over `n` samples has the gain `1 / n`; the filter's own is smaller. Here every gain is the
//! filter's own times a power of two:
//!
//! ```text
//! gain = own gain * 2^max(gain_log2 - subtract, 0)
//! ```
//!
//! `gain_log2` begins where the slower channel has a first gain from 1/8 up to 1/4; `subtract` is
//! what the other channel, whose own gain is larger, needs less for that, and 0 for the slower one.
//! At least 64 samples, and at least a block, have the first gain: that turns the estimate from any
//! attitude to the one that is seen. A mean over `2^6` samples then has the gain `2^-6`, so
//! `gain_log2` drops by `6 - 2` at once, and after that by 1 whenever the number of samples has
//! doubled, until it is 0. Time is counted in the blocks of [`Rest`](super::rest::Rest), which have
//! a power of two of samples.
//!
//! # The formats
//! The tilt gain is a factor and a right shift ([`Gain`]): `2^k` times the gain is `k` less in the
//! shift. The product with the error of any acceleration must fit 31 bits, and what it is shifted
//! to must stay below a quarter of a radian. With the error `|d x a| <= 2^15 * 2^15 sqrt(3)` (Q15
//! and counts), cut by 11 bits:
//!
//! ```text
//! factor <= 2^31 / (2^19 sqrt(3)) = 2364        MAX_FACTOR
//! 2^31 / 2^MIN_TILT_SHIFT = 2^29                a quarter of a radian in Q31
//! ```
//!
//! So the shift never falls below 2. What is then still missing to `2^k` multiplies the factor
//! instead, and the acceleration is limited to 1.9 g (sum of the components' sizes) meanwhile: with
//! the largest first gain `2^-2 * 2^26 / per_g * 2^MIN_TILT_SHIFT = 2^26 / per_g`, the product is
//! at most `2^26 * 1.9 * 2^4 < 2^31`.
//!
//! The heading gain is a factor below `2^13` and a shift too; there the limits of the correction
//! bound the product.

use super::filters::Gain;
use super::format::{normalised, positive};
use crate::error::{ConfigError, in_range};

/// Largest factor of the tilt gain: its product with any acceleration fits 31 bits.
const MAX_FACTOR: u16 = 2_300;

/// Least right shift of a tilt correction: it stays below a quarter of a radian.
const MIN_TILT_SHIFT: u8 = 2;

/// The first gain is from half of this negative power of two up to it: from 1/8 up to 1/4.
const FIRST_GAIN_LOG2: u8 = 2;

/// Base-2 logarithm of the fewest samples that have it.
const FIRST_SAMPLES_LOG2: u8 = 6;

/// Base-2 logarithm of the gain increase beyond which a filter that normalises accelerations has
/// them limited, too: not for the room of a product, but so that it begins as the others do.
const NORMALISED_ROOM: i32 = 2;

/// Largest sum of the sizes of an acceleration's components, g, while the factor is beyond
/// [`MAX_FACTOR`]. Gravity alone has at most 1.73, in whatever direction.
const ACC_LIMIT_G: f32 = 1.9;

/// The gains of a step.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Gains {
    /// Gain of the tilt correction.
    pub(super) tilt: Gain,
    /// Factor of the heading gain, Q(15 + `heading_shift`), below `2^13`.
    pub(super) heading: i32,
    /// Right shift that brings a product with `heading` back.
    pub(super) heading_shift: u32,
    /// Largest sum of the sizes of an acceleration's components, counts, while the tilt factor is
    /// beyond [`MAX_FACTOR`]; else 0. A larger acceleration is ignored.
    pub(super) acc_limit: i32,
    /// The gains are the filter's own.
    pub(super) settled: bool,
}

/// The schedule of the gains.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct StartUpGains {
    /// Blocks of samples so far.
    pub(super) blocks: u32,
    /// Blocks that have the first gain.
    pub(super) first_blocks: u32,
    /// Number of blocks after which the gain drops next.
    drop_at: u32,
    /// Blocks from that drop to the one after it.
    drop_interval: u32,
    /// Base-2 logarithm of the gain increase of the slower channel.
    pub(super) gain_log2: i32,
    /// What to subtract from `gain_log2` for the tilt.
    tilt_subtract: i32,
    /// What to subtract from `gain_log2` for the heading.
    heading_subtract: i32,
    /// By how much `gain_log2` drops next.
    next_drop: i32,
    /// Factor of the filter's own tilt gain.
    tilt_factor: i32,
    /// Right shift of the filter's own tilt gain.
    tilt_shift: u32,
    /// By how much the tilt's shift may be lessened.
    tilt_shift_room: i32,
    /// By how much the tilt's gain may be doubled before accelerations are limited.
    limit_room: i32,
    /// Right shift of the filter's own heading gain.
    heading_shift: u32,
    /// What [`Gains::acc_limit`] is while there is a limit.
    acc_limit: i32,
    /// `gain_log2` at the start.
    first_gain_log2: i32,
    /// `next_drop` at the start.
    first_drop: i32,
}

impl StartUpGains {
    /// The schedule, and the gains until its first block, which correct nothing. `tilt` and
    /// `heading` are the filter's own gains per sample, `per_g` the counts of standard gravity, and
    /// `counts` those of the tilt error of a right angle.
    #[inline(always)]
    pub(super) fn new(
        tilt: f32,
        heading: f32,
        per_g: f32,
        counts: f32,
        log2_block: u8,
    ) -> Result<(Self, Gains), ConfigError> {
        // An error of 1 is 2^15 counts / 2^11, and half an angle of 1/2 is 2^30 in Q31.
        let tilt_gain = tilt * 67_108_864.0 / counts;
        let max_gain = f32::from(MAX_FACTOR) / f32::from(1u8 << MIN_TILT_SHIFT);
        in_range(tilt_gain, 0.01, max_gain, "tilt gain")?;
        let (tilt_factor, tilt_shift) = normalised(tilt_gain, f32::from(MAX_FACTOR));
        in_range(heading, 1e-5, 0.1, "heading gain")?;
        let (heading_factor, heading_shift) = normalised(heading * 32_768.0, 8_192.0);
        let (tilt_log2, heading_log2) = (doublings(tilt), doublings(heading));
        let gain_log2 = tilt_log2.max(heading_log2);
        let first_samples_log2 = FIRST_SAMPLES_LOG2.max(log2_block);
        let first_blocks = 1 << (first_samples_log2 - log2_block);
        let first_drop = i32::from(first_samples_log2 - FIRST_GAIN_LOG2);
        let acc_limit = (ACC_LIMIT_G * per_g) as i32;
        let tilt_shift_room = tilt_shift.saturating_sub(MIN_TILT_SHIFT).into();
        let limit_room = if counts == per_g {
            tilt_shift_room
        } else {
            NORMALISED_ROOM.min(tilt_shift_room)
        };
        let start_up = Self {
            blocks: 0,
            first_blocks,
            drop_at: first_blocks + 1,
            drop_interval: first_blocks,
            gain_log2: gain_log2.into(),
            tilt_subtract: (gain_log2 - tilt_log2).into(),
            heading_subtract: (gain_log2 - heading_log2).into(),
            next_drop: first_drop,
            tilt_factor,
            tilt_shift: tilt_shift.into(),
            tilt_shift_room,
            limit_room,
            heading_shift: heading_shift.into(),
            acc_limit,
            first_gain_log2: gain_log2.into(),
            first_drop,
        };
        let gains = Gains {
            tilt: Gain {
                factor: 0,
                shift: MIN_TILT_SHIFT.into(),
            },
            heading: heading_factor,
            heading_shift: heading_shift.into(),
            acc_limit,
            settled: false,
        };
        Ok((start_up, gains))
    }

    /// See [`Estimator::memory`](super::Estimator::memory).
    #[inline(never)]
    pub(super) fn memory(&mut self, gains: &mut Gains, each: &mut impl FnMut(i32) -> i32) {
        self.blocks = each(self.blocks as i32) as u32;
        self.drop_at = each(self.drop_at as i32) as u32;
        self.drop_interval = each(self.drop_interval as i32) as u32;
        self.gain_log2 = each(self.gain_log2);
        self.next_drop = each(self.next_drop);
        gains.tilt.factor = each(gains.tilt.factor);
        gains.tilt.shift = each(gains.tilt.shift as i32) as u32;
        gains.heading_shift = each(gains.heading_shift as i32) as u32;
        gains.acc_limit = each(gains.acc_limit);
        gains.settled = each(gains.settled.into()) != 0;
    }

    /// Samples were missing: the schedule begins anew with the next block.
    pub(super) fn restart(&mut self) {
        self.gain_log2 = self.first_gain_log2;
        self.next_drop = self.first_drop;
        self.drop_interval = self.first_blocks;
        self.drop_at = self.blocks + self.drop_interval + 1;
    }

    /// The attitude has become uncertain: from the next block on a gain `2^gain_log2` times the
    /// filter's own for so many blocks, half of it for twice as many, and so on.
    #[cold]
    pub(super) fn raise(&mut self, gain_log2: i32, blocks: u32) {
        self.gain_log2 = gain_log2.min(self.first_gain_log2);
        self.next_drop = 1;
        self.drop_interval = 2 * blocks;
        self.drop_at = self.blocks + blocks + 1;
    }

    /// Base-2 logarithm of the gain increase of the tilt.
    pub(super) fn tilt_raised(&self) -> u32 {
        positive(self.gain_log2 - self.tilt_subtract).unsigned_abs()
    }

    /// The same of the heading.
    pub(super) fn heading_raised(&self) -> u32 {
        positive(self.gain_log2 - self.heading_subtract).unsigned_abs()
    }

    /// The next gains may come with a limit for accelerations: it holds from now on.
    #[inline(always)]
    pub(super) fn limit_acc(&self, gains: &mut Gains) {
        gains.acc_limit = self.acc_limit;
    }

    /// Once a block: the gains of the next.
    #[inline(never)]
    pub(super) fn next_block(&mut self, gains: &mut Gains) {
        self.blocks += 1;
        if self.blocks == self.drop_at {
            self.gain_log2 = positive(self.gain_log2 - self.next_drop);
            self.next_drop = 1;
            self.drop_at += self.drop_interval;
            self.drop_interval <<= 1;
        }
        gains.settled = self.gain_log2 == 0;
        let tilt_log2 = positive(self.gain_log2 - self.tilt_subtract);
        // What the shift has no room for goes into the factor.
        let excess = positive(tilt_log2 - self.tilt_shift_room);
        // The limit beyond its room, 0 within it: all bits of the mask or none.
        gains.acc_limit = self.acc_limit & ((self.limit_room - tilt_log2) >> 31);
        gains.tilt.factor = self.tilt_factor << (excess & 31);
        gains.tilt.shift = self.tilt_shift - (tilt_log2 - excess) as u32;
        gains.heading_shift =
            self.heading_shift - positive(self.gain_log2 - self.heading_subtract) as u32;
    }
}

/// How often a gain is doubled until it is a first gain.
fn doublings(gain: f32) -> u8 {
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
        let (start_up, _) =
            StartUpGains::new(largest, 0.01, 1_024.0, 1_024.0, 5).expect("in range");
        assert_eq!(start_up.tilt_shift_room, 0);
        let error =
            StartUpGains::new(1.01 * largest, 0.01, 1_024.0, 1_024.0, 5).expect_err("too large");
        assert_eq!(error, ConfigError::OutOfRange("tilt gain"));
    }

    #[test]
    fn gains_fall_to_the_filters_own_as_those_of_a_running_mean() {
        // Own gains: 1/512 and 1/1024, so 2^6 and 2^7 times less than the first, 1/8. Blocks of 32
        // samples.
        let (mut start_up, mut gains) =
            StartUpGains::new(1.0 / 512.0, 1.0 / 1_024.0, 1_024.0, 1_024.0, 5).expect("in range");
        let mut tilt_gain = || {
            start_up.next_block(&mut gains);
            let own = start_up.tilt_factor as f32 / (1 << start_up.tilt_shift) as f32;
            let gain = gains.tilt.factor as f32 / (1 << gains.tilt.shift) as f32;
            (gain / own / 512.0, gains.settled)
        };
        let first = 1.0 / 8.0;
        for (blocks, expected) in [
            (2, first),
            (2, first / 16.0),
            (4, first / 32.0),
            (8, first / 64.0),
        ] {
            for _ in 0..blocks {
                assert_eq!(tilt_gain(), (expected, false));
            }
        }
        assert_eq!(tilt_gain(), (1.0 / 512.0, true));
    }
}
