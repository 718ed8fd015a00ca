//! The scalar that the float filters run on.

use core::ops::{Add, AddAssign, Mul, Neg, Sub};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// `f32` or `f64`. Every operation is correctly rounded IEEE arithmetic or a `libm` function in pure
/// integer and float operations, so that the same input gives the same bits with and without an FPU.
pub trait Real:
    sealed::Sealed
    + nalgebra::Scalar
    + Copy
    + Default
    + PartialOrd
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// 1/2.
    const HALF: Self;
    /// 1.
    const ONE: Self;

    /// The nearest value to an `f32` (exact).
    fn from_f32(value: f32) -> Self;
    /// The nearest `f32`.
    fn to_f32(self) -> f32;
    /// Square root; of a negative number NaN.
    fn sqrt(self) -> Self;
    /// `1 / self`.
    fn recip(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// `|self| <= limit` for `limit >= 0`, false for NaN. Without an FPU a comparison of bits, ten times
    /// cheaper than a float comparison.
    fn within(self, limit: Self) -> bool;
    /// The sign bit.
    fn is_negative(self) -> bool;
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
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
    #[inline]
    fn sqrt(self) -> Self {
        libm::sqrtf(self)
    }
    #[inline]
    fn recip(self) -> Self {
        1.0 / self
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::from_bits(self.to_bits() & 0x7fff_ffff)
    }
    #[inline(always)]
    fn within(self, limit: Self) -> bool {
        // Bits of non-negative floats are ordered as the floats are, with NaN above infinity.
        self.to_bits() & 0x7fff_ffff <= limit.to_bits()
    }
    #[inline(always)]
    fn is_negative(self) -> bool {
        self.is_sign_negative()
    }
    fn atan2(self, x: Self) -> Self {
        libm::atan2f(self, x)
    }
    fn asin(self) -> Self {
        libm::asinf(self)
    }
    fn sin_cos(self) -> (Self, Self) {
        libm::sincosf(self)
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const HALF: Self = 0.5;
    const ONE: Self = 1.0;

    fn from_f32(value: f32) -> Self {
        Self::from(value)
    }
    fn to_f32(self) -> f32 {
        self as f32
    }
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    fn recip(self) -> Self {
        1.0 / self
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

#[cfg(test)]
mod tests {
    use super::Real;

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
