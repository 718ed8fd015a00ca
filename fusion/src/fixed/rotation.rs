//! The orientation in 32 bits, and its integration.
//!
//! The quaternion is kept in Q30 and cut to Q15 wherever it is a factor, so that every product is of two
//! 16-bit numbers and fits 32 bits: one cycle each, where a 32 x 32 -> 64 multiplication would be a library
//! call of 78. Nothing is lost by it: rotation increments are Q31, what their rounding to 2^-16 leaves is
//! carried into the next step, and the rounding of the factors only scales an increment by 1e-5.
//!
//! Both kinds of state carry an offset of half a bit of what they are cut to, so that cutting rounds.

/// Half a bit of Q15 in Q30, and of 2^-16 in Q31.
const HALF: i32 = 1 << 14;

/// One in Q30.
const ONE: i32 = 1 << 30;

/// A unit quaternion, body to earth, and what it needs to be turned on.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Rotation {
    /// w, x, y, z in Q30, plus `HALF`.
    q: [i32; 4],
    /// Half rotation vector still to be applied, Q31 rad, plus `HALF`: remainders and corrections.
    pub(super) pending: [i32; 3],
    /// Offset of the gyroscope, counts with `BIAS_BITS`.
    pub(super) bias: [i32; 3],
    /// Squared norm less one, Q30.
    excess: i32,
    /// A sixth of the squared half angle of the last step, Q16.
    sixth: i32,
}

/// Products of the quaternion's components, Q30: what the rotation matrix is made of.
pub(super) struct Products {
    /// `w w - 1/2`
    base: i32,
    xx: i32,
    yy: i32,
    zz: i32,
    wx: i32,
    wy: i32,
    wz: i32,
    xy: i32,
    xz: i32,
    yz: i32,
}

impl Products {
    /// North in the body frame, Q15.
    #[inline(always)]
    pub(super) fn north(&self) -> [i32; 3] {
        [
            (self.base + self.xx) >> 14,
            (self.xy - self.wz) >> 14,
            (self.xz + self.wy) >> 14,
        ]
    }

    /// East in the body frame, Q15.
    #[inline(always)]
    pub(super) fn east(&self) -> [i32; 3] {
        [
            (self.xy + self.wz) >> 14,
            (self.base + self.yy) >> 14,
            (self.yz - self.wx) >> 14,
        ]
    }

    /// Down in the body frame, Q15.
    #[inline(always)]
    pub(super) fn down(&self) -> [i32; 3] {
        [
            (self.xz - self.wy) >> 14,
            (self.yz + self.wx) >> 14,
            (self.base + self.zz) >> 14,
        ]
    }
}

/// How far a count of the gyroscope turns in this step.
#[derive(Clone, Copy)]
pub(super) struct Step {
    /// Half angle per count, Q31 with `cut` more bits; below 2^15.
    pub(super) per_count: i32,
    pub(super) cut: u32,
}

/// Fractional bits of the gyroscope's offset in counts.
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

    /// At the start, level: upside down, on the same side as the accelerometer, from where any attitude is found.
    pub(super) fn turn_over(&mut self) {
        self.q.swap(0, 1);
    }

    /// w, x, y, z in Q30.
    pub(super) fn q30(&self) -> [i32; 4] {
        self.q.map(|c| c - HALF)
    }

    /// Turn by the counts of a step, less the offset, and by what is pending.
    ///
    /// With `s = |h|^2`, the rotation by half angle `h` is `(1 - s/2 + s^2/24, h (1 - s/6))`; the factor of `h`
    /// is that of the step before: it changes slowly. In terms of the shortened `h` and its `s`, the first is
    /// `1 - s/2 - s^2/8`.
    #[inline(never)]
    pub(super) fn turn(&mut self, gyr: &[i16; 3], step: Step) {
        let per_count = step.per_count - ((step.per_count * self.sixth) >> 16);
        let sum = |rate: i16, bias: i32, pending: i32| {
            let offset = (bias * per_count) >> BIAS_BITS;
            ((i32::from(rate) * per_count - offset) >> (step.cut & 15)) + pending
        };
        let ([rx, ry, rz], [bx, by, bz], [px, py, pz]) = (*gyr, self.bias, self.pending);
        let [sx, sy, sz] = [sum(rx, bx, px), sum(ry, by, py), sum(rz, bz, pz)];
        let carry = |sum: i32| sum & (2 * HALF - 1);
        self.pending = [carry(sx), carry(sy), carry(sz)];
        let [hx, hy, hz] = [sx >> 15, sy >> 15, sz >> 15];

        // Cut by two bits, so that the sum of the squares fits: s in Q28, then Q16.
        let (ux, uy, uz) = (hx >> 2, hy >> 2, hz >> 2);
        let s = (ux * ux + uy * uy + uz * uz) >> 12;
        self.sixth = (s * 10_923) >> 16;
        let c = (s >> 1) + ((s * s) >> 19) + (self.excess >> 16);

        let [qw, qx, qy, qz] = self.q;
        let (w, x, y, z) = (qw >> 15, qx >> 15, qy >> 15, qz >> 15);
        // Q15 times 2^-16 is Q31.
        self.q = [
            qw - ((w * c + x * hx + y * hy + z * hz) >> 1),
            qx + ((w * hx - x * c + y * hz - z * hy) >> 1),
            qy + ((w * hy - x * hz - y * c + z * hx) >> 1),
            qz + ((w * hz + x * hy - y * hx - z * c) >> 1),
        ];
    }

    /// The products of the components. Their squares show the excess of the norm, half of which is taken
    /// away with the next step.
    #[inline(always)]
    pub(super) fn products(&mut self) -> Products {
        let [w, x, y, z] = self.q.map(|c| c >> 15);
        let (base, xx, yy, zz) = (w * w - ONE / 2, x * x, y * y, z * z);
        self.excess = base + xx + yy + zz - ONE / 2;
        Products {
            base,
            xx,
            yy,
            zz,
            wx: w * x,
            wy: w * y,
            wz: w * z,
            xy: x * y,
            xz: x * z,
            yz: y * z,
        }
    }
}

/// Scalar product of a Q15 row and counts.
#[inline(always)]
pub(super) fn dot(row: &[i32; 3], v: &[i32; 3]) -> i32 {
    row[0] * v[0] + row[1] * v[1] + row[2] * v[2]
}
