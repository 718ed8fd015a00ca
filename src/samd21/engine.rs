//! The DSU's engine for CRC-32, which reads the image beside the core (data sheet, 13.11.3).

use atsamd_hal::pac;

use super::image_check::{SEAL, SLICE, begin, end, read};
use super::time::{now, within};

/// Longest time of a slice, us: it ends before the next tick.
const SLICE_US: u64 = 4_000;
/// Steps that a slice may take: flash that is written holds it up.
const PATIENCE: u8 = 10;
/// The DSU's bit in PAC1.
const DSU: u32 = 1 << 1;

/// The engine, and how far it is in its pass over the image.
pub(crate) struct Engine {
    dsu: pac::Dsu,
    pac: pac::Pac1,
    /// The end of the slice that it reads.
    at: usize,
    /// Steps since that slice began.
    waited: u8,
    /// Length of the pass at start-up, us.
    pass_us: u16,
}

impl Engine {
    /// The engine at rest.
    pub(crate) fn new(dsu: pac::Dsu, pac: pac::Pac1) -> Self {
        Self { dsu, pac, at: 0, waited: 0, pass_us: 0 }
    }

    /// Reads the image once. `None` if the sum does not come, or is not that of the seal.
    pub(super) fn started(mut self) -> Option<Self> {
        let began = now();
        self.restart();
        loop {
            if !within(SLICE_US, || self.is_done()) || !self.go_on() {
                return None;
            }
            // The pass is over where the next one has begun.
            if self.at == begin() + SEAL.end {
                self.pass_us = now().since(began) as u16;
                return Some(self);
            }
        }
    }

    /// Length of the pass at start-up, us.
    pub(super) fn pass_us(&self) -> u32 {
        self.pass_us.into()
    }

    fn is_done(&self) -> bool {
        self.dsu.statusa().read().done().bit_is_set()
    }

    /// Takes what the engine has summed, and has it read the next slice. `false` if the sum is
    /// wrong or does not come.
    pub(super) fn go_on(&mut self) -> bool {
        if !self.is_done() {
            self.waited += 1;
            return self.waited < PATIENCE;
        }
        let sum = self.dsu.data().read().bits();
        let from = self.at;
        if from < end() {
            self.at = end().min(from + SLICE);
            self.sum(from, self.at, sum);
            return true;
        }
        self.restart();
        sum == read(begin() + SEAL.end - 4)
    }

    /// Begins a pass: what lies before the seal. What lies in it is left out.
    fn restart(&mut self) {
        self.sum(begin(), begin() + SEAL.start, u32::MAX);
        self.at = begin() + SEAL.end;
    }

    /// Has the engine read these addresses and add them to a sum.
    fn sum(&mut self, from: usize, end: usize, sum: u32) {
        self.waited = 0;
        // SAFETY: the engine reads flash and writes nothing.
        unsafe {
            // A write to a protected peripheral is a fault, and so is clearing a clear bit.
            if self.pac.wpclr().read().bits() & DSU != 0 {
                self.pac.wpclr().write(|w| w.bits(DSU));
            }
            self.dsu.addr().write(|w| w.bits(from as u32));
            self.dsu.length().write(|w| w.bits((end - from) as u32));
            self.dsu.data().write(|w| w.bits(sum));
            self.dsu.statusa().write(|w| w.bits(u8::MAX));
            self.dsu.ctrl().write(|w| w.crc().set_bit());
        }
    }
}
