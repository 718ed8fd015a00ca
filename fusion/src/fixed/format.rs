//! The number formats, and the conversion of coefficients.
//!
//! `Qn` is an `i32` that stands for itself divided by `2^n`. The names are for readers; to the
//! compiler all are `i32`. The shifts are written out, because most formats last for one expression
//! only. The rules:
//!
//! - A product of Qa and Qb is Q(a + b). `>> n` takes n fractional bits off, and rounds down.
//! - A product must fit 31 bits and a sign, so factors are cut to 16 bits first. The core
//!   multiplies 32 x 32 -> 32 bits in one cycle; a product of 64 bits would be a library call of 78
//!   cycles.
//! - A coefficient that spans decades has 13 to 15 significant bits, and a shift for its product:
//!   see [`normalised`].

/// Fractional bits 4: the horizontal field, counts.
pub(super) type Q4 = i32;

/// Fractional bits 8: fields and smoothed accelerations, counts.
pub(super) type Q8 = i32;

/// Fractional bits 9: the gyroscope's offset, counts.
pub(super) type Q9 = i32;

/// Fractional bits 15: unit vectors and the quaternion where they are factors, sines.
pub(super) type Q15 = i32;

/// Fractional bits 16: half angles of a step and their squares, rad.
pub(super) type Q16 = i32;

/// Fractional bits 28: variances of angles, rad^2, drifts and pulls, rad.
pub(super) type Q28 = i32;

/// Fractional bits 30: the quaternion and products of its components.
pub(super) type Q30 = i32;

/// Fractional bits 31: half angles that are still to be applied, rad.
pub(super) type Q31 = i32;

/// The power of two that is nearest to a value of 1 or more, by ratio: its logarithm.
pub(super) fn nearest_log2(value: f32) -> u8 {
    let (mut value, mut log2) = (value, 0);
    while value > core::f32::consts::SQRT_2 {
        value *= 0.5;
        log2 += 1;
    }
    log2
}

/// A positive coefficient below `limit` as an integer from `limit / 2` up to `limit`, and the right
/// shift for its products.
#[inline(never)]
pub(super) fn normalised(value: f32, limit: f32) -> (i32, u32) {
    let (mut value, mut shift) = (value, 0);
    while value < limit / 2.0 {
        value *= 2.0;
        shift += 1;
    }
    ((value + 0.5) as i32, shift)
}

/// One over the root of a number of 1 or more: `y / 2^(30 - h)`, `y` from 2^14 to 2^15 and exact
/// within 3e-4, `h` from 0 to 15.
///
/// Two of Newton's steps `y += y (1 - x y^2) / 2` from a straight line that is 9 % off at most: `x`
/// is Q15 from 1/4 to 1, `y` Q14.
#[inline(always)]
pub(super) fn inverse_root(value: u32) -> (i32, u32) {
    let h = value.leading_zeros() / 2;
    let x = ((value << (2 * h)) >> 17) as i32;
    // 2.1327 - 1.2187 x
    let mut y = 34_942 - ((x * 19_967) >> 15);
    for _ in 0..2 {
        let product = x * ((y * y) >> 14);
        y = (y * (((3 << 29) - product) >> 15)) >> 15;
    }
    (y, h)
}

/// Whether all these are within a limit of 0.
pub(super) fn are_within(values: &[i32], limit: i32) -> bool {
    values.iter().all(|value| (-limit..=limit).contains(value))
}

/// `value` or 0, the larger. Without a branch: the core has no conditional move.
#[inline(always)]
pub(super) fn positive(value: i32) -> i32 {
    value & !(value >> 31)
}

#[cfg(test)]
mod tests {
    use super::inverse_root;
    use proptest::prelude::*;

    fn error(value: u32) -> f64 {
        let (y, h) = inverse_root(value);
        let inverse = f64::from(y) * 2_f64.powi(h as i32 - 30);
        inverse * f64::from(value).sqrt() - 1.0
    }

    #[test]
    fn the_ends_of_each_power_of_four_have_their_roots() {
        for shift in 0..32 {
            for value in [1_u32 << shift, u32::MAX >> shift] {
                assert!(error(value).abs() < 3e-4, "{value}: {}", error(value));
            }
        }
    }

    proptest! {
        #[test]
        fn roots_are_those_of_float(value in 1_u32..) {
            prop_assert!(error(value).abs() < 3e-4, "{value}: {}", error(value));
        }
    }
}
