//! Numbers as text without the weight of the standard float formatting (some 10 KB on the chip).

use core::fmt;

/// Shows an `f32` with up to three decimals, trailing zeros left out.
pub(crate) struct Decimal(pub(crate) f32);

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.0.is_finite() || self.0.abs() > 2.0e6 {
            return write!(f, "?");
        }
        let thousandths = (self.0.abs() * 1000.0 + 0.5) as u32;
        let (whole, mut fraction, mut digits) = (thousandths / 1000, thousandths % 1000, 3);
        let sign = if self.0 < 0.0 && thousandths > 0 {
            "-"
        } else {
            ""
        };
        if fraction == 0 {
            return write!(f, "{sign}{whole}");
        }
        while fraction % 10 == 0 {
            fraction /= 10;
            digits -= 1;
        }
        write!(f, "{sign}{whole}.{fraction:0digits$}")
    }
}

#[cfg(test)]
mod tests {
    use super::Decimal;
    use std::string::ToString;

    #[test]
    fn shows_what_a_person_would_write() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0001, "0"),
            (1.0, "1"),
            (-1.5, "-1.5"),
            (0.05, "0.05"),
            (1523.6, "1523.6"),
            (100_000.0, "100000"),
            (f32::NAN, "?"),
        ] {
            assert_eq!(Decimal(value).to_string(), text);
        }
    }
}
