//! Signed 16-bit words as the chip holds them: the low byte first.

/// Fills `words` from a block of registers, as far as both go.
pub(crate) fn decode(words: &mut [i16], registers: &[u8]) {
    for (to, pair) in words.iter_mut().zip(registers.as_chunks::<2>().0) {
        *to = i16::from_le_bytes(*pair);
    }
}

/// Fills a block of registers from `words`, as far as both go.
pub(crate) fn encode(registers: &mut [u8], words: &[i16]) {
    for (to, word) in registers.as_chunks_mut::<2>().0.iter_mut().zip(words) {
        *to = word.to_le_bytes();
    }
}
