//! The sum of the memory that values lie in: a flipped bit shows by it.

use core::arch::asm;
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

/// Of the words from an address on: some four cycles each.
// Not inlined: it is called for each value.
#[inline(never)]
fn of_words(from: usize, words: usize) -> u32 {
    let (mut at, mut sum) = (from, 0);
    let (eights, end) = (from + words / 8 * 32, from + words * 4);
    while at != eights {
        (at, sum) = with_four(at, sum);
        (at, sum) = with_four(at, sum);
    }
    while at != end {
        // SAFETY: a word of a value in RAM, volatile as above.
        sum = mixed(sum, unsafe { (at as *const u32).read_volatile() });
        at += 4;
    }
    sum
}

/// With four words more, and the address behind them.
#[inline(always)]
fn with_four(at: usize, sum: u32) -> (usize, u32) {
    let (a, b, c, d): (u32, u32, u32, u32);
    let behind;
    // SAFETY: reads four words of a value in RAM. Assembly, because what flips one is no write that
    // the compiler knows of, and one instruction loads four words in five cycles.
    unsafe {
        asm!(
            "ldmia {at}!, {{r0, r1, r2, r3}}",
            at = inout(reg) at => behind,
            out("r0") a, out("r1") b, out("r2") c, out("r3") d,
            options(nostack, preserves_flags, readonly)
        );
    }
    (behind, mixed(mixed(mixed(mixed(sum, a), b), c), d))
}

fn mixed(sum: u32, word: u32) -> u32 {
    (sum ^ word).wrapping_mul(FACTOR)
}
