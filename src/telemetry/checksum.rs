//! MAVLink's checksum.

use core::hint::black_box;

/// CRC-16/MCRF4XX, from a frame's length byte on, and of the message's CRC_EXTRA.
///
/// Without a table, as MAVLink's own `crc_accumulate` does it, and half a kilobyte of flash smaller
/// than the library's.
#[derive(Clone, Copy)]
pub(super) struct Checksum(u32);

impl Checksum {
    pub(super) const fn new() -> Self {
        Self(0xFFFF)
    }

    /// Another byte, the lowest of `byte`.
    pub(super) fn add(&mut self, byte: u32) {
        let low = self.0 ^ byte;
        let low = (low ^ (low << 4)) & 0xFF;
        self.0 = (self.0 >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4);
    }

    /// The four bytes of `word`, in twice the time of one. The polynomial is z^16 + z^12 + z^5 + 1,
    /// and the quotient of 32 bits by it follows from 1 / (1 + a) = (1 + a) (1 + a^2) (1 + a^4) ...
    /// with a = z^4 + z^11 + z^16, as bits beyond z^31 are of no account.
    fn add_word(&mut self, word: u32) {
        let sum = self.0 ^ word;
        let once = sum ^ (sum << 4) ^ (sum << 11) ^ (sum << 16);
        let twice = once ^ (once << 8) ^ (once << 22);
        let quotient = twice ^ (twice << 16);
        self.0 = (quotient >> 16) ^ (quotient >> 21) ^ (quotient >> 28);
    }

    /// Writes `words`, little endian, to `place`, as far as it goes, and adds them.
    pub(super) fn write(mut self, words: &[u32], place: &mut [u8]) -> Self {
        let (whole, rest) = place.as_chunks_mut();
        let mut last = words.get(whole.len()).copied().unwrap_or(0);
        for (place, word) in whole.iter_mut().zip(words) {
            // Kept from the optimiser, which would copy first, by a `memcpy` of bytes that are not
            // aligned, and take a third longer for both.
            let word = &black_box(*word);
            *place = word.to_le_bytes();
            self.add_word(*word);
        }
        for place in rest {
            *place = last as u8;
            self.add(last);
            last >>= 8;
        }
        self
    }

    /// That of a whole frame, from its length byte on, and of the message's CRC_EXTRA.
    #[inline(never)]
    pub(super) fn of(frame: &[u8], extra_crc: u8) -> u16 {
        let mut checksum = Self::new();
        for byte in frame {
            checksum.add((*byte).into());
        }
        checksum.add(extra_crc.into());
        checksum.value()
    }

    pub(super) fn value(self) -> u16 {
        self.0 as u16
    }
}

#[cfg(test)]
mod tests {
    use super::Checksum;

    #[test]
    fn it_is_the_library_s() {
        // The catalogue's check value, of "123456789", has no extra byte: the last digit stands for
        // it.
        assert_eq!(Checksum::of(b"12345678", b'9'), 0x6F91);
        let bytes: std::vec::Vec<u8> = (0..=255).rev().collect();
        for len in 0..bytes.len() {
            let expected = mavlink::calculate_crc(&bytes[..len], 50);
            assert_eq!(Checksum::of(&bytes[..len], 50), expected, "{len} bytes");
            let words: std::vec::Vec<u32> =
                bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
            let mut place = std::vec![0; len];
            let mut written = Checksum::new().write(&words, &mut place);
            written.add(50);
            assert_eq!(written.value(), expected, "{len} bytes as words");
            assert_eq!(place, bytes[..len]);
        }
    }
}
