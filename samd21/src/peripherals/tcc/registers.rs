//! The registers as the bus reads and writes them.

use super::{
    BUFFERS, Bus, CCBV0, CPTENX, CTRLA_MODELLED, DIR, DONE, ENABLE, FAULT0, FAULT1, FAULTS, FLAGS,
    IDXCMD, LUPD, Lanes, ONESHOT, PATTBV, RESERVED, Read, Refusal, STATUS_STOP, SWRST, Tcc,
    WAVE_MODELLED, WEXCTRL_MODELLED, Write, busy,
};
use crate::board::Ticks;

impl Tcc {
    /// The registers that keep what they are given: where, and which of their bits exist.
    pub(super) fn stored(&mut self, offset: u32) -> Option<(&mut u32, u32)> {
        let index = |first: u32| ((offset - first) / 4) as usize;
        Some(match offset {
            0x0C | 0x10 => (&mut self.fctrl[index(0x0C)], 0x0FFF_7FFB),
            0x14 => (&mut self.extension.wexctrl, WEXCTRL_MODELLED),
            0x18 => (&mut self.extension.drvctrl, u32::MAX),
            0x1C => (&mut self.dbgctrl, 0x5_0000),
            0x20 => (&mut self.evctrl, 0x0F0F_F7FF),
            0x38 => (&mut self.extension.patt, 0xFFFF),
            0x3C => (&mut self.wave, WAVE_MODELLED),
            0x40 => (&mut self.per, self.max),
            0x44..=0x50 => (self.cc[..self.channels].get_mut(index(0x44))?, self.max),
            0x64 => (&mut self.extension.pattb, 0xFFFF),
            0x68 => (&mut self.waveb, WAVE_MODELLED),
            0x6C => (&mut self.perb, self.max),
            0x70..=0x7C => (self.ccb[..self.channels].get_mut(index(0x70))?, self.max),
            _ => return None,
        })
    }

    pub(crate) fn read(&mut self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => self.ctrla | u32::from(self.sync.is_busy(now, busy::SWRST)),
            0x04 => {
                let command =
                    if self.sync.is_busy(now, busy::CTRLB) { self.command << 5 } else { 0 };
                u32::from(self.ctrlb | command) * 0x0101
            }
            0x08 => self.sync.bits(now),
            0x24 | 0x28 | 0x2C => self.interrupts.read_words(offset - 0x24),
            0x30 => self.read_status(),
            0x34 => {
                let (from, count) = self.count_synced;
                let count = if now >= from { count } else { self.count_read };
                count << self.dither_bits()
            }
            _ => *self.stored(offset).ok_or(RESERVED)?.0,
        })
    }

    fn read_status(&self) -> u32 {
        // FAULTAIN and FAULTBIN, FAULTA and FAULTB.
        let faults = u32::from(self.has(0)) | u32::from(self.has(1)) << 1;
        let stop = if self.counter.stopped { STATUS_STOP } else { 0 };
        let faults = faults * 0x1100;
        stop | self.status | faults | u32::from(self.levels) << 24
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let done = self.write_register(bus, offset, lanes);
        self.follow(bus.now);
        done
    }

    fn write_register(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let now = bus.now;
        if !self.has_register(offset) {
            return Err(RESERVED);
        }
        match offset {
            0x00 => return self.write_ctrla(bus, lanes.merge(self.ctrla)),
            0x04 => {
                if let Some(clear) = lanes.byte(0)
                    && self.synchronise(bus, busy::CTRLB)
                {
                    self.ctrlb &= !clear;
                    self.turn(now);
                }
                if let Some(set) = lanes.byte(1) {
                    return self.write_ctrlbset(bus, set);
                }
            }
            0x08 => {}
            0x0C | 0x10 | 0x20 => {
                if lanes.bits() != 0 {
                    let what = "events, which FCTRLA, FCTRLB and EVCTRL are about";
                    return Err(Refusal::Unmodelled(what));
                }
            }
            0x28 if lanes.bits() & !(FLAGS & !FAULTS) != 0 => {
                return Err(Refusal::Unmodelled("this bit of INTENSET"));
            }
            0x24 | 0x28 | 0x2C => self.interrupts.write_words(offset - 0x24, lanes),
            0x30 => {
                let written = lanes.bits() & (BUFFERS | FAULT0 | FAULT1);
                let was_held = self.is_held();
                self.status &= !written;
                if was_held && !self.is_held() {
                    self.resume(now);
                }
            }
            0x34 => {
                if self.synchronise(bus, busy::COUNT) {
                    self.counter.halt(now);
                    self.counter.held = (lanes.merge(0) & self.max) >> self.dither_bits();
                    self.count_read = self.counter.held;
                    self.count_synced = (now, self.counter.held);
                    self.resume(now);
                }
            }
            _ => return self.write_stored(bus, offset, lanes),
        }
        DONE
    }

    /// WEXCTRL and DRVCTRL are enable-protected; those from PATT on are synchronised.
    fn write_stored(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let (register, bits) = self.stored(offset).ok_or(RESERVED)?;
        let value = lanes.merge(*register);
        let has_others = value & !bits != 0;
        match offset {
            0x14 if has_others => return Err(Refusal::Unmodelled("this bit of WEXCTRL")),
            0x3C | 0x68 if has_others || value & 7 == 3 || value & 0x30 == 0x30 => {
                return Err(Refusal::Unmodelled("a reserved value of WAVE"));
            }
            _ => {}
        }
        let is_taken = match offset {
            0x14 | 0x18 => self.is_open(bus),
            0x1C => true,
            _ => self.synchronise(bus, ((offset - 0x24) / 4) as usize),
        };
        if is_taken && let Some((register, bits)) = self.stored(offset) {
            *register = value & bits;
            self.take_over(bus, offset, value & bits);
        }
        DONE
    }

    /// A register has its new value.
    fn take_over(&mut self, bus: &mut Bus<'_>, offset: u32, value: u32) {
        let first = if offset < 0x70 { 0x44 } else { 0x70 };
        let channel = offset.saturating_sub(first) / 4;
        match offset {
            0x3C => self.turn(bus.now),
            0x40..=0x50 => self.schedule(bus.now),
            0x64..=0x6C => self.status |= PATTBV << ((offset - 0x64) / 4),
            0x70..=0x7C => self.status |= CCBV0 << channel,
            _ => {}
        }
        if matches!(offset, 0x44..=0x50 | 0x70..=0x7C) {
            let (tcc, channel) = (self.index as u8, channel as u8);
            bus.board.compare(bus.now, tcc, channel, value);
        }
    }

    /// Whether this timer has the register (table 31-1): of WEXCTRL and PATT, TCC0 has both and
    /// TCC1 the second.
    pub(super) fn has_register(&self, offset: u32) -> bool {
        match offset {
            0x14 => self.index == 0,
            0x38 | 0x64 => self.index < 2,
            _ => true,
        }
    }

    /// Whether an enable-protected register may be written.
    fn is_open(&self, bus: &mut Bus<'_>) -> bool {
        let is_open = self.ctrla & ENABLE == 0;
        if !is_open {
            bus.note(self.name(), "enable-protected register written while enabled: discarded");
        }
        is_open
    }

    fn write_ctrla(&mut self, bus: &mut Bus<'_>, value: u32) -> Write {
        if value & SWRST != 0 {
            if self.synchronise(bus, busy::SWRST) {
                self.software_reset();
            }
            return DONE;
        }
        if value & !(ENABLE | CTRLA_MODELLED | self.ctrla & CPTENX) != 0 {
            return Err(Refusal::Unmodelled("this bit of CTRLA"));
        }
        let was_enabled = self.ctrla & ENABLE != 0;
        let enables = value & ENABLE != 0;
        if was_enabled != enables && !self.synchronise(bus, busy::ENABLE) {
            return DONE;
        }
        bus.write_ctrla(self.name(), &mut self.ctrla, value, CTRLA_MODELLED | CPTENX);
        match (was_enabled, enables) {
            (false, true) => self.enable(bus.now),
            (true, false) => {
                self.counter.stop(bus.now);
                self.ctrla &= !ENABLE;
            }
            _ => {}
        }
        DONE
    }

    fn write_ctrlbset(&mut self, bus: &mut Bus<'_>, set: u8) -> Write {
        let command = set >> 5;
        if command > 4 {
            return Err(Refusal::Unmodelled("this command of CTRLBSET"));
        }
        if !self.synchronise(bus, busy::CTRLB) {
            return DONE;
        }
        self.ctrlb |= set & (DIR | LUPD | ONESHOT | IDXCMD);
        self.turn(bus.now);
        self.carry_out(bus.now, command);
        DONE
    }

    /// Starts a register's synchronisation; false, and noted, if one is still going on: then the
    /// write is discarded (D21-114).
    fn synchronise(&mut self, bus: &mut Bus<'_>, bit: usize) -> bool {
        if self.sync.is_busy(bus.now, bit) {
            bus.note(self.name(), "a register written while it synchronises: discarded");
            return false;
        }
        self.sync.begin(bus.now, bit);
        true
    }
}
