//! Rest and gyroscope offset in counts: see [`crate::RestConfig`].
//!
//! The six axes close their blocks one after the other: no sample pays for more than one of them.

use super::estimator::Scale;
use super::nearest_log2;
use super::rotation::BIAS_BITS;
use crate::error::{ConfigError, in_range};
use crate::rest::{BLOCK_S, RestConfig};

/// Bits that the offset has beyond `BIAS_BITS` while it is learned.
const FINER_BITS: u32 = 7;

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct Axis {
    /// Mean over the block that the others are compared with, counts.
    reference: i32,
    /// Mean over the newest block, counts with `BIAS_BITS`. The offset learns from it when the next block
    /// is at rest too: a motion may have begun in it.
    newest: i32,
    /// Offset with `FINER_BITS` more: what a small share of a block adds is not lost.
    offset: i32,
}

/// Sums over the block under way, which are touched with every sample, and what is when a block ends.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Rest {
    /// The block under way is no rest.
    pub(super) moved: bool,
    /// Blocks that make a rest, and how many of them are still to come.
    needed: u8,
    missing: u8,
    memory: u8,
    tick: u32,
    /// Samples of a block less one: a power of two less one.
    mask: u32,
    /// Sums of the gyroscope's axes and the accelerometer's, counts.
    sums: [i32; 6],
    /// A block's sum of an axis holds two to this.
    shift: u32,
    /// Blocks that the offset stands on, and the share of the next as a power of two.
    blocks: u32,
    learned: u32,
    rate_limit: i32,
    acc_limit: i32,
    most_bias: i32,
    axes: [Axis; 6],
}

/// The first samples of a block have something to do: six close the axes, the seventh concludes, and this one has the
/// estimator's own job.
pub(super) const SETTLE: u32 = 7;

/// No job, and no judgement either.
pub(super) const NOTHING: u32 = u32::MAX;

/// Limits in counts, times in samples.
pub(super) struct Limits {
    rate: i32,
    acc: i32,
    most_bias: i32,
    /// Two to this many samples make a block.
    log2_block: u8,
    /// Blocks that make a rest.
    needed: u8,
    /// Two to this many blocks are what the offset is averaged over.
    log2_memory: u8,
}

/// Two to this many samples make a block.
#[inline(always)]
pub(super) fn log2_block(period_s: f32) -> u8 {
    nearest_log2(BLOCK_S / period_s).clamp(4, 12)
}

impl Limits {
    #[inline(always)]
    pub(super) fn new(
        config: &RestConfig,
        scale: &Scale,
        period_s: f32,
    ) -> Result<Self, ConfigError> {
        in_range(config.rate_rad_s, 0.0, 1.0, "rest.rate_rad_s")?;
        in_range(config.acc_m_s2, 0.01, 100.0, "rest.acc_m_s2")?;
        in_range(config.time_s, 0.1, 20.0, "rest.time_s")?;
        in_range(config.max_bias_rad_s, 0.001, 0.5, "rest.max_bias_rad_s")?;
        in_range(config.tau_s, 0.25, 1e4, "rest.tau_s")?;
        let log2_block = log2_block(period_s);
        let blocks = |time_s: f32| time_s / (period_s * f32::from(1u16 << log2_block));
        Ok(Self {
            rate: (config.rate_rad_s / scale.gyr_rad_s) as i32,
            acc: (config.acc_m_s2 / scale.acc_m_s2) as i32,
            most_bias: (config.max_bias_rad_s / scale.gyr_rad_s) as i32,
            log2_block,
            needed: (blocks(config.time_s) + 0.5) as u8,
            log2_memory: nearest_log2(blocks(config.tau_s)).min(7),
        })
    }
}

impl Rest {
    pub(super) fn new(limits: &Limits) -> Self {
        Self {
            moved: true,
            needed: limits.needed,
            missing: limits.needed,
            memory: limits.log2_memory,
            tick: SETTLE - 1,
            mask: (1 << limits.log2_block) - 1,
            sums: [0; 6],
            shift: limits.log2_block.into(),
            blocks: 0,
            learned: 0,
            rate_limit: limits.rate,
            acc_limit: limits.acc,
            most_bias: limits.most_bias,
            axes: [Axis::default(); 6],
        }
    }

    /// One sample; which job of a block is due.
    #[inline(always)]
    pub(super) fn add(&mut self, gyr: &[i16; 3], acc: &[i32; 3]) -> u32 {
        let [gx, gy, gz, ax, ay, az] = &mut self.sums;
        *gx += i32::from(gyr[0]);
        *gy += i32::from(gyr[1]);
        *gz += i32::from(gyr[2]);
        *ax += acc[0];
        *ay += acc[1];
        *az += acc[2];
        self.pass()
    }

    /// A sample that is not added.
    #[inline(always)]
    pub(super) fn pass(&mut self) -> u32 {
        self.tick = self.tick.wrapping_add(1);
        self.tick & self.mask
    }

    /// Samples so far, modulo 2^32.
    pub(super) fn tick(&self) -> u32 {
        self.tick
    }

    /// Two to this many samples make a block.
    pub(super) fn log2_block(&self) -> u8 {
        self.mask.count_ones() as u8
    }

    pub(super) fn is_at_rest(&self) -> bool {
        self.missing == 0
    }

    /// Close the block of an axis, or conclude.
    #[inline(never)]
    pub(super) fn close(&mut self, due: u32, bias: &mut [i32; 3]) {
        let due = due as usize;
        let (Some(sum), Some(axis)) = (self.sums.get_mut(due), self.axes.get_mut(due)) else {
            self.conclude();
            return;
        };
        let mean = *sum >> (self.shift & 31);
        // Wraps where the body turns; then it is not used.
        let newest = (*sum << BIAS_BITS) >> (self.shift & 31);
        *sum = 0;
        let before = core::mem::replace(&mut axis.newest, newest);
        let apart = (mean - axis.reference).abs();
        let mut limit = self.acc_limit;
        if due < 3 {
            limit = self.rate_limit;
            // No offset is as large: a motion.
            self.moved |= mean.abs() > self.most_bias;
        }
        if apart > limit {
            axis.reference = mean;
            self.moved = true;
        } else if self.missing == 0
            && let Some(bias) = bias.get_mut(due)
        {
            axis.offset += ((before << FINER_BITS) - axis.offset) >> (self.learned & 31);
            *bias = (axis.offset + (1 << (FINER_BITS - 1))) >> FINER_BITS;
        }
    }

    fn conclude(&mut self) {
        if self.moved {
            self.missing = self.needed;
        } else if self.missing != 0 {
            self.missing -= 1;
        } else {
            if self.blocks == 0 {
                // Once an offset is known, what passes for rest is held to a quarter of the limit.
                self.rate_limit >>= 2;
            }
            self.blocks += 1;
            if self.blocks >> (self.learned & 31) != 0 && self.learned < self.memory.into() {
                self.learned += 1;
            }
        }
        self.moved = false;
    }
}
