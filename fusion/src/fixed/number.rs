//! A number in Q20, for what is shared with the float filters.

use core::ops::{Add, AddAssign, Mul, Neg, Sub};

use crate::real::{Number, sealed};

/// Fractional bits.
const BITS: u32 = 20;

/// From -2048 to 2048 in steps of 1e-6. It saturates there; products already may from 890 on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Q20(pub(super) i32);

impl sealed::Sealed for Q20 {}

impl Add for Q20 {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl AddAssign for Q20 {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Q20 {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

impl Neg for Q20 {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.saturating_neg())
    }
}

impl Mul for Q20 {
    type Output = Self;

    /// From four products of 16 bits, rounded: what is cut would add up in one direction.
    fn mul(self, other: Self) -> Self {
        let (a, b) = (self.0 >> 16, other.0 >> 16);
        let (c, d) = (self.0 & 0xffff, other.0 & 0xffff);
        let high = a * b;
        // The others carry into it, so that half of what fits must do.
        if high.abs() >= 1 << 18 {
            return Self(if high < 0 { -i32::MAX } else { i32::MAX });
        }
        let (left, right) = (a * d, b * c);
        // What is below the last bit, in 16 bits more.
        let below = ((left & 15) + (right & 15)) << 12;
        let low = ((c as u32).wrapping_mul(d as u32) >> 4) as i32 + below + (1 << 15);
        Self((high << 12) + (left >> 4) + (right >> 4) + (low >> 16))
    }
}

impl Number for Q20 {
    const ZERO: Self = Self(0);
    const HALF: Self = Self(1 << (BITS - 1));
    const ONE: Self = Self(1 << BITS);

    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        Self((value * (1 << BITS) as f32) as i32)
    }

    /// To 16 bits; of a negative number 0.
    fn sqrt(self) -> Self {
        if self.0 <= 0 {
            return Self::ZERO;
        }
        // An even number of bits, so that half of them is one.
        let bits = self.0.leading_zeros() & !1;
        let root = ((self.0 as u32) << bits).isqrt();
        let bits = bits / 2;
        Self(if bits < 10 {
            root << (10 - bits)
        } else {
            root >> (bits - 10)
        } as i32)
    }

    /// To 15 bits; of zero the largest number.
    fn recip(self) -> Self {
        let size = self.0.unsigned_abs();
        let bits = size.leading_zeros();
        if bits >= 23 {
            return Self(if self.0 < 0 { -i32::MAX } else { i32::MAX });
        }
        // The divisor has 16 bits, the first of which is set.
        let quotient = u32::MAX / ((size << bits) >> 16).max(1);
        let inverse = if bits < 8 {
            quotient >> (8 - bits)
        } else {
            quotient << (bits - 8)
        } as i32;
        Self(if self.0 < 0 { -inverse } else { inverse })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.saturating_abs())
    }

    #[inline(always)]
    fn within(self, limit: Self) -> bool {
        self.abs() <= limit
    }

    #[inline(always)]
    fn is_negative(self) -> bool {
        self.0 < 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value(number: Q20) -> f64 {
        f64::from(number.0) / 1_048_576.0
    }

    proptest! {
        #[test]
        fn numbers_are_those_of_float_or_saturate(a: i32, b: i32, shift in 0u32..32) {
            let (x, y) = (Q20(a), Q20(b >> shift));
            for (found, exact, relative) in [
                (x + y, value(x) + value(y), 0.0),
                (x - y, value(x) - value(y), 0.0),
                (x * y, value(x) * value(y), 0.0),
                (y.recip(), 1.0 / value(y), 1e-4),
                (y.abs().sqrt(), value(y).abs().sqrt(), 1e-4),
            ] {
                let exact = exact.clamp(-2048.0, 2048.0);
                // Products beyond 890 saturate.
                let near = (value(found) - exact).abs() <= exact.abs() * relative + 1e-6;
                prop_assert!(near || (exact.abs() >= 890.0 && value(found).abs() >= exact.abs()), "{a} {b} {shift}: {found:?}, {exact}");
            }
        }
    }
}
