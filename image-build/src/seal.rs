//! The sums of an image, in three words of its vector table that the processor has no use for. The
//! firmware compares them as long as it runs (`src/samd21/image_check.rs`).
//!
//! The sums are of all words of the image but these three: Fletcher's two, modulo 2^32, which the
//! core computes; and CRC-32, not inverted at its end, which the DSU's engine does. An image that
//! was not sealed has zeros there and is not compared.

use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

/// Where in the image the three words are: the reserved exceptions 7 to 9 (ARMv6-M, B1.5.2).
pub const SEAL: Range<usize> = 0x1C..0x28;
/// Erased flash, between two segments.
const ERASED: u8 = 0xFF;
const PT_LOAD: u32 = 1;

/// A part of the file that goes into flash.
struct Segment {
    in_file: usize,
    in_flash: usize,
    length: usize,
}

/// Writes the sums into an ELF file of 32 bits, unless they are there.
///
/// # Errors
/// The file cannot be read or written, or is no such file.
pub(crate) fn seal(elf: &Path) -> io::Result<()> {
    let bytes = fs::read(elf)?;
    let segments = segments(&bytes).ok_or_else(|| bad("it is no ELF file of 32 bits"))?;
    let (place, seal) = sums(&bytes, &segments).ok_or_else(|| bad("it holds no image"))?;
    if bytes.get(place..place + SEAL.len()) == Some(&seal[..]) {
        return Ok(());
    }
    let mut file = File::options().write(true).open(elf)?;
    file.seek(SeekFrom::Start(place as u64))?;
    file.write_all(&seal)
}

fn bad(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// What is loaded (ELF, figure 2-1).
fn segments(elf: &[u8]) -> Option<Vec<Segment>> {
    if !elf.starts_with(b"\x7FELF\x01\x01") {
        return None;
    }
    let half = |at: usize| Some(u16::from_le_bytes(elf.get(at..at + 2)?.try_into().ok()?));
    let word = |at: usize| Some(u32::from_le_bytes(elf.get(at..at + 4)?.try_into().ok()?));
    let (table, size, count) = (word(28)? as usize, half(42)?, half(44)?);
    let mut segments = Vec::new();
    for index in 0..usize::from(count) {
        let header = table.checked_add(index * usize::from(size))?;
        let length = word(header + 16)? as usize;
        if word(header)? == PT_LOAD && length > 0 {
            segments.push(Segment {
                in_file: word(header + 4)? as usize,
                in_flash: word(header + 12)? as usize,
                length,
            });
        }
    }
    segments.sort_by_key(|segment| segment.in_flash);
    Some(segments)
}

/// Where in the file the three words lie, and what they are to be.
fn sums(elf: &[u8], segments: &[Segment]) -> Option<(usize, [u8; 12])> {
    /// The chip's flash.
    const FLASH: usize = 256 * 1024;
    let first = segments.first()?;
    let last = segments.last()?;
    let length = (last.in_flash.checked_add(last.length)?).checked_sub(first.in_flash)?;
    if length > FLASH || first.length < SEAL.end {
        return None;
    }
    let mut image = vec![ERASED; length.next_multiple_of(4)];
    for segment in segments {
        let begin = segment.in_flash - first.in_flash;
        let bytes = elf.get(segment.in_file..segment.in_file.checked_add(segment.length)?)?;
        image.get_mut(begin..begin + segment.length)?.copy_from_slice(bytes);
    }
    let (mut plain, mut weighted, mut crc) = (0_u32, 0_u32, u32::MAX);
    for (index, word) in image.chunks_exact(4).enumerate() {
        if !SEAL.contains(&(4 * index)) {
            let word = u32::from_le_bytes(word.try_into().ok()?);
            plain = plain.wrapping_add(word);
            weighted = weighted.wrapping_add(plain);
            crc = crc_with(crc, word);
        }
    }
    let mut seal = [0; 12];
    for (place, sum) in seal.chunks_exact_mut(4).zip([plain, weighted, crc]) {
        place.copy_from_slice(&sum.to_le_bytes());
    }
    Some((first.in_file + SEAL.start, seal))
}

/// CRC-32 of IEEE 802.3 with one word more, bit by bit from the lowest.
fn crc_with(crc: u32, word: u32) -> u32 {
    (0..32).fold(crc ^ word, |crc, _| crc >> 1 ^ if crc & 1 == 0 { 0 } else { 0xEDB8_8320 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with two segments: 12 words and, behind a gap of one, two more.
    fn elf() -> Vec<u8> {
        let mut elf = vec![0; 52];
        elf[..6].copy_from_slice(b"\x7FELF\x01\x01");
        elf[28] = 52;
        elf[42] = 32;
        elf[44] = 2;
        let mut header = |kind: u32, in_file: u32, in_flash: u32, length: u32| {
            for word in [kind, in_file, 0, in_flash, length, length, 0, 0] {
                elf.extend(word.to_le_bytes());
            }
        };
        header(1, 116 + 48, 0x2034, 8);
        header(1, 116, 0x2000, 48);
        for word in 1..=14_u32 {
            elf.extend(word.to_le_bytes());
        }
        elf
    }

    #[test]
    fn the_sums_are_those_of_all_words_but_three() {
        let elf = elf();
        let (place, seal) = sums(&elf, &segments(&elf).unwrap()).unwrap();
        assert_eq!(place, 116 + 0x1C);
        let (mut plain, mut weighted) = (0_u32, 0_u32);
        for word in [1, 2, 3, 4, 5, 6, 7, 11, 12, u32::MAX, 13, 14] {
            plain = plain.wrapping_add(word);
            weighted = weighted.wrapping_add(plain);
        }
        assert_eq!(seal[..4], plain.to_le_bytes());
        assert_eq!(seal[4..8], weighted.to_le_bytes());
    }

    /// Of the text "12345678", as Python's `binascii.crc32` has it.
    #[test]
    fn the_sum_of_a_text_is_the_published_one() {
        let crc = [*b"1234", *b"5678"].map(u32::from_le_bytes).into_iter().fold(u32::MAX, crc_with);
        assert_eq!(!crc, 0x9AE0_DAAF);
    }

    #[test]
    fn a_sealed_file_stays_as_it_is_and_others_are_refused() {
        let folder = std::env::temp_dir().join(format!("seal-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("image.elf");
        fs::write(&path, elf()).unwrap();
        seal(&path).unwrap();
        let sealed = fs::read(&path).unwrap();
        assert_ne!(sealed, elf());
        seal(&path).unwrap();
        assert_eq!(fs::read(&path).unwrap(), sealed);
        for cut in 0..sealed.len() {
            fs::write(&path, &sealed[..cut]).unwrap();
            assert!(seal(&path).is_err(), "{cut} bytes");
        }
        fs::remove_dir_all(&folder).unwrap();
    }
}
