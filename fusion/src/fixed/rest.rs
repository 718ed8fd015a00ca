//! Rest and gyroscope offset in counts: see [`crate::RestConfig`].
//!
//! # The method
//! The gyroscope's three axes and the accelerometer's are summed over blocks of about a quarter of
//! a second. A block whose means are near those of the reference block is still; enough of them in
//! a row are rest. The mean of each still block, but the newest, moves the offset: the k-th by 1/k
//! of the difference, with k rounded up to a power of two, until that is the memory. The first
//! offset is made of the last blocks that show the rest, up to four, so that a slow motion in one
//! has little weight; it is used once they do, from that moment on. Of a later rest those blocks
//! are not learned: a body that was laid down comes to rest slowly.
//!
//! # The work
//! A block has `2^shift` samples, so that its means are shifts. Its work is spread over the first
//! samples of the next, so that none pays for more than one job: see [`START_UP`].
//!
//! # The formats
//! - Sums: at most `2^12` samples of `2^15` counts. The mean in Q9 needs 9 bits more than 32 have
//!   where a rate is far from zero; it wraps then, and is not used, as such a mean is a motion.
//! - The offset is learned in Q16, where the smallest share, `2^-7`, of a bit of Q9 is not lost,
//!   and rounded to Q9 for the integration.
//! - The integration multiplies the offset in Q9 by a half angle per count below `2^15`, and below
//!   what leaves room for the largest offset.

use super::counts::Scale;
use super::format::{Q9, Q16, nearest_log2};
use super::memory::all;
use super::rotation::BIAS_BITS;
use crate::error::{ConfigError, in_range};
use crate::quality::BiasState;
use crate::rest::{BLOCK_S, RestConfig};

/// Bits that the offset has beyond `BIAS_BITS` while it is learned, and the largest memory: `2^7`
/// blocks.
const FINER_BITS: u32 = 7;

/// One axis of a sensor.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct Axis {
    /// Mean over the block that the others are compared with, counts.
    reference: i32,
    /// Mean over the newest block, counts. The offset learns from it when the next block is still
    /// too: a motion may have begun in it.
    newest: Q9,
    /// Offset of the axis, counts; no more than a part of one before the first rest.
    offset: Q16,
}

impl Axis {
    /// The offset, rounded.
    fn bias(&self) -> Q9 {
        (self.offset + (1 << (FINER_BITS - 1))) >> FINER_BITS
    }
}

/// The rest detection. First the sums of the block under way, which every sample touches, then what
/// a block's end needs.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Rest {
    /// The block under way is not still.
    pub(super) moved: bool,
    /// Its rate is beyond what an offset can be.
    is_fast: bool,
    /// Blocks in a row that would be a rest but for that, up to `needed`.
    refused: u8,
    /// Still blocks in a row that make a rest.
    needed: u8,
    /// How many of them are still to come.
    missing: u8,
    /// The offset learns from the last blocks that show a rest, so many: 0 once it is known.
    early: u8,
    /// Largest `learned`.
    memory: u8,
    /// Number of the newest sample, modulo 2^32.
    tick: u32,
    /// Samples of a block less one: a power of two less one.
    mask: u32,
    /// Sums of the gyroscope's axes and the accelerometer's, counts.
    sums: [i32; 6],
    /// Right shift from an axis' sum over a block to its mean.
    shift: u32,
    /// Blocks that the offset stands on.
    blocks: u32,
    /// The share of the next block in the offset, as a negative power of two.
    learned: u32,
    /// Largest deviation of a block's mean rate from the reference, counts.
    rate_limit: i32,
    /// The same of the acceleration.
    acc_limit: i32,
    /// Mean rates beyond this are motion, counts.
    max_bias: i32,
    axes: [Axis; 6],
}

/// Work is spread over a block: samples 0 to 5 close one axis each, 6 decides on rest, and 7 (this)
/// updates the start-up gains, which is the estimator's job.
pub(super) const START_UP: u32 = 7;

/// Neither one of these jobs nor one of the compass.
pub(super) const NO_JOB: u32 = u32::MAX;

/// Limits in counts, times in samples.
pub(super) struct Limits {
    rate: i32,
    acc: i32,
    pub(super) max_bias: i32,
    /// Base-2 logarithm of the samples of a block.
    log2_block: u8,
    /// Still blocks that make a rest, at least two.
    needed: u8,
    /// Base-2 logarithm of the blocks that the offset is averaged over.
    log2_memory: u8,
}

/// Base-2 logarithm of the samples of a block.
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
            max_bias: (config.max_bias_rad_s / scale.gyr_rad_s) as i32,
            log2_block,
            needed: ((blocks(config.time_s) + 0.5) as u8).max(2),
            log2_memory: nearest_log2(blocks(config.tau_s)).min(7),
        })
    }
}

impl Rest {
    pub(super) fn new(limits: &Limits) -> Self {
        Self {
            moved: true,
            is_fast: false,
            refused: 0,
            needed: limits.needed,
            missing: limits.needed,
            // The first of them follows a motion.
            early: (limits.needed - 1).min(3),
            memory: limits.log2_memory,
            // The first sample sets the gains.
            tick: START_UP - 1,
            mask: (1 << limits.log2_block) - 1,
            sums: [0; 6],
            shift: limits.log2_block.into(),
            blocks: 0,
            learned: 0,
            rate_limit: limits.rate,
            acc_limit: limits.acc,
            max_bias: limits.max_bias,
            axes: [Axis::default(); 6],
        }
    }

    /// See [`Estimator::memory`](super::Estimator::memory).
    #[inline(never)]
    pub(super) fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        let flags = each(i32::from(self.moved) | i32::from(self.is_fast) << 1);
        (self.moved, self.is_fast) = (flags & 1 != 0, flags & 2 != 0);
        self.refused = each(self.refused.into()) as u8;
        self.missing = each(self.missing.into()) as u8;
        self.early = each(self.early.into()) as u8;
        self.tick = each(self.tick as i32) as u32;
        all(&mut self.sums, each);
        self.blocks = each(self.blocks as i32) as u32;
        self.learned = each(self.learned as i32) as u32;
        self.rate_limit = each(self.rate_limit);
        for axis in &mut self.axes {
            axis.reference = each(axis.reference);
            axis.newest = each(axis.newest);
            axis.offset = each(axis.offset);
        }
    }

    /// One sample; the number of the job that is due.
    #[inline(always)]
    pub(super) fn add(&mut self, gyr: &[i16; 3], acc: &[i16; 3]) -> u32 {
        let [gx, gy, gz, ax, ay, az] = &mut self.sums;
        *gx += i32::from(gyr[0]);
        *gy += i32::from(gyr[1]);
        *gz += i32::from(gyr[2]);
        *ax += i32::from(acc[0]);
        *ay += i32::from(acc[1]);
        *az += i32::from(acc[2]);
        self.tick = self.tick.wrapping_add(1);
        self.tick & self.mask
    }

    /// Whether a sample with this number is one of the last block's length.
    pub(super) fn is_recent(&self, tick: u32) -> bool {
        self.tick.wrapping_sub(tick) <= self.mask
    }

    /// Samples so far, modulo 2^32.
    pub(super) fn tick(&self) -> u32 {
        self.tick
    }

    pub(super) fn is_at_rest(&self) -> bool {
        self.missing == 0
    }

    /// What is known of the offset.
    pub(super) fn bias_state(&self) -> BiasState {
        if self.refused >= self.needed {
            BiasState::Refused
        } else if self.missing == 0 || self.early == 0 {
            BiasState::Known
        } else {
            BiasState::Unknown
        }
    }

    /// Close the block of the axis with the number of the job, or decide on rest.
    #[inline(never)]
    pub(super) fn close(&mut self, job: u32, bias: &mut [Q9; 3]) {
        let job = job as usize;
        let (Some(sum), Some(axis)) = (self.sums.get_mut(job), self.axes.get_mut(job)) else {
            self.decide(bias);
            return;
        };
        let mean = *sum >> (self.shift & 31);
        let newest = (*sum << BIAS_BITS) >> (self.shift & 31);
        *sum = 0;
        let before = core::mem::replace(&mut axis.newest, newest);
        let apart = (mean - axis.reference).abs();
        let mut limit = self.acc_limit;
        if job < 3 {
            limit = self.rate_limit;
            self.is_fast |= mean.abs() > self.max_bias;
        }
        if apart > limit {
            axis.reference = mean;
            self.moved = true;
            return;
        }
        let Some(bias) = bias.get_mut(job) else {
            return;
        };
        if self.missing > self.early {
            return;
        }
        axis.offset += ((before << FINER_BITS) - axis.offset) >> (self.learned & 31);
        if self.missing == 0 {
            *bias = axis.bias();
        }
    }

    /// The block was still or not: what that makes of the rest, and of the share of the next block.
    fn decide(&mut self, bias: &mut [Q9; 3]) {
        let learns = self.missing <= self.early;
        self.refused = if self.is_fast && !self.moved {
            (self.refused + 1).min(self.needed)
        } else {
            0
        };
        if self.moved || self.is_fast {
            self.missing = self.needed;
            if self.early != 0 {
                (self.blocks, self.learned) = (0, 0);
            }
        } else {
            if self.missing != 0 {
                self.missing -= 1;
                if self.missing == 0 && self.early != 0 {
                    for (bias, axis) in bias.iter_mut().zip(&self.axes) {
                        *bias = axis.bias();
                    }
                }
            } else if self.early != 0 {
                // Once an offset is known, the limit for rest is a quarter of what it was.
                self.rate_limit >>= 2;
                self.early = 0;
            }
            if learns {
                self.blocks += 1;
                if self.blocks >> (self.learned & 31) != 0 && self.learned < self.memory.into() {
                    self.learned += 1;
                }
            }
        }
        (self.moved, self.is_fast) = (false, false);
    }
}
