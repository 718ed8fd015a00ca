//! UF2: the file that a mass-storage bootloader takes when it is copied onto the board's drive.
//!
//! A file is a row of 512-byte blocks, each with its own target address, so that a bootloader may
//! take them in any order. A block has 32 bytes of header, 476 of data (256 used) and 4 of closing
//! magic; all words are little endian.

/// Bytes of flash in one block.
const PAYLOAD: usize = 256;
/// Bytes of one block in the file.
const BLOCK: usize = 512;
const MAGIC_START: [u32; 2] = [0x0A32_4655, 0x9E5D_5157];
const MAGIC_END: u32 = 0x0AB1_6F30;
/// The size field holds a family, so that a board refuses an image for another chip.
const FLAG_FAMILY: u32 = 0x0000_2000;
/// The family of the SAMD21.
const FAMILY_SAMD21: u32 = 0x68ED_2B88;

/// The image as UF2 blocks, the first one at `address`; the last block is filled with `0xFF`.
pub fn encode(address: u32, image: &[u8]) -> Vec<u8> {
    let count = image.len().div_ceil(PAYLOAD) as u32;
    let mut file = Vec::with_capacity(count as usize * BLOCK);
    for (number, chunk) in (0u32..).zip(image.chunks(PAYLOAD)) {
        let header = [
            MAGIC_START[0],
            MAGIC_START[1],
            FLAG_FAMILY,
            address + number * PAYLOAD as u32,
            PAYLOAD as u32,
            number,
            count,
            FAMILY_SAMD21,
        ];
        let start = file.len();
        file.extend(header.iter().flat_map(|word| word.to_le_bytes()));
        file.extend_from_slice(chunk);
        file.resize(start + 32 + PAYLOAD, 0xFF);
        file.resize(start + BLOCK - 4, 0);
        file.extend(MAGIC_END.to_le_bytes());
    }
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn two_blocks_carry_their_addresses_and_the_whole_image() {
        let image: Vec<u8> = (0..300u32).map(|i| i as u8).collect();
        let file = encode(0x2000, &image);
        assert_eq!(file.len(), 2 * BLOCK);
        for (number, block) in file.chunks(BLOCK).enumerate() {
            assert_eq!(word(block, 0), 0x0A32_4655);
            assert_eq!(word(block, 4), 0x9E5D_5157);
            assert_eq!(word(block, 12), 0x2000 + 256 * number as u32);
            assert_eq!(word(block, 16), 256);
            assert_eq!(word(block, 20), number as u32);
            assert_eq!(word(block, 24), 2);
            assert_eq!(word(block, 28), 0x68ED_2B88);
            assert_eq!(word(block, 508), 0x0AB1_6F30);
        }
        assert_eq!(file[32..288], image[..256]);
        assert_eq!(file[BLOCK + 32..BLOCK + 76], image[256..]);
        assert_eq!(file[BLOCK + 76], 0xFF);
    }

    #[test]
    fn no_image_is_no_block() {
        assert!(encode(0x2000, &[]).is_empty());
    }
}
