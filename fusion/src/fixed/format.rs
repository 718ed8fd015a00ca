//! The number formats, and how coefficients are brought into them.
//!
//! `Qn` is an `i32` that stands for itself divided by `2^n`. The names tell a reader what a number
//! is; to the compiler all of them are `i32`, and the shifts are written out where they happen,
//! because most formats last for one expression only. The rules are those of any fixed point:
//!
//! - A product of Qa and Qb is Q(a + b). `>> n` takes n fractional bits off, and rounds down.
//! - A product must fit 31 bits and a sign. The core multiplies 32 x 32 -> 32 bits in one cycle; a
//!   product of 64 bits would be a library call of 78. So factors are cut to 16 bits first.
//! - A coefficient that spans decades is kept in 13 to 15 significant bits, with the shift that
//!   brings its product back: see [`normalised`].

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
/// shift that its products then need.
pub(super) fn normalised(value: f32, limit: f32) -> (i32, u8) {
    let (mut value, mut shift) = (value, 0);
    while value < limit / 2.0 {
        value *= 2.0;
        shift += 1;
    }
    ((value + 0.5) as i32, shift)
}

/// `value` or 0, the larger. Without a branch: the core has no conditional move.
#[inline(always)]
pub(super) fn positive(value: i32) -> i32 {
    value & !(value >> 31)
}
