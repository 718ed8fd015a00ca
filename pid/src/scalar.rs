//! The numbers of controllers.

use core::ops::{Add, Mul, Neg, Sub};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for super::Q16 {}
}

/// `f32` or [`Q16`], without division and trigonometry, which belong into configuration.
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
    /// A factor from 0 to below 1, by which fixed point multiplies in a fifth of the time.
    type Share: Copy + Default + PartialEq + core::fmt::Debug + From<f32>;

    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// The largest value below 1.
    const BELOW_ONE: Self;

    /// Half of it, rounded down.
    fn half(self) -> Self;

    /// This share of it, rounded to nearest.
    fn times(self, share: Self::Share) -> Self;

    /// Whole part and rest. The whole part of a negative number or a NaN is 0.
    fn split(self) -> (usize, Self::Share);

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

    /// Whether a controller can use it: not NaN, and small enough for a product.
    fn is_usable(self) -> bool;
}

impl Scalar for f32 {
    type Share = Self;

    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const BELOW_ONE: Self = 1.0 - Self::EPSILON / 2.0;

    #[inline]
    fn half(self) -> Self {
        0.5 * self
    }

    #[inline]
    fn times(self, share: Self) -> Self {
        self * share
    }

    #[inline]
    fn split(self) -> (usize, Self) {
        // Float to integer conversion saturates and takes NaN to zero.
        let whole = self as usize;
        let beyond = self - whole as Self;
        (whole, if (0.0..1.0).contains(&beyond) { beyond } else { 0.0 })
    }

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

    /// The product of any two numbers.
    // Not inlined, so that the usual product saves no registers.
    #[cold]
    #[inline(never)]
    fn product(self, other: Self) -> Self {
        let product = i64::from(self.0) * i64::from(other.0);
        let rounded = (product + (1 << (Self::FRACTION - 1))) >> Self::FRACTION;
        Self(rounded.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32)
    }
}

/// Fixed point: 16 fraction bits, 0 to 0.99998 in steps of 1.5e-5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Share16(u16);

impl Share16 {
    /// From the bits: `bits / 65536`.
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }
}

impl From<f32> for Share16 {
    /// The nearest value. Beyond the range the nearer bound, for a NaN zero.
    #[inline]
    fn from(share: f32) -> Self {
        Self(Q16::from(share).0.clamp(0, i32::from(u16::MAX)) as u16)
    }
}

impl Scalar for Q16 {
    type Share = Share16;

    const ZERO: Self = Self(0);
    const ONE: Self = Self(1 << Self::FRACTION);
    const BELOW_ONE: Self = Self((1 << Self::FRACTION) - 1);

    #[inline]
    fn half(self) -> Self {
        Self(self.0 >> 1)
    }

    #[inline]
    fn times(self, share: Share16) -> Self {
        let low = ((self.0 & 0xffff) as u32) * u32::from(share.0);
        let high = (self.0 >> 16) * i32::from(share.0);
        Self(high + ((low + (1 << 15)) >> 16) as i32)
    }

    #[inline]
    fn split(self) -> (usize, Share16) {
        match usize::try_from(self.0 >> Self::FRACTION) {
            Ok(whole) => (whole, Share16(self.0 as u16)),
            Err(_) => (0, Share16(0)),
        }
    }

    #[inline]
    fn is_usable(self) -> bool {
        true
    }
}

impl From<f32> for Q16 {
    /// The nearest value. Beyond the range the nearer bound, for a NaN zero.
    // Not inlined: configurations have dozens of them.
    #[inline(never)]
    fn from(value: f32) -> Self {
        // Float to integer conversion saturates and takes NaN to zero.
        let scaled = value * 65536.0;
        Self((scaled + if scaled < 0.0 { -0.5 } else { 0.5 }) as i32)
    }
}

impl From<Q16> for f32 {
    fn from(value: Q16) -> Self {
        const EXPONENT: u32 = 16 << (f32::MANTISSA_DIGITS - 1);
        // Divides by 2^16 in the exponent: a division takes long without an FPU.
        match value.0 {
            0 => 0.0,
            counts => f32::from_bits((counts as f32).to_bits() - EXPONENT),
        }
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
    /// Rounded to nearest. Two numbers below 128, or a number below 1 and a number below 16384,
    /// take four products of 16 bits. A product of 64 bits takes a Cortex-M0+ several times as
    /// long.
    // Not inlined: a law has dozens of them.
    #[inline(never)]
    fn mul(self, other: Self) -> Self {
        const FEW_BITS: u32 = 23;
        let size = |number: i32| (number ^ (number >> 31)) as u32;
        let (one, two) = (size(self.0), size(other.0));
        if (one | two) >> FEW_BITS != 0 {
            let (small, large) = (one.min(two), one.max(two));
            if small >> Self::FRACTION | large >> 30 != 0 {
                return self.product(other);
            }
        }
        let (a, b) = (self.0 >> 16, other.0 >> 16);
        let (c, d) = (self.0 & 0xffff, other.0 & 0xffff);
        let low = (c as u32).wrapping_mul(d as u32);
        let carry = (low >> 16) + (low >> 15 & 1);
        Self(((a * b) << 16) + a * d + b * c + carry as i32)
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

    /// Any number, and numbers near the bounds between both ways to multiply.
    fn bits() -> impl Strategy<Value = i32> {
        let near = |bound: i32| bound - 2..bound + 3;
        prop_oneof![
            any::<i32>(),
            -(1 << 23)..1 << 23,
            near(1 << 23),
            near(-(1 << 23)),
            -70_000..70_000,
        ]
    }

    #[test]
    fn a_number_is_split_into_whole_and_share() {
        assert_eq!(2.25_f32.split(), (2, 0.25));
        assert_eq!((-0.5_f32).split(), (0, 0.0));
        assert_eq!(f32::NAN.split(), (0, 0.0));
        assert_eq!(Q16::from(2.25).split(), (2, Share16::from(0.25)));
        assert_eq!(Q16::from(-0.5).split(), (0, Share16(0)));
        assert_eq!(Share16::from(7.0), Share16(u16::MAX));
        assert_eq!(Share16::from(-1.0), Share16(0));
    }

    proptest! {
        #[test]
        fn a_share_is_the_product_rounded(a in any::<i32>(), share in any::<u16>()) {
            let exact = (i64::from(a) * i64::from(share) + (1 << 15)) >> 16;
            prop_assert_eq!(i64::from(Q16(a).times(Share16(share)).0), exact);
        }

        #[test]
        fn arithmetic_is_that_of_wide_floats_rounded(a in bits(), b in bits()) {
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
            prop_assert_eq!(a * b, a.product(b));
        }
    }
}
