//! The corrections: [`Mahony`] and [`Vqf`].

use super::rotation::{Products, dot};
use crate::error::{ConfigError, in_range, positive};
use crate::mahony::MahonyGains;
use crate::vqf::VqfGains;

/// Gain of the tilt correction: share of the error per sample, for a cross product of a Q15 row and counts
/// that is cut by 11 bits, to half an angle in Q31.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    pub(super) factor: i32,
    /// Bits by which the product is too large.
    pub(super) cut: u32,
}

impl Gain {
    #[inline(always)]
    fn of(self, error: i32) -> i32 {
        ((error >> 11) * self.factor) >> (self.cut & 31)
    }
}

/// A filter in fixed point: how the accelerometer becomes a correction.
pub trait Filter: Sized {
    /// Its gains, the same as of the float filter.
    type Gains: Copy;

    /// Build the coefficients for a sampling period.
    fn new(gains: &Self::Gains, period_s: f32) -> Result<Self, ConfigError>;

    /// Rates, 1/s, at which tilt and heading follow.
    fn rates(gains: &Self::Gains) -> (f32, f32);

    /// The tilt correction, half a rotation vector in the body frame, Q31 rad.
    #[doc(hidden)]
    fn tilt(&mut self, view: &View<'_>, gain: Gain) -> [i32; 3];
}

/// The estimate and the accelerometer, as a filter sees them.
pub struct View<'a> {
    pub(super) products: &'a Products,
    /// Down in the body frame, Q15.
    pub(super) down: &'a [i32; 3],
    /// Specific force, counts.
    pub(super) acc: &'a [i32; 3],
    /// A running mean is under way.
    pub(super) settling: bool,
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
    fn tilt(&mut self, view: &View<'_>, gain: Gain) -> [i32; 3] {
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
    /// Share of a sample in the smoothing, Q16.
    share: i32,
    /// Smoothed horizontal acceleration, north and east, counts in Q8.
    smooth: [i32; 2],
    /// Remainder of the smoothing, below that.
    rest: [i32; 2],
    /// Remainder of the correction, Q31 half angle about north and east.
    carry: [i32; 2],
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
            rest: [0; 2],
            carry: [0; 2],
        })
    }

    fn rates(gains: &VqfGains) -> (f32, f32) {
        (1.0 / gains.acc_tau_s, 1.0 / gains.mag_tau_s)
    }

    #[inline(always)]
    fn tilt(&mut self, view: &View<'_>, gain: Gain) -> [i32; 3] {
        let (north, east) = (view.products.north(), view.products.east());
        // Counts in Q8: 2^15 counts and three axes make 24 bits.
        let seen = [dot(&north, view.acc) >> 7, dot(&east, view.acc) >> 7];
        for ((smooth, rest), seen) in self.smooth.iter_mut().zip(&mut self.rest).zip(seen) {
            let sum = ((seen - *smooth + 64) >> 7) * self.share + *rest;
            *smooth += sum >> 9;
            *rest = sum & 0x1ff;
        }
        let [n, e] = if view.settling {
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
