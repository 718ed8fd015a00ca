//! Rest and gyroscope offset in counts: see [`crate::RestConfig`].
//!
//! # The method
//! The axes of gyroscope and accelerometer are summed over blocks of about a quarter of a second. A
//! block whose means are near the reference block's is still; enough still blocks in a row are
//! rest. The mean of each still block, except the newest, moves the offset: the k-th by 1/k of the
//! difference. `k` is rounded up to a power of two and bounded by the memory.
//!
//! The first offset comes from the last blocks that show the rest, up to four, so that a slow
//! motion in one block has little weight. It counts from the moment of the rest on. In a later
//! rest, the offset does not learn from those blocks: a body that is laid down comes to rest
//! slowly.
//!
//! # The work
//! A block has `2^shift` samples, so its means are shifts. The first samples of the next block
//! share its work, one job each: see [`START_UP`].
//!
//! # The formats
//! - Sums: at most `2^12` samples of `2^15` counts. The mean in Q9 of a rate far from zero needs
//!   more than 32 bits and wraps. Such a mean is a motion and is not used.
//! - The offset is learned in Q16, which keeps the smallest share, `2^-7`, of a bit of Q9. The
//!   integration takes it rounded to Q9.
//! - The integration multiplies the offset in Q9 by a half angle per count below `2^15`, and small
//!   enough for the largest offset.

use bytemuck::{Pod, Zeroable};

use super::counts::Scale;
use super::format::{Q9, Q16, are_within, nearest_log2};
use super::rotation::BIAS_BITS;
use crate::error::{ConfigError, in_range};
use crate::quality::BiasState;
use crate::rest::{BLOCK_S, RestConfig};

/// Bits of a learned offset beyond `BIAS_BITS`, and the longest memory: `2^7` blocks.
const FINER_BITS: u32 = 7;

/// Most samples of a block, as a power of two.
const MOST_LOG2: u8 = 12;

/// The job that updates the start-up gains, which is the estimator's. Samples 0 to 5 of a block
/// close one axis each, and sample 6 decides on rest.
pub(super) const START_UP: u32 = 7;

/// The job that looks after the vertical, which is the estimator's, too.
pub(super) const VERTICAL: u32 = START_UP + 1;

/// No job.
pub(super) const NO_JOB: u32 = u32::MAX;

/// The rest detection: limits in counts, times in blocks.
#[derive(Clone, Debug, PartialEq)]
#[repr(C)]
pub(super) struct Rest {
    /// Samples of a block less one: a power of two less one.
    mask: u32,
    /// Right shift from an axis' sum over a block to its mean.
    pub(super) shift: u32,
    /// Largest deviation of a block's mean rate from the reference, counts; a quarter of it for a
    /// known offset.
    rate_limit: i32,
    /// Largest deviation of a block's mean acceleration from the reference, counts.
    acc_limit: i32,
    /// Mean rates beyond this are motion, counts.
    pub(super) max_bias: i32,
    /// Still blocks in a row that make a rest, at least two.
    needed: u32,
    /// Number of last still blocks that make the first offset.
    early: u32,
    /// Largest `learned`.
    most_learned: u32,
}

/// Memory of the rest detection. The sums of the block under way, which every sample touches, come
/// first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RestState {
    /// The block under way is not still: 1, else 0.
    moved: u32,
    /// Its rate is too large for an offset: 1, else 0.
    is_fast: u32,
    /// Number of the newest sample, modulo 2^32.
    tick: u32,
    /// Sums of the gyroscope's axes and the accelerometer's, counts.
    sums: [i32; 6],
    /// Still blocks in a row whose rate is too large for an offset, up to `needed`.
    refused: u32,
    /// Still blocks missing for a rest.
    missing: u32,
    /// Number of last blocks of a rest that teach the offset; 0 for a known offset.
    early: u32,
    /// Blocks in the offset's mean.
    blocks: u32,
    /// The share of the next block in the offset, as a negative power of two.
    learned: u32,
    axes: [Axis; 6],
}

/// One axis of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Axis {
    /// Mean over the reference block, counts.
    reference: i32,
    /// Mean rate over the newest block, counts. The offset learns from it if the next block is
    /// still too: a motion may have begun in it.
    newest: Q9,
    /// Offset of the axis, counts; partly learned until the first rest is complete.
    offset: Q16,
}

impl Axis {
    /// The offset, rounded.
    fn bias(&self) -> Q9 {
        (self.offset + (1 << (FINER_BITS - 1))) >> FINER_BITS
    }
}

/// Base-2 logarithm of the samples of a block.
#[inline(always)]
pub(super) fn log2_block(period_s: f32) -> u8 {
    nearest_log2(BLOCK_S / period_s).clamp(4, MOST_LOG2)
}

impl Rest {
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
        let needed = ((blocks(config.time_s) + 0.5) as u8).max(2);
        Ok(Self {
            mask: (1 << log2_block) - 1,
            shift: log2_block.into(),
            rate_limit: (config.rate_rad_s / scale.gyr_rad_s) as i32,
            acc_limit: (config.acc_m_s2 / scale.acc_m_s2) as i32,
            max_bias: (config.max_bias_rad_s / scale.gyr_rad_s) as i32,
            needed: needed.into(),
            // The first still block follows a motion.
            early: (needed - 1).min(3).into(),
            most_learned: nearest_log2(blocks(config.tau_s)).min(7).into(),
        })
    }

    pub(super) fn start(&self) -> RestState {
        RestState {
            moved: 1,
            missing: self.needed,
            early: self.early,
            // The first sample sets the gains.
            tick: START_UP - 1,
            ..RestState::zeroed()
        }
    }

    /// One sample; the number of the job that is due.
    #[inline(always)]
    pub(super) fn add(&self, state: &mut RestState, gyr: &[i16; 3], acc: &[i16; 3]) -> u32 {
        let [gx, gy, gz, ax, ay, az] = &mut state.sums;
        *gx += i32::from(gyr[0]);
        *gy += i32::from(gyr[1]);
        *gz += i32::from(gyr[2]);
        *ax += i32::from(acc[0]);
        *ay += i32::from(acc[1]);
        *az += i32::from(acc[2]);
        state.tick = state.tick.wrapping_add(1);
        state.tick & self.mask
    }

    /// Whether a sample with this number is one of the last block's length.
    pub(super) fn is_recent(&self, state: &RestState, tick: u32) -> bool {
        state.tick.wrapping_sub(tick) <= self.mask
    }

    /// State of the offset.
    pub(super) fn bias_state(&self, state: &RestState) -> BiasState {
        let is_known = state.missing == 0 || state.early == 0;
        BiasState::new(state.refused >= self.needed, is_known)
    }

    /// Close the block of the axis with the number of the job, or decide on rest.
    #[inline(never)]
    pub(super) fn close(&self, state: &mut RestState, job: u32, bias: &mut [Q9; 3]) {
        let job = job as usize;
        let (Some(sum), Some(axis)) = (state.sums.get_mut(job), state.axes.get_mut(job)) else {
            self.decide(state, bias);
            return;
        };
        let sum = core::mem::take(sum);
        let mean = sum >> (self.shift & 31);
        let apart = (mean - axis.reference).abs();
        let (mut limit, mut before) = (self.acc_limit, 0);
        if job < 3 {
            let newest = (sum << BIAS_BITS) >> (self.shift & 31);
            before = core::mem::replace(&mut axis.newest, newest);
            limit = self.rate_limit;
            if state.early == 0 {
                limit >>= 2;
            }
            state.is_fast |= u32::from(mean.abs() > self.max_bias);
        }
        if apart > limit {
            axis.reference = mean;
            state.moved = 1;
            return;
        }
        let Some(bias) = bias.get_mut(job) else {
            return;
        };
        if state.missing > state.early {
            return;
        }
        axis.offset += ((before << FINER_BITS) - axis.offset) >> (state.learned & 31);
        if state.missing == 0 {
            *bias = axis.bias();
        }
    }

    /// Decides on the rest, and on the share of the next block in the offset.
    fn decide(&self, state: &mut RestState, bias: &mut [Q9; 3]) {
        let learns = state.missing <= state.early;
        let (moved, is_fast) = (state.moved != 0, state.is_fast != 0);
        state.refused = if is_fast && !moved { (state.refused + 1).min(self.needed) } else { 0 };
        if moved || is_fast {
            state.missing = self.needed;
            if state.early != 0 {
                (state.blocks, state.learned) = (0, 0);
            }
        } else {
            if state.missing != 0 {
                state.missing -= 1;
                if state.missing == 0 && state.early != 0 {
                    for (bias, axis) in bias.iter_mut().zip(&state.axes) {
                        *bias = axis.bias();
                    }
                }
            } else {
                // The offset is known.
                state.early = 0;
            }
            if learns {
                state.blocks = state.blocks.wrapping_add(1);
                if state.blocks >> (state.learned & 31) != 0 && state.learned < self.most_learned {
                    state.learned += 1;
                }
            }
        }
        (state.moved, state.is_fast) = (0, 0);
    }

    /// Whether an update can have left these numbers.
    pub(super) fn is_sound(&self, state: &RestState) -> bool {
        let references = state.axes.map(|axis| axis.reference);
        // Means that teach the offset, now or if the block under way is still.
        let learns = state.missing <= state.early + 1 && state.moved | state.is_fast == 0;
        state.refused <= self.needed
            && state.missing <= self.needed
            && state.early <= self.early
            && state.learned <= self.most_learned
            && are_within(&state.sums, (self.mask as i32 + 1) << 15)
            && are_within(&references, 1 << 15)
            && state.axes.iter().take(3).all(|axis| {
                let newest = if learns { axis.newest } else { 0 };
                let means = [axis.offset >> FINER_BITS, newest];
                are_within(&means.map(|mean| mean >> BIAS_BITS), self.max_bias)
            })
    }
}

impl RestState {
    /// Samples so far, modulo 2^32.
    pub(super) fn tick(&self) -> u32 {
        self.tick
    }

    /// Means of the last block, within what rest allows: rates and accelerations, counts.
    #[inline(always)]
    pub(super) fn means(&self) -> [[i32; 3]; 2] {
        let [gx, gy, gz, ax, ay, az] = self.axes.map(|axis| axis.reference);
        [[gx, gy, gz], [ax, ay, az]]
    }

    pub(super) fn is_at_rest(&self) -> bool {
        self.missing == 0
    }

    /// Discards the rest under way.
    pub(super) fn interrupt(&mut self) {
        self.moved = 1;
    }
}
