//! The sum of the memory that values lie in: a flipped bit shows by it.

use core::mem::size_of;
use core::ptr::from_ref;

/// An odd number, so that another word makes another product; its bits are those of the golden
/// ratio, so that few flipped ones make many.
const FACTOR: u32 = 0x9E37_79B9;

/// A number that changes with any bit of the words that a value lies in, those between its fields,
/// too.
pub(super) fn of<T>(value: &T) -> u32 {
    const { assert!(align_of::<T>() >= 4) };
    of_words(from_ref(value).addr(), size_of::<T>() / 4)
}

/// Of the words from an address on. Four at a time: some five cycles each.
// Not inlined: it is called for each value.
#[inline(never)]
fn of_words(from: usize, words: usize) -> u32 {
    let (mut at, mut sum) = (from, 0);
    let (fours, end) = (from + words / 4 * 16, from + words * 4);
    while at != fours {
        // SAFETY: words of a value in RAM. Volatile, because what flips one is no write that the
        // compiler knows of; any bits are words.
        let [a, b, c, d] = unsafe { (at as *const [u32; 4]).read_volatile() };
        sum = mixed(mixed(mixed(mixed(sum, a), b), c), d);
        at += 16;
    }
    while at != end {
        // SAFETY: as above.
        sum = mixed(sum, unsafe { (at as *const u32).read_volatile() });
        at += 4;
    }
    sum
}

fn mixed(sum: u32, word: u32) -> u32 {
    (sum ^ word).wrapping_mul(FACTOR)
}
