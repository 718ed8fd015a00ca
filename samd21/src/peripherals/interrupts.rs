//! INTENCLR, INTENSET and INTFLAG, which most peripherals have alike.

use super::access::Lanes;
use super::map::{Block, entry};

/// Flags, those of them that are enabled, and the interrupt that they request. `FLAGS` are the
/// flags that can be enabled.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Interrupts<const FLAGS: u32> {
    /// The NVIC's line as a bit mask.
    line: u32,
    /// INTFLAG.
    pub(super) flags: u32,
    pub(super) enabled: u32,
}

impl<const FLAGS: u32> Interrupts<FLAGS> {
    pub(super) fn of(block: Block) -> Self {
        Self { line: entry(block).irq, ..Self::default() }
    }

    /// Whether an enabled flag is set.
    pub(super) fn is_requested(&self) -> bool {
        self.flags & self.enabled != 0
    }

    /// The NVIC's line if an enabled flag is set, else 0.
    pub(super) fn irq(&self) -> u32 {
        self.irq_if(self.is_requested())
    }

    /// The NVIC's line if it is `requested`, else 0.
    pub(super) fn irq_if(&self, requested: bool) -> u32 {
        if requested { self.line } else { 0 }
    }

    /// Bits of the enables flip; `false` if none of them exists.
    pub(super) fn flip(&mut self, bits: u32) -> bool {
        self.enabled ^= bits & FLAGS;
        bits & FLAGS != 0
    }

    /// INTENCLR is written.
    pub(super) fn disable(&mut self, bits: u32) {
        self.enabled &= !bits;
    }

    /// INTENSET is written.
    pub(super) fn enable(&mut self, bits: u32) {
        self.enabled |= bits & FLAGS;
    }

    /// Reads the triple where each register has a word of its own, INTENCLR at `offset` 0.
    pub(super) fn read_words(&self, offset: u32) -> u32 {
        match offset {
            0 | 4 => self.enabled,
            _ => self.flags,
        }
    }

    /// Writes the triple where each register has a word of its own, INTENCLR at `offset` 0.
    pub(super) fn write_words(&mut self, offset: u32, lanes: Lanes) {
        match offset {
            0 => self.disable(lanes.bits()),
            4 => self.enable(lanes.bits()),
            _ => self.flags &= !lanes.bits(),
        }
    }

    /// Reads the triple where each register is a byte, INTENCLR in byte 0 of the word.
    pub(super) fn read_bytes(&self) -> u32 {
        (self.enabled * 0x0101) | self.flags << 16
    }

    /// Writes the triple where each register is a byte, INTENCLR in byte 0 of the word.
    pub(super) fn write_bytes(&mut self, lanes: Lanes) {
        let bits = lanes.bits();
        self.disable(bits & 0xFF);
        self.enable(bits >> 8 & 0xFF);
        self.flags &= !(bits >> 16 & 0xFF);
    }
}
