//! The tilt corrections: [`Mahony`] and [`Vqf`].
//!
//! # The error
//! With the rows `n`, `e`, `d` of the rotation matrix (Q15) and the specific force `a` (counts),
//! which is `-g d` at rest, the tilt error times `g` is `d x a` in the body frame, and
//! `(-e a, n a)` about north and east in the earth frame. Both are Q15 counts, at most
//! `2^15 * 2^15 sqrt(3) < 2^31`.
//!
//! # The gain
//! [`Gain`] takes such an error to half an angle in Q31. It is cut by 11 bits first, so that a
//! factor of 11 to 12 bits has room; for a gain of `k` per sample,
//!
//! ```text
//! factor / 2^shift = k 2^30 / (2^15 per_g / 2^11) = k 2^26 / per_g
//! ```
//!
//! # Mahony
//! `c = k d x a / (2 g)`: three products.
//!
//! # VQF
//! The error is smoothed where gravity stands still, in the earth frame: `z' = (error - z) / T`,
//! `c = k z`. Nothing of it may be lost, as the corrections of a slow filter are smaller than the
//! last bits:
//!
//! - `z` is Q8 (25 bits with sign). The difference is cut to Q1, rounded, and multiplied by the
//!   share `period / T` in Q16, at most `2^13`: Q17, of which 9 bits are kept for the next sample
//!   and the others added to `z`.
//! - The correction about north and east is added up in Q31. Its upper bits, Q18, are taken into
//!   the body frame with rows in Q15; that is Q33, cut by two bits. The lower 13 bits are kept for
//!   the next step.
//! - While the gains are those of a running mean, that is smooth enough: the error is taken as it
//!   is, and `z` stays 0.

use super::format::{Q8, Q15, Q16, Q31};
use super::memory::all;
use super::rotation::{Products, dot};
use crate::error::{ConfigError, in_range, positive};
use crate::mahony::MahonyGains;
use crate::vqf::VqfGains;

/// Gain of the tilt correction: from an error in Q15 counts to half an angle in Q31.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// What the error, cut by 11 bits, is multiplied by.
    pub(super) factor: i32,
    /// Right shift of the product.
    pub(super) shift: u32,
}

impl Gain {
    #[inline(always)]
    fn of(self, error: i32) -> Q31 {
        ((error >> 11) * self.factor) >> (self.shift & 31)
    }
}

/// A filter in fixed point: how the accelerometer becomes a correction.
pub trait Filter: Sized {
    /// Its gains, the same as of the float filter.
    type Gains: Copy;

    /// Build the coefficients for a sampling period.
    ///
    /// # Errors
    /// A gain out of range, or one that does not exist in fixed point, by name.
    fn new(gains: &Self::Gains, period_s: f32) -> Result<Self, ConfigError>;

    /// Rates, 1/s, at which tilt and heading follow.
    fn rates(gains: &Self::Gains) -> (f32, f32);

    /// The tilt correction, half a rotation vector in the body frame, Q31 rad.
    #[doc(hidden)]
    fn tilt(&mut self, view: &View<'_>, gain: Gain) -> [Q31; 3];

    /// See [`Estimator::memory`](super::Estimator::memory).
    #[doc(hidden)]
    fn memory(&mut self, _: &mut impl FnMut(i32) -> i32) {}
}

/// The estimate and the accelerometer, as a filter sees them.
pub struct View<'a> {
    /// The orientation after the step.
    pub(super) products: &'a Products,
    /// Down in the body frame.
    pub(super) down: &'a [Q15; 3],
    /// Specific force, counts.
    pub(super) acc: &'a [i32; 3],
    /// The gains are those of a running mean, larger than the filter's own.
    pub(super) running_mean: bool,
}

/// Mahony's filter: see [`crate::Mahony`].
#[derive(Clone, Debug)]
pub struct Mahony;

impl Filter for Mahony {
    type Gains = MahonyGains;

    fn new(gains: &MahonyGains, _: f32) -> Result<Self, ConfigError> {
        in_range(gains.integral_per_s2, 0.0, 0.0, "integral_per_s2")?;
        Ok(Self)
    }

    fn rates(gains: &MahonyGains) -> (f32, f32) {
        (gains.acc_per_s, gains.mag_per_s)
    }

    #[inline(always)]
    fn tilt(&mut self, view: &View<'_>, gain: Gain) -> [Q31; 3] {
        let (d, a) = (view.down, view.acc);
        [
            gain.of(d[1] * a[2] - d[2] * a[1]),
            gain.of(d[2] * a[0] - d[0] * a[2]),
            gain.of(d[0] * a[1] - d[1] * a[0]),
        ]
    }
}

/// The VQF-class filter: see [`crate::Vqf`].
#[derive(Clone, Debug)]
pub struct Vqf {
    /// Share of a sample in the smoothing.
    share: Q16,
    /// Smoothed horizontal acceleration, north and east, counts.
    smooth: [Q8; 2],
    /// Remainder of the smoothing, Q17 counts, below a bit of `smooth`.
    remainder: [i32; 2],
    /// Half angle about north and east that is still to be applied.
    carry: [Q31; 2],
}

impl Filter for Vqf {
    type Gains = VqfGains;

    #[inline(always)]
    fn new(gains: &VqfGains, period_s: f32) -> Result<Self, ConfigError> {
        positive(gains.acc_tau_s, "acc_tau_s")?;
        in_range(
            gains.acc_smoothing_s,
            8.0 * period_s,
            100.0,
            "acc_smoothing_s",
        )?;
        positive(gains.mag_tau_s, "mag_tau_s")?;
        Ok(Self {
            share: (65_536.0 * period_s / gains.acc_smoothing_s + 0.5) as i32,
            smooth: [0; 2],
            remainder: [0; 2],
            carry: [0; 2],
        })
    }

    fn rates(gains: &VqfGains) -> (f32, f32) {
        (1.0 / gains.acc_tau_s, 1.0 / gains.mag_tau_s)
    }

    fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        all(&mut self.smooth, each);
        all(&mut self.remainder, each);
        all(&mut self.carry, each);
    }

    #[inline(always)]
    fn tilt(&mut self, view: &View<'_>, gain: Gain) -> [Q31; 3] {
        let (north, east) = (view.products.north(), view.products.east());
        let seen = [dot(&north, view.acc) >> 7, dot(&east, view.acc) >> 7];
        let state = self.smooth.iter_mut().zip(&mut self.remainder);
        for ((smooth, remainder), seen) in state.zip(seen) {
            let sum = ((seen - *smooth + 64) >> 7) * self.share + *remainder;
            *smooth += sum >> 9;
            *remainder = sum & 0x1ff;
        }
        let [n, e] = if view.running_mean {
            self.smooth = [0; 2];
            seen
        } else {
            self.smooth
        };
        for (carry, tilt) in self.carry.iter_mut().zip([-e, n]) {
            *carry += gain.of(tilt << 7);
        }
        let [about_north, about_east] = self.carry.map(|carry| carry >> 13);
        self.carry = self.carry.map(|carry| carry & 0x1fff);
        let body = |n: i32, e: i32| (about_north * n + about_east * e) >> 2;
        [
            body(north[0], east[0]),
            body(north[1], east[1]),
            body(north[2], east[2]),
        ]
    }
}
