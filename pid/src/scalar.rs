//! The numbers that controllers run on.

use core::ops::{Add, Mul, Neg, Sub};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for super::Q16 {}
}

/// `f32` or [`Q16`]. No division and no trigonometry: those belong into configuration.
pub trait Scalar:
    sealed::Sealed
    + Copy
    + Default
    + PartialOrd
    + core::fmt::Debug
    + From<f32>
    + Into<f32>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The value or the nearer bound. NaN gives the lower bound, so that it cannot spread.
    #[inline]
    fn clamped(self, low: Self, high: Self) -> Self {
        if self >= high {
            high
        } else if self >= low {
            self
        } else {
            low
        }
    }

    /// Whether a controller can use it: a number, and not so large that a product overflows.
    fn is_usable(self) -> bool;
}

impl Scalar for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;

    #[inline]
    fn is_usable(self) -> bool {
        self.abs() <= 1e30
    }
}

/// Fixed point: 1 sign, 15 integer and 16 fraction bits, -32768 to 32767.99998 in steps of 1.5e-5.
/// Arithmetic saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Q16(i32);

impl Q16 {
    /// Fraction bits.
    pub const FRACTION: u32 = 16;
    /// The largest value.
    pub const MAX: Self = Self(i32::MAX);
    /// The smallest value.
    pub const MIN: Self = Self(i32::MIN);

    /// From the bits: `bits / 65536`.
    pub const fn from_bits(bits: i32) -> Self {
        Self(bits)
    }

    /// The bits.
    pub const fn to_bits(self) -> i32 {
        self.0
    }
}

impl Scalar for Q16 {
    const ZERO: Self = Self(0);
    const ONE: Self = Self(1 << Self::FRACTION);

    #[inline]
    fn is_usable(self) -> bool {
        true
    }
}

impl From<f32> for Q16 {
    /// The nearest value. Beyond the range the nearer bound, for a NaN zero.
    #[inline]
    fn from(value: f32) -> Self {
        // Float to integer conversion saturates and takes NaN to zero.
        let scaled = value * 65536.0;
        Self((scaled + if scaled < 0.0 { -0.5 } else { 0.5 }) as i32)
    }
}

impl From<Q16> for f32 {
    #[inline]
    fn from(value: Q16) -> Self {
        value.0 as f32 / 65536.0
    }
}

impl Add for Q16 {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Sub for Q16 {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

impl Mul for Q16 {
    type Output = Self;
    /// Rounded to nearest.
    #[inline]
    fn mul(self, other: Self) -> Self {
        let product = i64::from(self.0) * i64::from(other.0);
        let rounded = (product + (1 << (Self::FRACTION - 1))) >> Self::FRACTION;
        Self(rounded.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32)
    }
}

impl Neg for Q16 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(self.0.saturating_neg())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn converts_both_ways_and_saturates() {
        for value in [0.0, 1.0, -1.0, 0.5, -32768.0, 1.0 / 65536.0] {
            assert_eq!(f32::from(Q16::from(value)), value);
        }
        assert_eq!(Q16::from(1e9), Q16::MAX);
        assert_eq!(Q16::from(-1e9), Q16::MIN);
        assert_eq!(Q16::from(f32::NAN), Q16::ZERO);
        assert_eq!(Q16::MAX + Q16::ONE, Q16::MAX);
        assert_eq!(Q16::MIN - Q16::ONE, Q16::MIN);
        assert_eq!(Q16::MIN * Q16::MIN, Q16::MAX);
        assert_eq!(-Q16::MIN, Q16::MAX);
    }

    #[test]
    fn clamping_stops_a_nan() {
        assert_eq!(f32::NAN.clamped(-1.0, 1.0), -1.0);
        assert_eq!(0.5_f32.clamped(-1.0, 1.0), 0.5);
        assert_eq!(f32::INFINITY.clamped(-1.0, 1.0), 1.0);
    }

    proptest! {
        #[test]
        fn arithmetic_is_that_of_wide_floats_rounded(a in any::<i32>(), b in any::<i32>()) {
            let scale = 65536.0_f64;
            let (x, y) = (f64::from(a) / scale, f64::from(b) / scale);
            let near = |fixed: Q16, exact: f64| {
                let exact = exact.clamp(f64::from(i32::MIN) / scale, f64::from(i32::MAX) / scale);
                (f64::from(fixed.to_bits()) / scale - exact).abs() <= 0.51 / scale
            };
            let (a, b) = (Q16::from_bits(a), Q16::from_bits(b));
            prop_assert!(near(a + b, x + y));
            prop_assert!(near(a - b, x - y));
            prop_assert!(near(a * b, x * y));
        }
    }
}
