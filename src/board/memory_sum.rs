//! The checksum of the memory that a value lies in, by which a flipped bit is found.

use core::arch::asm;
use core::mem::size_of;
use core::ptr::from_ref;

/// An odd number, so that another checksum makes another product. Its bits are those of the golden
/// ratio, so that few flipped bits of a checksum make many of the product.
const FACTOR: u32 = 0x9E37_79B9;

/// A number that changes with any bit of the words that a value lies in, those between its fields,
/// too: no step of the checksum gives the same for two different words.
pub(super) fn of<T>(value: &T) -> u32 {
    const { assert!(align_of::<T>() >= 4) };
    of_words(from_ref(value).addr(), size_of::<T>() / 4)
}

/// Of the words from an address on: some three cycles each.
// Not inlined: it is called for each value.
#[inline(never)]
fn of_words(from: usize, words: usize) -> u32 {
    let (mut at, mut sum) = (from, 0);
    let (twelves, end) = (from + words / 12 * 48, from + words * 4);
    while at != twelves {
        (at, sum) = with_twelve(at, sum);
    }
    while at != end {
        // SAFETY: a word of a value in RAM, volatile because a bit may flip by itself.
        let word = unsafe { (at as *const u32).read_volatile() };
        sum = (sum ^ word).wrapping_mul(FACTOR);
        at += 4;
    }
    sum
}

/// With twelve words more, and the address behind them. Every second word is multiplied with the
/// checksum before it.
fn with_twelve(mut at: usize, mut sum: u32) -> (usize, u32) {
    // SAFETY: reads twelve words of a value in RAM. Assembly, because what flips a bit is no write
    // that the compiler knows of, and one instruction loads three words in four cycles.
    unsafe {
        asm!(
            ".rept 2",
            "ldmia {at}!, {{r0, r1, r2}}",
            "eors {sum}, r0",
            "muls {sum}, {factor}, {sum}",
            "adds {sum}, r1",
            "eors {sum}, r2",
            "muls {sum}, {factor}, {sum}",
            "ldmia {at}!, {{r0, r1, r2}}",
            "adds {sum}, r0",
            "eors {sum}, r1",
            "muls {sum}, {factor}, {sum}",
            "adds {sum}, r2",
            ".endr",
            at = inout(reg) at,
            sum = inout(reg) sum,
            factor = in(reg) FACTOR,
            out("r0") _, out("r1") _, out("r2") _,
            options(nostack, readonly)
        );
    }
    (at, sum)
}
