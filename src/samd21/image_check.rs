//! Checks the image in flash twenty times a second, so that a flipped bit is found within 50 ms. At
//! four times a second, two flipped bits of 2,500 drive a rudder wrongly for more than 200 ms.
//!
//! The DSU's engine reads the image beside the core, a slice after each step ([`Engine`]). Its
//! checksum must be the one that the image was sealed with (`image-build/src/seal.rs`). If the
//! checksum differs or does not come, the core reads the image and its own checksum decides: an
//! engine that fails ends no flight. From then on the core reads the slices.
//!
//! An image that lost a bit while nothing ran sends neutral pulses for a moment and is left to the
//! bootloader.

use core::ops::Range;
use core::ptr::addr_of;

use super::engine::Engine;

unsafe extern "C" {
    static __vector_table: u32;
    /// Where the initial values of the statics lie in flash, behind everything else.
    static __sidata: u32;
    static __sdata: u32;
    static __edata: u32;
}

/// Where in the image its checksums are, the core's two and the engine's: reserved exceptions.
/// Zeros in an image that is not sealed.
pub(super) const SEAL: Range<usize> = 0x1C..0x28;
/// Bytes read behind a step.
pub(super) const SLICE: usize = 16 * 1024;

/// Fletcher's checksums of words, modulo 2^32: any one flipped bit changes them, and any two of
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
    /// Reads for the core, as long as it is right.
    engine: Option<Engine>,
    /// Of the core's passes.
    expected: Sums,
    sums: Sums,
    /// The core's next word.
    at: usize,
}

impl ImageCheck {
    /// Has the image read once: 2 ms by the engine, 6 ms by the core. `None` if it is not the image
    /// that was sealed.
    pub(crate) fn new(engine: Engine) -> Option<Self> {
        let [plain, weighted] = [0, 4].map(|at| read(begin() + SEAL.start + at));
        let expected = Sums { plain, weighted };
        let mut check =
            Self { engine: engine.started(), expected, sums: Sums::default(), at: begin() };
        if check.engine.is_none() && !check.read_all() {
            check.expected = check.sums;
            return (expected == Sums::default()).then_some(check);
        }
        Some(check)
    }

    /// How long the engine took for its pass at start-up, us; 0 where the core reads.
    pub(crate) fn engine_us(&self) -> u32 {
        self.engine.as_ref().map_or(0, Engine::pass_us)
    }

    /// Behind a step: the next slice. `false` if the image is not what it was.
    pub(crate) fn go_on(&mut self) -> bool {
        match &mut self.engine {
            None => self.read_slice(),
            Some(engine) => {
                engine.go_on() || {
                    self.engine = None;
                    self.read_all()
                }
            }
        }
    }

    /// Reads all of the image by the core: whether it is what it was.
    #[inline(never)]
    fn read_all(&mut self) -> bool {
        self.at = begin();
        loop {
            let is_well = self.read_slice();
            if self.at == begin() {
                return is_well;
            }
        }
    }

    /// Reads a slice by the core, 1 ms. `false` if it was the last one and a checksum is wrong.
    fn read_slice(&mut self) -> bool {
        if self.at == begin() {
            self.sums = Sums::default();
        }
        let stop = end().min(self.at + SLICE);
        while self.at < stop {
            self.sums.add(read(self.at));
            self.at += 4;
            if self.at == begin() + SEAL.start {
                self.at = begin() + SEAL.end;
            }
        }
        if self.at < end() {
            return true;
        }
        self.at = begin();
        self.sums == self.expected
    }
}

/// A word of the image.
pub(super) fn read(at: usize) -> u32 {
    // SAFETY: flash, aligned; volatile because the compiler knows nothing of its changes.
    unsafe { (at as *const u32).read_volatile() }
}

pub(super) fn begin() -> usize {
    addr_of!(__vector_table) as usize
}

/// The first address behind the image.
pub(super) fn end() -> usize {
    let statics = addr_of!(__edata) as usize - addr_of!(__sdata) as usize;
    addr_of!(__sidata) as usize + statics
}
