//! The orientation in 32 bits, and its integration.
//!
//! The quaternion is Q30 and is cut to Q15 as a factor, so that every product is of two 16-bit
//! numbers and fits 32 bits. Such a product takes one cycle; a 32 x 32 -> 64 multiplication would
//! be a library call of 78 cycles. Rotation increments are Q31, and the next step takes the
//! remainder of their rounding to 2^-16. The rounding of the factors only scales an increment by
//! 1e-5.
//!
//! Quaternion and pending rotation carry half a bit of their cut format, so that cutting rounds.
//!
//! # The integration
//! With `s = |h|^2`, the rotation by half angle `h` is `(1 - s/2 + s^2/24, h (1 - s/6))`. The
//! factor `1 - s/6` changes slowly and comes from the step before. With the shortened
//! `h' = h (1 - s/6)` and its `s'`, the first component is `1 - c` with `c = s'/2 + s'^2/8`. So
//!
//! ```text
//! w = w - (w c + x hx + y hy + z hz)
//! x = x + (w hx - x c + y hz - z hy)      and so on
//! ```
//!
//! - `h` is Q31, and Q16 as a factor. For `s` it is cut to Q14, so that three squares, Q28, fit for
//!   components up to 1 rad; `s` is Q16.
//! - `s^2` in Q32 must fit 31 bits: `s < 0.707`, `|h| < 0.84 rad`. The parts of `h` share that. The
//!   rates have a quarter of a radian an axis, 0.43 in all (`Scale::GYR_RAD_S`, `PERIOD_US`). Tilt
//!   and heading, at right angles, have 0.25 and 0.125. The rest, 0.11, is reserve.
//! - The products with the quaternion are Q15 times Q16. Their sums fit because `|q| = 1` and
//!   `c^2 + |h|^2 < 1`.
//!
//! # The norm
//! With `|q|^2 - 1 = e`, the length is off by `e / 2`. A quarter of `e` is added to `c`, which
//! halves the error with every step.

use bytemuck::{Pod, Zeroable};

use super::format::{Q9, Q15, Q16, Q30, Q31};
use super::orientation::Orientation;

/// Half a bit of Q15 in Q30, and of Q16 in Q31.
const HALF: i32 = 1 << 14;

/// One.
const ONE: Q30 = 1 << 30;

/// Largest pending half rotation vector, rad in Q15: the parts of tilt and heading, and a reserve.
const MOST_PENDING: i32 = 13_107;

/// Largest squared norm less one of a rotation.
const MOST_EXCESS: Q30 = 1 << 24;

/// A sixth of the square of the largest half angle, rad^2.
const MOST_SIXTH: Q16 = 7_800;

/// A unit quaternion, body to earth, and the state of its integration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Rotation {
    /// w, x, y, z, plus `HALF`.
    q: [Q30; 4],
    /// Pending half rotation vector, rad, plus `HALF`: remainders and corrections.
    pub(super) pending: [Q31; 3],
    /// Offset of the gyroscope, counts.
    pub(super) bias: [Q9; 3],
    /// Squared norm less one.
    excess: Q30,
    /// A sixth of the squared half angle of the last step, rad^2.
    sixth: Q16,
}

/// Products of the quaternion's components, for the rotation matrix.
pub(super) struct Products {
    /// `w w - 1/2`
    base: Q30,
    xx: Q30,
    yy: Q30,
    zz: Q30,
    wx: Q30,
    wy: Q30,
    wz: Q30,
    xy: Q30,
    xz: Q30,
    yz: Q30,
}

impl Products {
    /// North in the body frame.
    // Twice the sums: 14 bits are cut for Q15.
    #[inline(always)]
    pub(super) fn north(&self) -> [Q15; 3] {
        [(self.base + self.xx) >> 14, (self.xy - self.wz) >> 14, (self.xz + self.wy) >> 14]
    }

    /// East in the body frame.
    #[inline(always)]
    pub(super) fn east(&self) -> [Q15; 3] {
        [(self.xy + self.wz) >> 14, (self.base + self.yy) >> 14, (self.yz - self.wx) >> 14]
    }

    /// Down in the body frame.
    #[inline(always)]
    pub(super) fn down(&self) -> [Q15; 3] {
        [(self.xz - self.wy) >> 14, (self.yz + self.wx) >> 14, (self.base + self.zz) >> 14]
    }
}

/// Turn of a gyroscope's count in this step.
#[derive(Clone, Copy)]
pub(super) struct PerCount {
    /// Half angle, Q(31 + `shift`) rad; below 2^15, and its product with an offset below 2^31.
    pub(super) half_angle: i32,
    /// Right shift that brings its product with counts to Q31.
    pub(super) shift: u32,
}

/// Fractional bits of the gyroscope's offset, counts.
pub(super) const BIAS_BITS: u32 = 9;

impl Rotation {
    pub(super) const fn new() -> Self {
        Self {
            q: [ONE + HALF, HALF, HALF, HALF],
            pending: [HALF; 3],
            bias: [0; 3],
            excess: 0,
            sixth: 0,
        }
    }

    /// Turns the level attitude of the start upside down. An upside-down body is then less than
    /// half a turn away, so that its attitude is found.
    pub(super) fn turn_over(&mut self) {
        self.q.swap(0, 1);
    }

    /// w, x, y, z.
    pub(super) fn q30(&self) -> [Q30; 4] {
        self.q.map(|c| c - HALF)
    }

    /// Whether an update can have left these numbers, with offsets up to this, counts.
    pub(super) fn is_sound(&self, max_bias: i32) -> bool {
        let wxyz_q30 = self.q.map(|c| c.wrapping_sub(HALF));
        let pending = self.pending.map(|part| (part >> 16).unsigned_abs().pow(2));
        Orientation { wxyz_q30 }.is_rotation()
            && pending.iter().sum::<u32>() <= MOST_PENDING.unsigned_abs().pow(2)
            // Rounding adds less than a count to an offset.
            && self.bias.iter().all(|bias| (-max_bias..=max_bias + 1).contains(&(bias >> BIAS_BITS)))
            && (-MOST_EXCESS..=MOST_EXCESS).contains(&self.excess)
            && (0..=MOST_SIXTH).contains(&self.sixth)
    }

    /// Turns by the counts of a step, less the offset, and by the pending rotation.
    #[inline(never)]
    pub(super) fn turn(&mut self, gyr: &[i16; 3], step: PerCount) {
        let per_count = step.half_angle - ((step.half_angle * self.sixth) >> 16);
        let sum = |rate: i16, bias: i32, pending: i32| {
            let offset = (bias * per_count) >> BIAS_BITS;
            ((i32::from(rate) * per_count - offset) >> (step.shift & 15)) + pending
        };
        let ([rx, ry, rz], [bx, by, bz], [px, py, pz]) = (*gyr, self.bias, self.pending);
        let [sx, sy, sz] = [sum(rx, bx, px), sum(ry, by, py), sum(rz, bz, pz)];
        let carry = |sum: i32| sum & (2 * HALF - 1);
        self.pending = [carry(sx), carry(sy), carry(sz)];
        let [hx, hy, hz] = [sx >> 15, sy >> 15, sz >> 15];

        // Q14, so that the sum of the squares fits.
        let (ux, uy, uz) = (hx >> 2, hy >> 2, hz >> 2);
        let s = (ux * ux + uy * uy + uz * uz) >> 12;
        // 2^16 / 6.
        self.sixth = (s * 10_923) >> 16;
        // s/2, s^2/8 from Q32, and a quarter of the excess from Q30.
        let c = (s >> 1) + ((s * s) >> 19) + (self.excess >> 16);

        let [qw, qx, qy, qz] = self.q;
        let (w, x, y, z) = (qw >> 15, qx >> 15, qy >> 15, qz >> 15);
        // Q15 times Q16 is Q31.
        self.q = [
            qw - ((w * c + x * hx + y * hy + z * hz) >> 1),
            qx + ((w * hx - x * c + y * hz - z * hy) >> 1),
            qy + ((w * hy - x * hz - y * c + z * hx) >> 1),
            qz + ((w * hz + x * hy - y * hx - z * c) >> 1),
        ];
    }

    /// The products of the components. Their squares show the excess of the norm, for the next
    /// step.
    #[inline(always)]
    pub(super) fn products(&mut self) -> Products {
        let products = self.present_products();
        let Products { base, xx, yy, zz, .. } = products;
        self.excess = base + xx + yy + zz - ONE / 2;
        products
    }

    /// Down in the body frame.
    #[inline(always)]
    pub(super) fn down(&self) -> [Q15; 3] {
        self.present_products().down()
    }

    #[inline(always)]
    fn present_products(&self) -> Products {
        let [w, x, y, z] = self.q.map(|c| c >> 15);
        Products {
            base: w * w - ONE / 2,
            xx: x * x,
            yy: y * y,
            zz: z * z,
            wx: w * x,
            wy: w * y,
            wz: w * z,
            xy: x * y,
            xz: x * z,
            yz: y * z,
        }
    }
}

/// Vector product: of a row and counts Q15 counts.
#[inline(always)]
pub(super) fn cross(v: &[i32; 3], u: &[i32; 3]) -> [i32; 3] {
    [v[1] * u[2] - v[2] * u[1], v[2] * u[0] - v[0] * u[2], v[0] * u[1] - v[1] * u[0]]
}

/// Scalar product of a row and counts: Q15 counts.
#[inline(always)]
pub(super) fn dot(row: &[Q15; 3], v: &[i32; 3]) -> i32 {
    row[0] * v[0] + row[1] * v[1] + row[2] * v[2]
}
