//! Bytes as text without the standard formatting, which takes 2 KB on a small chip.

use core::fmt::{self, Write};

/// Shows a byte as `0x` and two hexadecimal digits.
pub struct Hex(pub u8);

impl fmt::Display for Hex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("0x")?;
        for digit in [self.0 >> 4, self.0 & 15] {
            let digit = if digit < 10 { b'0' + digit } else { b'A' + digit - 10 };
            f.write_char(char::from(digit))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Hex;

    #[test]
    fn every_byte_is_as_the_standard_library_shows_it() {
        for byte in 0..=u8::MAX {
            assert_eq!(Hex(byte).to_string(), format!("0x{byte:02X}"));
        }
    }
}
