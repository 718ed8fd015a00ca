//! ADC, as far as start-up code needs it: its registers are stored, and a conversion gives half of
//! its range at once.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE |
//! | 04 | CTRLB | stored; RESSEL says how wide a result is |
//! | 0C | SWTRIG | START: a conversion |
//! | 16, 17, 18 | INTENCLR, INTENSET, INTFLAG | RESRDY; cleared by ones |
//! | 19 | STATUS | SYNCBUSY reads 0 |
//! | 1A | RESULT | half of the range |
//! | others up to 2A | | stored |
//!
//! Left out: what is at the pins, references, averages, windows, events, and that a read of RESULT
//! clears RESRDY.

use super::access::{Bus, DONE, ENABLE, Lanes, RESERVED, Read, SWRST, Write};
use super::interrupts::Interrupts;
use super::map::Block;

const RESRDY: u32 = 1 << 0;
const START: u8 = 1 << 1;
/// Words up to DBGCTRL.
const WORDS: usize = 11;

#[derive(Clone, Debug)]
pub(crate) struct Adc {
    registers: [u32; WORDS],
    result: u16,
    pub(crate) interrupts: Interrupts<0xF>,
}

impl Adc {
    pub(crate) fn new() -> Self {
        Self { registers: [0; WORDS], result: 0, interrupts: Interrupts::of(Block::Adc) }
    }

    pub(crate) fn read(&self, offset: u32) -> Read {
        let stored = *self.registers.get(offset as usize / 4).ok_or(RESERVED)?;
        Ok(match offset {
            0x14 => stored | (self.interrupts.enabled * 0x0101_0000),
            0x18 => self.interrupts.flags | u32::from(self.result) << 16,
            _ => stored,
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let stored = self.registers.get_mut(offset as usize / 4).ok_or(RESERVED)?;
        match offset {
            0x00 if lanes.bits() & SWRST != 0 => *self = Self::new(),
            0x0C if lanes.byte(0).is_some_and(|trigger| trigger & START != 0) => {
                if self.registers[0] & ENABLE == 0 {
                    bus.note("ADC", "a conversion while disabled: ignored");
                } else {
                    // RESSEL: 12, 16, 10 or 8 bits.
                    self.result =
                        [0x800, 0x8000, 0x200, 0x80][(self.registers[1] >> 4 & 3) as usize];
                    self.interrupts.flags |= RESRDY;
                }
            }
            0x14 => {
                *stored = lanes.merge(*stored) & 0xFF;
                self.interrupts.disable(lanes.bits() >> 16 & 0xFF);
                self.interrupts.enable(lanes.bits() >> 24);
            }
            0x18 => self.interrupts.flags &= !(lanes.bits() & 0xFF),
            _ => *stored = lanes.merge(*stored),
        }
        DONE
    }
}
