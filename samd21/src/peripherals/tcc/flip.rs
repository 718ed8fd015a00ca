//! Bits that flip: see [`upset`](crate::upset). Nothing protects a register from that.

use super::{ALOCK, BUFFERS, CPTENX, DIR, ENABLE, FAULT0, FAULT1, FLAGS, IDX, IDXCMD, LUPD};
use super::{CTRLA_MODELLED, ONESHOT, STATUS_STOP, SWRST, Tcc};
use crate::board::Ticks;

impl Tcc {
    /// A bit of a register flips; `false`, and nothing happens, if there is no such bit.
    pub(crate) fn flip(&mut self, now: Ticks, offset: u32, bit: u32) -> bool {
        let mask = 1 << bit;
        // Of STATUS: the bits that are more than what others show.
        let existing = match offset {
            0x00 => SWRST | ENABLE | CTRLA_MODELLED | ALOCK | CPTENX,
            0x04 => 0xFF,
            0x28 | 0x2C => FLAGS,
            0x30 => STATUS_STOP | IDX | FAULT0 | FAULT1 | BUFFERS,
            0x34 => self.max,
            _ => self.stored(offset).map_or(0, |(_, bits)| bits),
        };
        let exists = self.has_register(offset) && existing & mask != 0;
        if exists {
            self.flip_existing(now, offset, mask);
            self.follow(now);
        }
        exists
    }

    fn flip_existing(&mut self, now: Ticks, offset: u32, mask: u32) {
        match offset {
            0x00 if mask == SWRST => self.software_reset(),
            0x00 => self.change(now, |timer| timer.ctrla ^= mask),
            0x04 if mask <= u32::from(DIR | LUPD | ONESHOT | IDXCMD) => {
                self.ctrlb ^= mask as u8;
                self.turn(now);
            }
            0x04 => self.carry_out(now, (mask >> 5) as u8),
            0x28 => {
                self.interrupts.flip(mask);
                return;
            }
            0x2C => self.interrupts.flags ^= mask,
            0x30 if mask == STATUS_STOP => {
                self.change(now, |timer| timer.counter.stopped ^= true);
            }
            0x30 => self.change(now, |timer| timer.status ^= mask),
            0x34 => self.change(now, |timer| timer.counter.held ^= mask >> timer.dither_bits()),
            0x0C | 0x10 | 0x20 => self.change(now, |timer| timer.toggle(offset, mask)),
            0x3C => {
                self.toggle(offset, mask);
                self.turn(now);
            }
            _ => self.toggle(offset, mask),
        }
        self.schedule(now);
    }

    fn toggle(&mut self, offset: u32, mask: u32) {
        if let Some((register, _)) = self.stored(offset) {
            *register ^= mask;
        }
    }

    /// Halts the counter, changes what it depends on, and lets it count on.
    fn change(&mut self, now: Ticks, change: impl FnOnce(&mut Self)) {
        self.counter.halt(now);
        change(self);
        self.resume(now);
    }
}
