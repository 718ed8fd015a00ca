//! The scalar of the float filters.

use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

pub(crate) mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// `f32` or `f64`. Every operation is correctly rounded IEEE arithmetic or a `libm` function. The
/// same input gives the same bits with and without an FPU.
pub trait Real:
    sealed::Sealed
    + core::fmt::Debug
    + Copy
    + Default
    + PartialOrd
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// 1/2.
    const HALF: Self;
    /// 1.
    const ONE: Self;

    /// The nearest value to an `f32`.
    fn from_f32(value: f32) -> Self;
    /// Square root; NaN of a negative number.
    fn sqrt(self) -> Self;
    /// `1 / self`.
    #[inline]
    fn recip(self) -> Self {
        Self::ONE / self
    }
    /// Magnitude.
    fn abs(self) -> Self;
    /// `|self| <= limit` for `limit >= 0`, false for NaN. A comparison of bits: without an FPU ten
    /// times cheaper than a float comparison.
    fn within(self, limit: Self) -> bool;
    /// Whether the sign bit is set.
    fn is_negative(self) -> bool;

    /// With the other sign if `negative`.
    #[inline(always)]
    fn negated(self, negative: bool) -> Self {
        if negative { -self } else { self }
    }

    /// Clamped to `-limit..=limit`.
    #[inline(always)]
    fn limited(self, limit: Self) -> Self {
        if self.within(limit) { self } else { limit.negated(self.is_negative()) }
    }

    /// The smaller of two non-negative values; `limit` if `self` is NaN.
    #[inline(always)]
    fn at_most(self, limit: Self) -> Self {
        if self.within(limit) { self } else { limit }
    }
    /// The nearest `f32`.
    fn to_f32(self) -> f32;
    /// In units of `2^-bits`, rounded towards zero and saturated, for sums in integers.
    fn to_fixed(self, bits: u8) -> i32;
    /// Angle of the point `(x, self)`, rad.
    fn atan2(self, x: Self) -> Self;
    /// Arc sine, rad; NaN outside -1..1.
    fn asin(self) -> Self;
    /// Sine and cosine of an angle in rad.
    fn sin_cos(self) -> (Self, Self);
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const HALF: Self = 0.5;
    const ONE: Self = 1.0;

    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        value
    }
    #[inline]
    fn sqrt(self) -> Self {
        libm::sqrtf(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::from_bits(self.to_bits() & 0x7fff_ffff)
    }
    #[inline(always)]
    fn within(self, limit: Self) -> bool {
        // The bits of non-negative floats have the floats' order, with NaN above infinity.
        self.to_bits() & 0x7fff_ffff <= limit.to_bits()
    }
    #[inline(always)]
    fn is_negative(self) -> bool {
        self.is_sign_negative()
    }
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
    #[inline(always)]
    fn to_fixed(self, bits: u8) -> i32 {
        let word = self.to_bits();
        // The value is a 24-bit mantissa times 2^(exponent - 150).
        let mantissa = (word & 0x007f_ffff | 0x0080_0000) as i32;
        let shift = 150 - i32::from(bits) - (word >> 23 & 0xff) as i32;
        let size = match shift {
            0..=31 => mantissa >> shift,
            -7..=-1 => mantissa << -shift,
            32.. => 0,
            _ => i32::MAX,
        };
        if self.is_sign_negative() { -size } else { size }
    }
    fn atan2(self, x: Self) -> Self {
        libm::atan2f(self, x)
    }
    fn asin(self) -> Self {
        // Not `asinf`: it works in double precision.
        libm::atan2f(self, libm::sqrtf((1.0 - self) * (1.0 + self)))
    }
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const HALF: Self = 0.5;
    const ONE: Self = 1.0;

    fn from_f32(value: f32) -> Self {
        Self::from(value)
    }
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    fn abs(self) -> Self {
        libm::fabs(self)
    }
    fn within(self, limit: Self) -> bool {
        libm::fabs(self) <= limit
    }
    fn is_negative(self) -> bool {
        self.is_sign_negative()
    }
    fn to_f32(self) -> f32 {
        self as f32
    }
    fn to_fixed(self, bits: u8) -> i32 {
        (self * Self::from(1u32 << (bits & 31))) as i32
    }
    fn atan2(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
    fn asin(self) -> Self {
        libm::asin(self)
    }
    fn sin_cos(self) -> (Self, Self) {
        libm::sincos(self)
    }
}

/// Sine and cosine in single precision. libm's functions reduce the angle in double precision, 6 KB
/// of code without an FPU. Error 2e-7 up to 1,000 rad, then the angle's own spacing; NaN for NaN
/// and beyond 1e6.
///
/// Multiples of pi/2 bring the angle into a quarter turn about zero. They are subtracted in three
/// parts; the first two have few bits, so their products are exact (Cody and Waite). The
/// polynomials are from Cephes' `sinf`.
fn sin_cos(angle: f32) -> (f32, f32) {
    /// pi / 2 in three parts.
    const PARTS: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
    /// Beyond this, the spacing of floats is coarser than a hundredth of a turn.
    const LARGEST: f32 = 1e6;
    if !angle.within(LARGEST) {
        return (f32::NAN, f32::NAN);
    }
    let turns = angle * core::f32::consts::FRAC_2_PI;
    let quarters = (turns + if turns < 0.0 { -0.5 } else { 0.5 }) as i32;
    let whole = quarters as f32;
    let x = ((angle - whole * PARTS[0]) - whole * PARTS[1]) - whole * PARTS[2];
    let z = x * x;
    let sin = x + x * z * (-0.166_666_55 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let cos = 1.0 - 0.5 * z + z * z * (0.041_666_646 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    match quarters & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::Real;

    #[test]
    fn sine_and_cosine_agree_with_double_precision() {
        for i in -100_000..=100_000i32 {
            let angle = i as f32 * 0.01;
            let (sin, cos) = Real::sin_cos(angle);
            let (exact_sin, exact_cos) = libm::sincos(f64::from(angle));
            let error = (f64::from(sin) - exact_sin).abs().max((f64::from(cos) - exact_cos).abs());
            assert!(error < 2e-7, "{angle}: {error}");
        }
        for angle in [f32::NAN, f32::INFINITY, -1e30] {
            assert!(Real::sin_cos(angle).0.is_nan());
        }
    }

    #[test]
    fn numbers_are_the_same_in_fixed_point() {
        for value in [
            0.0f32, 1e-30, -1e-5, 0.5, -0.75, 3.999_999, -12.7, 1_023.9, 2_047.99, -2_048.0, 1e9,
            -1e30,
        ] {
            let exact = (f64::from(value) * 1_048_576.0).clamp(-2_147_483_647.0, 2_147_483_647.0);
            assert_eq!(value.to_fixed(20), exact as i32, "{value}");
            assert!(f64::from(value).to_fixed(20).abs_diff(exact as i32) <= 1);
        }
    }

    #[test]
    fn within_orders_like_the_float_comparison_and_refuses_nan() {
        for (value, limit, expected) in [
            (1.0f32, 1.0, true),
            (-1.0, 1.0, true),
            (-1.000_000_1, 1.0, false),
            (0.0, 0.0, true),
            (-0.0, 0.0, true),
            (f32::NAN, f32::INFINITY, false),
            (-f32::NAN, f32::MAX, false),
            (f32::INFINITY, f32::MAX, false),
        ] {
            assert_eq!(value.within(limit), expected, "{value} within {limit}");
            assert_eq!(f64::from(value).within(limit.into()), expected);
        }
    }
}
