//! The registers as the bus reads and writes them.

use super::{
    BUFFERS, Bus, CCBV0, CPTENX, CTRLA_MODELLED, DIR, DONE, ENABLE, FAULT0, FAULT1, FAULTS, FLAGS,
    IDXCMD, LUPD, Lanes, ONESHOT, PATTBV, PERBV, RESERVED, Read, Refusal, STATUS_STOP, SWRST, Tcc,
    WAVE_MODELLED, WAVEBV, WEXCTRL_MODELLED, Write, busy,
};
use crate::board::Ticks;

impl Tcc {
    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => self.ctrla | u32::from(self.sync.is_busy(now, busy::SWRST)),
            0x04 => {
                let command = if self.sync.is_busy(now, busy::CTRLB) {
                    self.command << 5
                } else {
                    0
                };
                u32::from(self.ctrlb | command) * 0x0101
            }
            0x08 => self.sync.bits(now),
            0x0C => self.fctrl[0],
            0x10 => self.fctrl[1],
            0x14 => self.extension.wexctrl,
            0x18 => self.extension.drvctrl,
            0x1C => self.dbgctrl,
            0x20 => self.evctrl,
            0x24 | 0x28 | 0x2C => self.interrupts.read_words(offset - 0x24),
            0x30 => self.read_status(),
            0x34 => {
                let (from, count) = self.count_synced;
                let count = if now >= from { count } else { self.count_read };
                count << self.dither_bits()
            }
            0x38 => self.extension.patt,
            0x3C => self.wave,
            0x40 => self.per,
            0x44..=0x50 => self.cc[self.channel(offset, 0x44)?],
            0x64 => self.extension.pattb,
            0x68 => self.waveb,
            0x6C => self.perb,
            0x70..=0x7C => self.ccb[self.channel(offset, 0x70)?],
            _ => return Err(RESERVED),
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
            0x14 => {
                let wexctrl = lanes.merge(self.extension.wexctrl);
                if wexctrl & !WEXCTRL_MODELLED != 0 {
                    return Err(Refusal::Unmodelled("this bit of WEXCTRL"));
                }
                if self.is_open(bus) {
                    self.extension.wexctrl = wexctrl;
                }
            }
            0x18 => {
                if self.is_open(bus) {
                    self.extension.drvctrl = lanes.merge(self.extension.drvctrl);
                }
            }
            0x1C => self.dbgctrl = lanes.merge(self.dbgctrl) & 0x5_0000,
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
            0x38 => {
                if self.synchronise(bus, busy::PATT) {
                    self.extension.patt = lanes.merge(self.extension.patt) & 0xFFFF;
                }
            }
            0x64 => {
                if self.synchronise(bus, busy::PATTB) {
                    self.extension.pattb = lanes.merge(self.extension.pattb) & 0xFFFF;
                    self.status |= PATTBV;
                }
            }
            0x3C | 0x68 => return self.write_wave(bus, offset, lanes),
            0x40 => {
                if self.synchronise(bus, busy::PER) {
                    self.per = lanes.merge(self.per) & self.max;
                    self.schedule(now);
                }
            }
            0x44..=0x50 => {
                let channel = self.channel(offset, 0x44)?;
                if self.synchronise(bus, busy::CC0 + channel) {
                    self.cc[channel] = lanes.merge(self.cc[channel]) & self.max;
                    self.schedule(now);
                    self.tell(bus, channel, self.cc[channel]);
                }
            }
            0x6C => {
                if self.synchronise(bus, busy::PERB) {
                    self.perb = lanes.merge(self.perb) & self.max;
                    self.status |= PERBV;
                }
            }
            0x70..=0x7C => {
                let channel = self.channel(offset, 0x70)?;
                if self.synchronise(bus, busy::CCB0 + channel) {
                    self.ccb[channel] = lanes.merge(self.ccb[channel]) & self.max;
                    self.status |= CCBV0 << channel;
                    self.tell(bus, channel, self.ccb[channel]);
                }
            }
            _ => return Err(RESERVED),
        }
        DONE
    }

    fn tell(&self, bus: &mut Bus<'_>, channel: usize, count: u32) {
        let (tcc, channel) = (self.index as u8, channel as u8);
        bus.board.compare(bus.now, tcc, channel, count);
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

    fn write_wave(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let (register, bit) = match offset {
            0x3C => (&mut self.wave, busy::WAVE),
            _ => (&mut self.waveb, busy::WAVEB),
        };
        let value = lanes.merge(*register);
        let is_reserved = value & 7 == 3 || value & 0x30 == 0x30;
        if value & !WAVE_MODELLED != 0 || is_reserved {
            return Err(Refusal::Unmodelled("a reserved value of WAVE"));
        }
        if self.synchronise(bus, bit) {
            if offset == 0x3C {
                self.wave = value;
                self.turn(bus.now);
            } else {
                self.waveb = value;
                self.status |= WAVEBV;
            }
        }
        DONE
    }

    /// Whether an enable-protected register may be written.
    fn is_open(&self, bus: &mut Bus<'_>) -> bool {
        let is_open = self.ctrla & ENABLE == 0;
        if !is_open {
            let what = "enable-protected register written while enabled: discarded";
            bus.note(self.name(), what);
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
        let fields = CTRLA_MODELLED | CPTENX;
        bus.write_ctrla(self.name(), &mut self.ctrla, value, fields);
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
            let what = "a register written while it synchronises: discarded";
            bus.note(self.name(), what);
            return false;
        }
        self.sync.begin(bus.now, bit);
        true
    }
}
