//! MAVLink's checksum.

/// CRC-16/MCRF4XX of a frame from its length byte on, and of the message's CRC_EXTRA.
///
/// Without a table, as MAVLink's own `crc_accumulate` does it: as fast on this core as with one,
/// and half a kilobyte of flash smaller than the library's.
#[inline(never)]
pub(super) fn checksum(frame: &[u8], extra_crc: u8) -> u16 {
    let bytes = frame.iter().chain(core::iter::once(&extra_crc));
    bytes.fold(0xFFFF, |crc, byte| {
        let low = byte ^ crc as u8;
        let low = u16::from(low ^ (low << 4));
        (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    })
}

#[cfg(test)]
mod tests {
    use super::checksum;

    #[test]
    fn it_is_the_library_s() {
        // The catalogue's check value, of "123456789", has no extra byte: the last digit stands for
        // it.
        assert_eq!(checksum(b"12345678", b'9'), 0x6F91);
        let bytes: std::vec::Vec<u8> = (0..=255).rev().collect();
        for len in 0..bytes.len() {
            let expected = mavlink::calculate_crc(&bytes[..len], 50);
            assert_eq!(checksum(&bytes[..len], 50), expected, "{len} bytes");
        }
    }
}
