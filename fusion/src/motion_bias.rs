//! The gyroscope's offset, found while the body moves.
//!
//! A body that starts in motion has shown no rest to learn the offset from. But an offset `b` tilts
//! the estimate, which the accelerometer shows in the mean. With the tilt error `d` that is seen,
//! north and east in the earth frame, the sum `c` of the corrections so far, the offset `b0` that
//! was taken off and the rotation matrix `R`,
//!
//! ```text
//! y = d - c + sum R b0 dt      the tilt error, were nothing corrected and no offset taken off
//! S = sum R dt                 its first two rows: 2 x 3
//! dy/dt = R b                  so that means over blocks of time differ by
//! y' - y = (S' - S) b + noise
//! ```
//!
//! whatever the filter has made of the accelerations. Each pair of blocks is an observation for a
//! Kalman filter whose state is the offset. A part of the offset along the vertical does not show;
//! as the body turns, every part shows in time. The method is of the class of VQF's motion offset
//! (Laidig and Seel, 2022), without its dependence on the filter's own dynamics.

use crate::config::GRAVITY;
use crate::quaternion::HalfRows;
use crate::real::Real;
use crate::rest::RestConfig;
use crate::vector::{add_scaled, dot, observe, scaled, zero};

/// Time between two accounts, s: without an FPU one costs as much as a step.
const ACCOUNT_S: f32 = 0.035;

/// Length of a block, s: in a longer one a motion's accelerations have a smaller mean.
const BLOCK_S: f32 = 2.0;

/// As many accelerations of a block's are independent of each other.
const INDEPENDENT: f32 = 2.0;

/// Deviation of an offset of which nothing is known, rad/s.
const UNKNOWN: f32 = 0.05;

/// A tilt that differs by more than this from what is expected is not the offset's, rad.
const MOST: f32 = 0.3;

/// What is averaged, about north and about east.
#[derive(Clone, Debug)]
struct Sums<T> {
    /// `y`, rad.
    tilt: [T; 2],
    /// `d^2`, and the `d` that it is the square of, rad.
    seen2: T,
    seen: [T; 2],
    /// Rows of `S`, s.
    turned: [[T; 3]; 2],
}

impl<T: Real> Sums<T> {
    fn none() -> Self {
        Self {
            tilt: [T::ZERO; 2],
            seen2: T::ZERO,
            seen: [T::ZERO; 2],
            turned: [zero(), zero()],
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct MotionBias<T> {
    /// The largest offset that is one, rad/s.
    max_bias: T,
    /// Variance of the tilt that the mean of a block without accelerations shows, rad^2.
    noise: T,
    /// Since the last account: time, s, the sum of corrections (half a rotation vector, body
    /// frame), and of accelerations, half of them, north and east, m/s^2, with the number of those.
    time_s: T,
    corrected: [T; 3],
    half_acc: [T; 2],
    samples: u16,
    /// Since the start: without the error that is seen.
    total: Sums<T>,
    /// Over the block under way, with its accounts and its time, s.
    block: Sums<T>,
    accounts: T,
    block_s: T,
    /// Means over the block before.
    before: Option<Sums<T>>,
    /// Covariance of the offset, (rad/s)^2.
    covariance: [[T; 3]; 3],
}

impl<T: Real> MotionBias<T> {
    /// As the configuration says; `None` where only a rest shows the offset.
    pub(crate) fn new(config: &RestConfig) -> Option<Self> {
        let tilt = config.motion_tilt_rad;
        (tilt.is_finite() && config.rate_rad_s > 0.0)
            .then(|| Self::with(T::from_f32(config.max_bias_rad_s), T::from_f32(tilt * tilt)))
    }

    fn with(max_bias: T, noise: T) -> Self {
        let unknown = T::from_f32(UNKNOWN * UNKNOWN);
        Self {
            max_bias,
            noise,
            time_s: T::ZERO,
            corrected: zero(),
            half_acc: [T::ZERO; 2],
            samples: 0,
            total: Sums::none(),
            block: Sums::none(),
            accounts: T::ZERO,
            block_s: T::ZERO,
            before: None,
            covariance: [
                [unknown, T::ZERO, T::ZERO],
                [T::ZERO, unknown, T::ZERO],
                [T::ZERO, T::ZERO, unknown],
            ],
        }
    }

    /// The attitude has changed by what is no correction: what was seen before it does not compare.
    pub(crate) fn interrupt(&mut self) {
        *self = Self {
            covariance: self.covariance,
            ..Self::with(self.max_bias, self.noise)
        };
    }

    /// Variance of the offset, (rad/s)^2: the mean of its axes.
    pub(crate) fn variance(&self) -> T {
        let [x, y, z] = &self.covariance;
        (x[0] + y[1] + z[2]) * T::from_f32(1.0 / 3.0)
    }

    /// One step: the orientation after it, the acceleration if it shows a vertical, and the
    /// correction that was found, half a rotation vector in the body frame. True where the offset
    /// was corrected.
    #[inline(never)]
    pub(crate) fn step(
        &mut self,
        dt: T,
        rows: &HalfRows<T>,
        acc: Option<&[T; 3]>,
        correction: &[T; 3],
        bias: &mut [T; 3],
    ) -> bool {
        self.time_s += dt;
        if let Some(acc) = acc {
            for (sum, half_row) in self.half_acc.iter_mut().zip([&rows.north, &rows.east]) {
                *sum += dot(half_row, acc);
            }
            self.samples += 1;
        }
        let is_due = !self.time_s.within(T::from_f32(ACCOUNT_S)) && self.samples > 0;
        let corrects = is_due && self.account(rows, bias);
        self.corrected[0] += correction[0];
        self.corrected[1] += correction[1];
        self.corrected[2] += correction[2];
        corrects
    }

    /// Adds up what was seen since the last account. True where the offset was corrected.
    #[cold]
    fn account(&mut self, rows: &HalfRows<T>, bias: &mut [T; 3]) -> bool {
        let dt = core::mem::replace(&mut self.time_s, T::ZERO);
        let twice = |row: &[T; 3]| scaled(row, T::ONE + T::ONE);
        let axes = [twice(&rows.north), twice(&rows.east)];
        let corrected = core::mem::replace(&mut self.corrected, zero());
        let samples = core::mem::take(&mut self.samples);
        let per_half_g = T::from_f32(0.5 * GRAVITY * f32::from(samples)).recip();
        let half_acc = core::mem::replace(&mut self.half_acc, [T::ZERO; 2]);
        let [north, east] = half_acc.map(|half| half * per_half_g);
        // A tilt about north shows as an acceleration to the east.
        let seen = [east, -north];
        let state = self.total.tilt.iter_mut().zip(&mut self.total.turned);
        for ((tilt, turned), axis) in state.zip(&axes) {
            // Twice, as the correction is half a rotation vector.
            *tilt = *tilt + dot(axis, bias) * dt - dot(axis, &corrected) * (T::ONE + T::ONE);
            add_scaled(turned, axis, dt);
        }
        let sums = self.block.tilt.iter_mut().zip(&mut self.block.turned);
        let totals = self.total.tilt.iter().zip(&self.total.turned);
        for (((tilt, turned), (total, total_turned)), seen) in sums.zip(totals).zip(seen) {
            *tilt = *tilt + *total + seen;
            add_scaled(turned, total_turned, T::ONE);
        }
        for (sum, seen) in self.block.seen.iter_mut().zip(seen) {
            *sum += seen;
            self.block.seen2 += seen * seen;
        }
        self.accounts += T::ONE;
        self.block_s += dt;
        if self.block_s.within(T::from_f32(BLOCK_S)) {
            return false;
        }
        self.close(bias)
    }

    /// The block's means against those of the block before.
    fn close(&mut self, bias: &mut [T; 3]) -> bool {
        self.block_s = T::ZERO;
        let per_account = core::mem::replace(&mut self.accounts, T::ZERO).recip();
        let sums = core::mem::replace(&mut self.block, Sums::none());
        let means = Sums {
            tilt: sums.tilt.map(|tilt| tilt * per_account),
            seen2: sums.seen2 * per_account,
            seen: sums.seen.map(|seen| seen * per_account),
            turned: sums.turned.map(|turned| scaled(&turned, per_account)),
        };
        let Some(before) = self.before.replace(means.clone()) else {
            return false;
        };
        let noise = self.noise_of(&means) + self.noise_of(&before);
        let (now, then) = (
            means.tilt.iter().zip(&means.turned),
            before.tilt.iter().zip(&before.turned),
        );
        for ((tilt, turned), (tilt_before, turned_before)) in now.zip(then) {
            let mut row = *turned;
            add_scaled(&mut row, turned_before, -T::ONE);
            self.observe(&row, *tilt - *tilt_before, noise, bias);
        }
        true
    }

    /// Variance of the tilt that a block's means show about either axis, rad^2: what accelerations
    /// make of it is as large as they vary within it.
    fn noise_of(&self, means: &Sums<T>) -> T {
        let [north, east] = means.seen;
        let varying = means.seen2 - north * north - east * east;
        self.noise + varying * T::from_f32(0.5 / INDEPENDENT)
    }

    /// `seen = row b`, with a noise of this variance.
    fn observe(&mut self, row: &[T; 3], seen: T, noise: T, bias: &mut [T; 3]) {
        let left = seen - dot(row, bias);
        if !left.within(T::from_f32(MOST)) {
            return;
        }
        observe((bias, &mut self.covariance), row, left, noise);
        *bias = bias.map(|axis| limited(axis, self.max_bias));
    }
}

fn limited<T: Real>(value: T, limit: T) -> T {
    if value.within(limit) {
        value
    } else if value.is_negative() {
        -limit
    } else {
        limit
    }
}
