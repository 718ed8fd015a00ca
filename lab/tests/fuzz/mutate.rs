//! Inputs out of the stored ones: the same number gives the same input.

use std::ops::Range;

use rand::rngs::StdRng;
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};

use super::frames;

/// One input in this number is a stored one cut short, each of them at each of its bytes in turn.
const CUT_EVERY: u64 = 8;
/// Most changes of one input.
const CHANGES: usize = 6;
/// Most numbers of a text that are replaced.
const NUMBERS_CHANGED: usize = 3;
/// Longest piece that is inserted, deleted or repeated, bytes.
const PIECE: usize = 200;
/// Longest input, bytes: pieces that are repeated again and again do not grow without end.
const LONGEST: usize = 64 * 1024;

/// Numbers in text that break a program.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-1",
    "1e-400",
    "5e-324",
    "1e9",
    "1e18",
    "1.8e308",
    "1e400",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "255",
    "65536",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775809",
    "18446744073709551616",
    "0x7fffffff",
    "1_000",
    "1.",
    "",
];

/// What stands in an input, by which it is changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Bytes of which nothing is known.
    Bytes,
    /// Text: its numbers are replaced by extreme ones, too.
    Text,
    /// MAVLink frames, each behind this many bytes of time: most inputs have frames with other
    /// content whose checksums are right, else nothing behind the checksum would be tried.
    Frames(usize),
}

/// Input number `number` of a reader with these stored ones.
pub fn input(number: u64, stored: &[Vec<u8>], form: Form) -> Vec<u8> {
    if number.is_multiple_of(CUT_EVERY) {
        return cut(number / CUT_EVERY, stored);
    }
    let mut random = StdRng::seed_from_u64(number);
    let one = stored.choose(&mut random).cloned().unwrap_or_default();
    if let Form::Frames(stamp) = form
        && random.random_bool(0.6)
        && let Some(bytes) = frames::reframe(&one, stamp, &mut random)
    {
        return bytes;
    }
    let mut bytes = one;
    if form == Form::Text && random.random_bool(0.5) {
        // It is likely to be text of the same kind, whose values are looked at.
        for _ in 0..random.random_range(1..=NUMBERS_CHANGED) {
            replace_number(&mut bytes, &mut random);
        }
        return bytes;
    }
    for _ in 0..random.random_range(1..=CHANGES) {
        change(&mut bytes, stored, form, &mut random);
    }
    bytes.truncate(LONGEST);
    bytes
}

/// A stored input up to a byte. Every number is one byte of one of them, until all have been.
fn cut(number: u64, stored: &[Vec<u8>]) -> Vec<u8> {
    let lengths = stored.iter().map(|one| one.len() as u64 + 1);
    let mut at = number % lengths.sum::<u64>().max(1);
    for one in stored {
        match one.get(..at as usize) {
            Some(begin) => return begin.to_vec(),
            None => at -= one.len() as u64 + 1,
        }
    }
    Vec::new()
}

/// Changes some bytes.
fn change(bytes: &mut Vec<u8>, stored: &[Vec<u8>], form: Form, random: &mut StdRng) {
    let kinds = if form == Form::Text { 11 } else { 9 };
    let place = piece(bytes, random);
    match random.random_range(0..kinds) {
        0 if place.start < bytes.len() => bytes[place.start] ^= 1 << random.random_range(0..8),
        1 => bytes.truncate(place.start),
        2 => drop(bytes.drain(place)),
        3 => {
            let copy = bytes[place].to_vec();
            let to = random.random_range(0..=bytes.len());
            bytes.splice(to..to, copy);
        }
        4 => random.fill(&mut bytes[place]),
        5 => {
            let fill = [0x00, 0xFF, 0x7F, b'9', b',', b'\n', b'['];
            bytes[place].fill(*fill.choose(random).unwrap_or(&0));
        }
        6 => splice(bytes, stored, random),
        7 => grow(bytes, random),
        8 => {
            let mut new = vec![0; random.random_range(1..=8)];
            random.fill(&mut new[..]);
            bytes.splice(place.start..place.start, new);
        }
        _ => replace_number(bytes, random),
    }
}

/// A piece of the bytes, perhaps an empty one at their end.
fn piece(bytes: &[u8], random: &mut StdRng) -> Range<usize> {
    let at = random.random_range(0..=bytes.len());
    let length = random.random_range(0..=(bytes.len() - at).min(PIECE));
    at..at + length
}

/// The beginning of these bytes and the end of stored ones.
fn splice(bytes: &mut Vec<u8>, stored: &[Vec<u8>], random: &mut StdRng) {
    let Some(other) = stored.choose(random) else {
        return;
    };
    bytes.truncate(random.random_range(0..=bytes.len()));
    bytes.extend(&other[random.random_range(0..=other.len())..]);
}

/// Takes a word for a length, and makes it larger or extreme.
fn grow(bytes: &mut [u8], random: &mut StdRng) {
    let width = *[1, 2, 4, 8].choose(random).unwrap_or(&1);
    if bytes.len() < width {
        return;
    }
    let at = random.random_range(0..=bytes.len() - width);
    let mut word = [0; 8];
    word[..width].copy_from_slice(&bytes[at..at + width]);
    let value = u64::from_le_bytes(word);
    let grown = match random.random_range(0..5) {
        0 => value.wrapping_add(1),
        1 => value.wrapping_sub(1),
        2 => value.wrapping_shl(random.random_range(1..32)),
        3 => u64::MAX >> random.random_range(0..64),
        _ => 1 << random.random_range(0..64),
    };
    bytes[at..at + width].copy_from_slice(&grown.to_le_bytes()[..width]);
}

/// Replaces one of the numbers in a text.
fn replace_number(bytes: &mut Vec<u8>, random: &mut StdRng) {
    let is_digit = |byte: &u8| byte.is_ascii_digit() || b".-+".contains(byte);
    let mut numbers: Vec<Range<usize>> = Vec::new();
    for (at, _) in bytes.iter().enumerate().filter(|(_, byte)| is_digit(byte)) {
        match numbers.last_mut() {
            Some(last) if last.end == at => last.end = at + 1,
            _ => numbers.push(at..at + 1),
        }
    }
    let (Some(place), Some(new)) = (numbers.choose(random), NUMBERS.choose(random)) else {
        return;
    };
    bytes.splice(place.clone(), new.bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stored_input_is_cut_at_every_byte() {
        let stored = [b"abc".to_vec(), b"".to_vec(), b"xy".to_vec()];
        let cuts: Vec<_> = (0..8).map(|number| cut(number, &stored)).collect();
        let expected: [&[u8]; 8] = [b"", b"a", b"ab", b"abc", b"", b"", b"x", b"xy"];
        assert_eq!(cuts, expected);
        assert_eq!(cut(8, &stored), cut(0, &stored));
    }

    #[test]
    fn a_number_names_its_input() {
        let stored = [b"gain = 1.5\n".to_vec(), b"speed = -3\n".to_vec()];
        let inputs: Vec<_> = (0..2000).map(|n| input(n, &stored, Form::Text)).collect();
        let again: Vec<_> = (0..2000).map(|n| input(n, &stored, Form::Text)).collect();
        assert_eq!(inputs, again);
        let has = |text: &str| inputs.iter().any(|one| one == text.as_bytes());
        assert!(has("gain = NaN\n") && has("speed = 1e400\n"), "extremes");
    }

    #[test]
    fn a_beginning_has_the_end_of_another() {
        let stored = [b"12".to_vec(), b"ab".to_vec()];
        let spliced = |seed| {
            let mut bytes = b"12".to_vec();
            splice(&mut bytes, &stored, &mut StdRng::seed_from_u64(seed));
            bytes
        };
        assert!((0..100).any(|seed| spliced(seed) == b"1b"));
    }

    #[test]
    fn a_length_grows() {
        let grown = |seed| {
            let mut bytes = vec![4, 0, 0, 0];
            grow(&mut bytes, &mut StdRng::seed_from_u64(seed));
            u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
        };
        assert!((0..200).any(|seed| grown(seed) == 5));
        assert!((0..200).any(|seed| grown(seed) > u32::MAX / 2));
    }
}
