//! The gyroscope's offset, found while the body moves.
//!
//! A body that starts in motion shows no rest to learn the offset from. But an offset `b` tilts the
//! estimate, and the accelerometer shows the tilt in the mean. With the visible tilt error `d`,
//! north and east in the earth frame, the sum `c` of the corrections so far, the subtracted offset
//! `b0` and the rotation matrix `R`,
//!
//! ```text
//! y = d - c + sum R b0 dt      the tilt error, were nothing corrected and no offset taken off
//! S = sum R dt                 its first two rows: 2 x 3
//! dy/dt = R b                  so that means over blocks of time differ by
//! y' - y = (S' - S) b + noise
//! ```
//!
//! for any filter. Each pair of blocks is an observation for a Kalman filter whose state is the
//! offset. The offset's part along the vertical is invisible, but as the body turns, every part
//! shows in time. The method resembles VQF's motion offset (Laidig and Seel, 2022), but does not
//! depend on the filter's own dynamics.

use core::mem::take;

use crate::config::GRAVITY;
use crate::filter::View;
use crate::quaternion::HalfRows;
use crate::real::Real;
use crate::rest::RestConfig;
use crate::vector::{Matrix, add, add_scaled, diagonal, difference, dot, observe, scaled};

/// Time between two sums, s: without an FPU a sum costs as much as a step.
const SUM_S: f32 = 0.035;

/// Length of a block, s: in a longer one a motion's accelerations have a smaller mean.
const BLOCK_S: f32 = 2.0;

/// Number of independent accelerations in a block.
const INDEPENDENT: f32 = 2.0;

/// Deviation of an unknown offset, rad/s.
const UNKNOWN: f32 = 0.05;

/// Largest difference between seen and expected tilt that the offset can cause, rad.
const MOST: f32 = 0.3;

/// Sums of the tilt about an axis, north or east, or their means.
#[derive(Clone, Copy, Debug, Default)]
struct Tilt<T> {
    /// `y`, rad.
    tilt: T,
    /// `d`, rad.
    seen: T,
    /// A row of `S`, s.
    turned: [T; 3],
}

/// The sums over a block, about both axes.
#[derive(Clone, Copy, Debug, Default)]
struct Block<T> {
    tilts: [Tilt<T>; 2],
    /// `d^2` of both, rad^2.
    seen2: T,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct MotionBias<T> {
    /// Largest possible offset, rad/s.
    max_bias: T,
    /// Variance of the tilt that the mean of a block without accelerations shows, rad^2.
    noise: T,
    /// Since the last sum: time, s; the sum of corrections (half a rotation vector, body frame);
    /// the sum of half the accelerations, north and east, m/s^2; the number of accelerations.
    time_s: T,
    corrected: [T; 3],
    half_acc: [T; 2],
    samples: u16,
    /// Sums since the start, without the visible tilt.
    total: [Tilt<T>; 2],
    /// The block under way, with the number of its sums and its time, s.
    block: Block<T>,
    sums: T,
    block_s: T,
    /// Means over the block before.
    before: Option<Block<T>>,
    /// Covariance of the offset, (rad/s)^2.
    covariance: Matrix<T>,
}

impl<T: Real> MotionBias<T> {
    /// As configured; `None` if only a rest shows the offset.
    pub(crate) fn new(config: &RestConfig) -> Option<Self> {
        let tilt = config.motion_tilt_rad;
        (tilt.is_finite() && config.rate_rad_s > 0.0).then(|| Self {
            max_bias: T::from_f32(config.max_bias_rad_s),
            noise: T::from_f32(tilt * tilt),
            covariance: diagonal(T::from_f32(UNKNOWN * UNKNOWN)),
            ..Self::default()
        })
    }

    /// The attitude has changed without a correction, so earlier tilts do not compare.
    pub(crate) fn interrupt(&mut self) {
        *self = Self {
            max_bias: self.max_bias,
            noise: self.noise,
            covariance: self.covariance,
            ..Self::default()
        };
    }

    /// Variance of the offset, (rad/s)^2: the mean of its axes.
    pub(crate) fn variance(&self) -> T {
        let [x, y, z] = &self.covariance;
        (x[0] + y[1] + z[2]) * T::from_f32(1.0 / 3.0)
    }

    /// One step, and its correction, half a rotation vector in the body frame. True if the step
    /// corrected the offset.
    #[inline(never)]
    pub(crate) fn step(&mut self, view: &View<T>, correction: &[T; 3], bias: &mut [T; 3]) -> bool {
        let rows = &view.rows;
        self.time_s += view.dt;
        if let Some(acc) = &view.acc {
            for (sum, half_row) in self.half_acc.iter_mut().zip([&rows.north, &rows.east]) {
                *sum += dot(half_row, acc);
            }
            self.samples += 1;
        }
        let is_due = !self.time_s.within(T::from_f32(SUM_S)) && self.samples > 0;
        let corrects = is_due && self.sum_up(rows, bias);
        add(&mut self.corrected, correction);
        corrects
    }

    /// Adds up the samples since the last sum. True if that corrected the offset.
    #[cold]
    fn sum_up(&mut self, rows: &HalfRows<T>, bias: &mut [T; 3]) -> bool {
        let dt = take(&mut self.time_s);
        let axes = [&rows.north, &rows.east].map(|row| scaled(row, T::ONE + T::ONE));
        let corrected = take(&mut self.corrected);
        let samples = take(&mut self.samples);
        let per_half_g = T::from_f32(0.5 * GRAVITY * f32::from(samples)).recip();
        let [north, east] = take(&mut self.half_acc).map(|half| half * per_half_g);
        // A tilt about north shows as an acceleration to the east.
        let seen = axes.iter().zip([east, -north]);
        let sums = self.total.iter_mut().zip(&mut self.block.tilts);
        for ((total, block), (axis, seen)) in sums.zip(seen) {
            // Twice, as the correction is half a rotation vector.
            let corrected = dot(axis, &corrected) * (T::ONE + T::ONE);
            total.tilt = total.tilt + dot(axis, bias) * dt - corrected;
            add_scaled(&mut total.turned, axis, dt);
            block.tilt = block.tilt + total.tilt + seen;
            add(&mut block.turned, &total.turned);
            block.seen += seen;
            self.block.seen2 += seen * seen;
        }
        self.sums += T::ONE;
        self.block_s += dt;
        let is_over = !self.block_s.within(T::from_f32(BLOCK_S));
        is_over && self.close(bias)
    }

    /// Compares the block's means with the means of the block before.
    fn close(&mut self, bias: &mut [T; 3]) -> bool {
        self.block_s = T::ZERO;
        let k = take(&mut self.sums).recip();
        let Block { tilts, seen2 } = take(&mut self.block);
        let now = Block {
            tilts: tilts.map(|sum| Tilt {
                tilt: sum.tilt * k,
                seen: sum.seen * k,
                turned: scaled(&sum.turned, k),
            }),
            seen2: seen2 * k,
        };
        let Some(before) = self.before.replace(now) else {
            return false;
        };
        let noise = self.noise_of(&now) + self.noise_of(&before);
        for (now, before) in now.tilts.iter().zip(&before.tilts) {
            let row = difference(&now.turned, &before.turned);
            self.observe(&row, now.tilt - before.tilt, noise, bias);
        }
        true
    }

    /// Variance of the tilt that a block's means show about either axis, rad^2. The part of
    /// accelerations is their variance within the block.
    fn noise_of(&self, means: &Block<T>) -> T {
        let [north, east] = means.tilts.map(|tilt| tilt.seen);
        let varying = means.seen2 - north * north - east * east;
        self.noise + varying * T::from_f32(0.5 / INDEPENDENT)
    }

    /// `seen = row b`, with a noise of this variance.
    fn observe(&mut self, row: &[T; 3], seen: T, noise: T, bias: &mut [T; 3]) {
        let left = seen - dot(row, bias);
        if left.within(T::from_f32(MOST)) {
            observe((bias, &mut self.covariance), row, left, noise);
            *bias = bias.map(|axis| axis.limited(self.max_bias));
        }
    }
}
