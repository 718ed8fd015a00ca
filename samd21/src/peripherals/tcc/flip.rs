//! Bits that flip: see [`upset`](crate::upset). Nothing protects a register from that.

use super::{ALOCK, BUFFERS, CPTENX, DIR, ENABLE, FAULT0, FAULT1, FLAGS, IDX, IDXCMD, LUPD};
use super::{CTRLA_MODELLED, ONESHOT, STATUS_STOP, SWRST, Tcc, WAVE_MODELLED, WEXCTRL_MODELLED};
use crate::board::Ticks;

/// Bits of the registers of a timer, by offset: those that exist. STATUS: those that are more than
/// what others show.
fn existing(offset: u32) -> u32 {
    match offset {
        0x00 => SWRST | ENABLE | CTRLA_MODELLED | ALOCK | CPTENX,
        0x04 => 0xFF,
        0x0C | 0x10 => 0x0FFF_7FFB,
        0x14 => WEXCTRL_MODELLED,
        0x18 => u32::MAX,
        0x1C => 0x5_0000,
        0x20 => 0x0F0F_F7FF,
        0x28 | 0x2C => FLAGS,
        0x30 => STATUS_STOP | IDX | FAULT0 | FAULT1 | BUFFERS,
        0x38 | 0x64 => 0xFFFF,
        0x3C | 0x68 => WAVE_MODELLED,
        0x34 | 0x40..=0x50 | 0x6C..=0x7C => 0xFF_FFFF,
        _ => 0,
    }
}

impl Tcc {
    /// A bit of a register flips; `false`, and nothing happens, if there is no such bit.
    pub(crate) fn flip(&mut self, now: Ticks, offset: u32, bit: u32) -> bool {
        let mask = 1 << bit;
        let counts = matches!(offset, 0x34 | 0x40..=0x50 | 0x6C..=0x7C);
        let exists = self.has_register(offset)
            && existing(offset) & mask != 0
            && (!counts || mask <= self.max);
        exists && self.flip_existing(now, offset, mask) && {
            self.follow(now);
            true
        }
    }

    fn flip_existing(&mut self, now: Ticks, offset: u32, mask: u32) -> bool {
        match offset {
            0x00 if mask == SWRST => self.software_reset(),
            0x00 => self.change(now, |timer| timer.ctrla ^= mask),
            0x04 if mask <= u32::from(DIR | LUPD | ONESHOT | IDXCMD) => {
                self.ctrlb ^= mask as u8;
                self.turn(now);
            }
            0x04 => self.carry_out(now, (mask >> 5) as u8),
            0x0C => self.change(now, |timer| timer.fctrl[0] ^= mask),
            0x10 => self.change(now, |timer| timer.fctrl[1] ^= mask),
            0x14 => self.extension.wexctrl ^= mask,
            0x18 => self.extension.drvctrl ^= mask,
            0x1C => self.dbgctrl ^= mask,
            0x20 => self.change(now, |timer| timer.evctrl ^= mask),
            0x28 => return self.interrupts.flip(mask),
            0x2C => self.interrupts.flags ^= mask,
            0x30 if mask == STATUS_STOP => {
                self.change(now, |timer| timer.counter.stopped ^= true);
            }
            0x30 => self.change(now, |timer| timer.status ^= mask),
            0x34 => self.change(now, |timer| {
                timer.counter.held ^= mask >> timer.dither_bits()
            }),
            0x38 => self.extension.patt ^= mask,
            0x3C => {
                self.wave ^= mask;
                self.turn(now);
            }
            0x40 => self.per ^= mask,
            0x44..=0x50 => match self.channel(offset, 0x44) {
                Ok(channel) => self.cc[channel] ^= mask,
                Err(_) => return false,
            },
            0x64 => self.extension.pattb ^= mask,
            0x68 => self.waveb ^= mask,
            0x6C => self.perb ^= mask,
            _ => match self.channel(offset, 0x70) {
                Ok(channel) => self.ccb[channel] ^= mask,
                Err(_) => return false,
            },
        }
        self.schedule(now);
        true
    }

    /// Halts the counter, changes what it depends on, and lets it count on.
    fn change(&mut self, now: Ticks, change: impl FnOnce(&mut Self)) {
        self.counter.halt(now);
        change(self);
        self.resume(now);
    }
}
