//! Numbers as text without the weight of the standard formatting, which pads and signs and aligns
//! (2 KB on the chip for integers, some 10 KB for floats).

use core::fmt::{self, Write};

use crate::params::whole;

/// Shows a whole number.
pub(crate) struct Whole(pub(crate) u32);

impl fmt::Display for Whole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mut unit, mut rest) = (1, self.0 / 10);
        while rest > 0 {
            (unit, rest) = (10 * unit, rest / 10);
        }
        write_digits(f, self.0, unit)
    }
}

/// Shows a word as `0x` and its hexadecimal digits.
pub(crate) struct Hex(pub(crate) u32);

impl fmt::Display for Hex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("0x")?;
        let digits = (35 - (self.0 | 1).leading_zeros()) / 4;
        for shift in (0..digits).rev().map(|digit| 4 * digit) {
            f.write_char(char::from_digit(self.0 >> shift & 15, 16).unwrap_or('?'))?;
        }
        Ok(())
    }
}

/// Shows an `f32` with up to three decimals, trailing zeros left out.
pub(crate) struct Decimal(pub(crate) f32);

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.0.is_finite() || self.0.abs() > 2.0e6 {
            return f.write_str("?");
        }
        let thousandths = whole(self.0.abs() * 1000.0 + 0.5) as u32;
        if self.0 < 0.0 && thousandths > 0 {
            f.write_str("-")?;
        }
        Whole(thousandths / 1000).fmt(f)?;
        let (mut fraction, mut unit) = (thousandths % 1000, 100);
        if fraction == 0 {
            return Ok(());
        }
        while fraction % 10 == 0 {
            fraction /= 10;
            unit /= 10;
        }
        f.write_str(".")?;
        write_digits(f, fraction, unit)
    }
}

/// The decimal digits of `number` from that of `unit`, a power of ten, downwards.
#[inline(never)]
fn write_digits(f: &mut fmt::Formatter<'_>, mut number: u32, mut unit: u32) -> fmt::Result {
    while unit > 0 {
        f.write_char(char::from_digit(number / unit, 10).unwrap_or('?'))?;
        number %= unit;
        unit /= 10;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{Decimal, Hex, Whole};
    use std::string::ToString;

    #[test]
    fn shows_what_a_person_would_write() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0001, "0"),
            (1.0, "1"),
            (-1.5, "-1.5"),
            (0.05, "0.05"),
            (-0.207, "-0.207"),
            (1523.6, "1523.6"),
            (100_000.0, "100000"),
            (f32::NAN, "?"),
        ] {
            assert_eq!(Decimal(value).to_string(), text);
        }
    }

    #[test]
    fn whole_and_hexadecimal_numbers_are_as_the_standard_library_shows_them() {
        for number in [0, 7, 9, 10, 99, 100, 4_096, 999_999_999, 1_000_000_000, u32::MAX] {
            assert_eq!(Whole(number).to_string(), std::format!("{number}"));
            assert_eq!(Hex(number).to_string(), std::format!("{number:#x}"));
        }
    }
}
