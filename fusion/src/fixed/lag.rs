//! Sensors that show an earlier attitude than the gyroscope: see [`crate::Config::mag_lag_s`].
//!
//! # The equations
//! A vector `v` that stands still in the earth frame and was seen a lag ago is now, at the rate
//! `w`,
//!
//! ```text
//! u = lag w                               the turn since, body frame
//! v + v x u + (v x u) x u / 2
//! ```
//!
//! and the estimate is ahead of the rates by `q = q (1 - |h|^2 / 2, h)` with `h = lag w / 2`.
//!
//! # The number formats
//! - The lag is Q20 s, at most [`LONGEST_S`], which is below `2^17`.
//! - A count's turn in `2^17` of these units has 13 to 14 bits, so its product with a lag fits. The
//!   product's upper bits, a factor below `2^14`, times rates of 17 bits are below `2^31`.
//! - The turn is Q15 rad, limited to an eighth of a radian an axis: 900 deg/s at 8 ms. So a vector
//!   of 16 bits stays below `2^16` a component, and its products with a turn below `2^28`. Its
//!   length is within `1.03 2^15 sqrt(3)`, so its products with rows in Q15 stay below `2^31`.

use super::format::{Q9, Q15, Q30, normalised};
use super::rotation::{BIAS_BITS, cross};

/// Largest turn within a lag, about an axis: an eighth of a radian.
const MOST: Q15 = 1 << 12;

/// The turn up to which first order is enough, rad: its error is 6e-4 of the vector.
const SHORT: Q15 = 655;

/// Base-2 logarithm of the unit of a lag, in Q20 s.
const UNIT_BITS: u32 = 17;

/// An eighth of a second: longer than any lag.
const UNIT_S: f32 = 0.125;

/// A lag, as the turn of a gyroscope's count in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lag {
    /// Q(15 + `shift`) rad, below `2^14`.
    factor: i32,
    shift: u32,
}

impl Lag {
    /// An eighth of a second, where a count is worth `gyr_rad_s`.
    #[inline(always)]
    pub(super) fn unit(gyr_rad_s: f32) -> Self {
        let (factor, shift) = normalised(gyr_rad_s * UNIT_S * 32_768.0, 16_384.0);
        Self { factor, shift }
    }

    /// Of this as the unit, a lag, s.
    #[inline(always)]
    pub(super) fn times(self, lag_s: f32) -> Self {
        Self {
            factor: ((lag_s * 1_048_576.0) as i32 * self.factor + (1 << (UNIT_BITS - 1)))
                >> UNIT_BITS,
            ..self
        }
    }

    #[inline(always)]
    fn turn(self, rates: &[i32; 3]) -> [Q15; 3] {
        rates.map(|rate| {
            let turn = (rate * self.factor + ((1 << (self.shift & 31)) >> 1)) >> (self.shift & 31);
            turn.clamp(-MOST, MOST)
        })
    }

    /// The present value of a vector that was `v` a lag ago, at these rates.
    #[inline(never)]
    pub(super) fn now(self, v: &[i32; 3], rates: &[i32; 3]) -> [i32; 3] {
        let turn = self.turn(rates);
        let [x, y, z] = cross(v, &turn);
        let round = |q15: i32| (q15 + (1 << 14)) >> 15;
        let mut now = [v[0] + round(x), v[1] + round(y), v[2] + round(z)];
        if turn.iter().any(|turn| turn.abs() > SHORT) {
            let second = cross(&[x, y, z].map(round), &turn);
            for (now, second) in now.iter_mut().zip(second) {
                *now += (second + (1 << 15)) >> 16;
            }
        }
        now
    }

    /// The orientation a lag after this one, at these rates.
    #[inline(never)]
    pub(super) fn ahead(self, q: [Q30; 4], rates: &[i32; 3]) -> [Q30; 4] {
        // Half the turn in Q16.
        let [hx, hy, hz] = self.turn(rates);
        let half_square = (hx * hx + hy * hy + hz * hz) >> 17;
        let [w, x, y, z] = q.map(|part| part >> 15);
        [
            q[0] - ((w * half_square + x * hx + y * hy + z * hz) >> 1),
            q[1] + ((w * hx - x * half_square + y * hz - z * hy) >> 1),
            q[2] + ((w * hy - x * hz - y * half_square + z * hx) >> 1),
            q[3] + ((w * hz + x * hy - y * hx - z * half_square) >> 1),
        ]
    }
}

/// Rates less their offset, counts.
#[inline(always)]
pub(super) fn rates(gyr: &[i16; 3], bias: &[Q9; 3]) -> [i32; 3] {
    let ([x, y, z], [bx, by, bz]) = (*gyr, *bias);
    let rate = |rate: i16, bias: Q9| i32::from(rate) - (bias >> BIAS_BITS);
    [rate(x, bx), rate(y, by), rate(z, bz)]
}
