//! The image in flash, read over and over: a bit of it that flips is noticed within some tenths of
//! a second, before or after it has done harm. Twelve times a second is not too often: read four
//! times, two flipped bits of 2,500 drove a rudder wrongly for more than 200 ms.
//!
//! The first pass, at start-up, gives the sums that the later passes must give too. They must be
//! those that the image was sealed with (`image-build/src/seal.rs`). An image that lost a bit while
//! nothing ran sends neutral pulses for a moment and is left to the bootloader. The later passes
//! run in small parts before the main loop sleeps, as long as nothing has asked for it.

use core::ptr::addr_of;

use super::wake;

unsafe extern "C" {
    static __vector_table: u32;
    /// Where the initial values of the statics lie in flash, behind everything else.
    static __sidata: u32;
    static __sdata: u32;
    static __edata: u32;
}

/// Where in the image its sums are: reserved exceptions. Zeros in an image that is not sealed.
const SEAL: core::ops::Range<usize> = 0x1C..0x24;
/// Words of a part, which nothing interrupts but interrupts: some 6 us.
const WORDS: usize = 64;
/// Of them, words that are read without a loop in between, which saves a third of the cycles.
const AT_ONCE: usize = 8;
/// Parts read before the loop sleeps: the image twelve times a second.
const PARTS: usize = 12;

/// Fletcher's sums of words, modulo 2^32: any one flipped bit changes them, and any two of
/// different words.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
struct Sums {
    plain: u32,
    weighted: u32,
}

impl Sums {
    fn add(&mut self, word: u32) {
        self.plain = self.plain.wrapping_add(word);
        self.weighted = self.weighted.wrapping_add(self.plain);
    }
}

/// The passes over the image.
pub(crate) struct ImageCheck {
    /// Of the first pass.
    expected: Sums,
    sums: Sums,
    /// The next word.
    at: usize,
}

impl ImageCheck {
    /// Reads the whole image, which takes 4 ms. `None` if it is not the one that was sealed.
    pub(crate) fn new() -> Option<Self> {
        let mut check = Self { expected: Sums::default(), sums: Sums::default(), at: begin() };
        check.restart();
        while check.at < end() {
            check.read_part();
        }
        let [plain, weighted] = [SEAL.start, SEAL.start + 4].map(|at| read(begin() + at));
        let seal = Sums { plain, weighted };
        let is_well = seal == Sums::default() || seal == check.sums;
        check.expected = check.sums;
        check.restart();
        is_well.then_some(check)
    }

    /// Begin a pass: with what lies before the seal.
    fn restart(&mut self) {
        self.sums = Sums::default();
        self.at = begin();
        while self.at < begin() + SEAL.start {
            self.sums.add(read(self.at));
            self.at += 4;
        }
        self.at = begin() + SEAL.end;
    }

    /// Read on until something asks for the main loop, some parts at most. `false` if the image is
    /// not what it was.
    // Not inlined: the main loop's registers are not for it.
    #[inline(never)]
    pub(crate) fn look_on(&mut self) -> bool {
        for _ in 0..PARTS {
            if wake::is_requested() {
                break;
            }
            self.read_part();
            if self.at >= end() {
                if self.sums != self.expected {
                    return false;
                }
                self.restart();
            }
        }
        true
    }

    fn read_part(&mut self) {
        let stop = end().min(self.at + 4 * WORDS);
        while self.at + 4 * AT_ONCE <= stop {
            // Written out, for the compiler, which is to save flash, keeps every loop.
            self.sums.add(read(self.at));
            self.sums.add(read(self.at + 4));
            self.sums.add(read(self.at + 8));
            self.sums.add(read(self.at + 12));
            self.sums.add(read(self.at + 16));
            self.sums.add(read(self.at + 20));
            self.sums.add(read(self.at + 24));
            self.sums.add(read(self.at + 28));
            self.at += 4 * AT_ONCE;
        }
        while self.at < stop {
            self.sums.add(read(self.at));
            self.at += 4;
        }
    }
}

/// A word of the image.
fn read(at: usize) -> u32 {
    // SAFETY: flash, aligned; volatile because the compiler knows nothing of its changes.
    unsafe { (at as *const u32).read_volatile() }
}

fn begin() -> usize {
    addr_of!(__vector_table) as usize
}

/// The first address behind the image.
fn end() -> usize {
    let statics = addr_of!(__edata) as usize - addr_of!(__sdata) as usize;
    addr_of!(__sidata) as usize + statics
}
