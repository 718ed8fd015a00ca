//! One access of the bus, as a peripheral sees it.
//!
//! Registers are grouped by 32-bit words. A read gives the whole word and the bus takes its part of
//! it. In a write [`Lanes`] say which bytes of the word it drives, so that byte and half-word
//! writes reach the registers that they name and no others.

pub(crate) use super::error::Refusal;
use super::violations::Violations;
use crate::board::{Board, Ticks};

/// What is around a peripheral while it acts.
pub(crate) struct Bus<'a> {
    /// The time of the access or event.
    pub(crate) now: Ticks,
    /// What is soldered round the chip.
    pub(crate) board: &'a mut dyn Board,
    /// Where misuse that the chip silently ignores is noted.
    pub(crate) violations: &'a mut Violations,
}

impl Bus<'_> {
    /// At `now`, with nothing soldered round the chip.
    #[cfg(test)]
    pub(crate) fn alone<T>(now: Ticks, act: impl FnOnce(&mut Bus<'_>) -> T) -> T {
        let board = &mut crate::board::Unconnected;
        act(&mut Bus { now, board, violations: &mut Violations::default() })
    }

    /// Notes misuse of a peripheral.
    pub(crate) fn note(&mut self, peripheral: &'static str, what: &'static str) {
        self.violations.note(self.now, peripheral, what);
    }

    /// Writes all but ENABLE of the CTRLA of a timer or SERCOM. Its fields, `modelled`, are
    /// protected while ENABLE is set.
    pub(crate) fn write_ctrla(
        &mut self,
        peripheral: &'static str,
        ctrla: &mut u32,
        value: u32,
        modelled: u32,
    ) {
        if *ctrla & ENABLE != 0 && (*ctrla ^ value) & modelled != 0 {
            self.note(peripheral, "enable-protected CTRLA written while enabled: discarded");
        } else {
            *ctrla = value & modelled | *ctrla & ENABLE;
        }
    }
}

/// CTRLA.SWRST of timers and SERCOMs.
pub(crate) const SWRST: u32 = 1 << 0;
/// CTRLA.ENABLE of timers and SERCOMs.
pub(crate) const ENABLE: u32 = 1 << 1;

/// The value of the word read.
pub(crate) type Read = Result<u32, Refusal>;

/// How long the write stalls the bus.
pub(crate) type Write = Result<Ticks, Refusal>;

/// A write that takes no longer than the bus itself.
pub(crate) const DONE: Write = Ok(Ticks::ZERO);

/// A reserved offset.
pub(crate) const RESERVED: Refusal = Refusal::Unmodelled("a reserved offset");

/// The bytes of a word that a write drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Lanes {
    value: u32,
    mask: u32,
}

impl Lanes {
    /// `value` of `bytes` (1, 2 or 4) bytes at byte `offset` (0 to 3) of the word.
    pub(crate) fn new(value: u32, offset: u32, bytes: u32) -> Self {
        let mask = (u32::MAX >> (32 - 8 * bytes)) << (8 * offset);
        Self { value: (value << (8 * offset)) & mask, mask }
    }

    /// `old` with the written bytes replaced.
    pub(crate) fn merge(self, old: u32) -> u32 {
        (old & !self.mask) | self.value
    }

    /// The written bits, zero where nothing is written: for set, clear and write-one registers.
    pub(crate) fn bits(self) -> u32 {
        self.value
    }

    /// Byte `index` of the word, if written.
    pub(crate) fn byte(self, index: u32) -> Option<u8> {
        (self.mask >> (8 * index) & 0xFF != 0).then_some((self.value >> (8 * index)) as u8)
    }

    /// Writes the driven bytes, as far as their bits exist, to the first four of `bytes`.
    pub(crate) fn store(self, bytes: &mut [u8], existing: u8) {
        for (index, byte) in (0..4).zip(bytes) {
            *byte = self.byte(index).map_or(*byte, |value| value & existing);
        }
    }

    /// The low (0) or high (1) half of the word if any of it is written; a byte not written reads
    /// as in `old`.
    pub(crate) fn half(self, index: u32, old: u16) -> Option<u16> {
        let shift = 16 * index;
        let mask = (self.mask >> shift) as u16;
        (mask != 0).then_some((old & !mask) | (self.value >> shift) as u16 & mask)
    }

    /// Whether any bit of `mask` is written.
    pub(crate) fn touches(self, mask: u32) -> bool {
        self.mask & mask != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Lanes {
        /// A write of the whole word.
        pub(crate) fn word(value: u32) -> Self {
            Self::new(value, 0, 4)
        }
    }

    #[test]
    fn lanes_reach_the_bytes_they_name() {
        let byte = Lanes::new(0xAB, 1, 1);
        assert_eq!(byte.byte(0), None);
        assert_eq!(byte.byte(1), Some(0xAB));
        assert_eq!(byte.merge(0x1122_3344), 0x1122_AB44);
        assert_eq!(byte.half(0, 0x5566), Some(0xAB66));
        assert_eq!(byte.half(1, 0), None);
        let half = Lanes::new(0x1234_CDEF, 2, 2);
        assert_eq!(half.merge(0), 0xCDEF_0000);
        assert_eq!(half.bits(), 0xCDEF_0000);
        assert!(!half.touches(0xFFFF));
    }
}
