//! TCC0 to TCC2: timer/counters for control applications.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE, PRESCALER; other fields only 0 (RUNSTDBY, PRESCSYNC stored) |
//! | 04, 05 | CTRLBCLR, CTRLBSET | LUPD, ONESHOT, CMD: RETRIGGER, STOP, UPDATE, READSYNC; DIR only up |
//! | 08 | SYNCBUSY | one flag a register; a second write meanwhile is discarded and noted |
//! | 24, 28, 2C | INTENCLR, INTENSET, INTFLAG | OVF, TRG, ERR, MC0-MC3 |
//! | 30 | STATUS | STOP, PERBV, CCBVx |
//! | 34 | COUNT | writing sets it; reading gives what the last READSYNC saw |
//! | 3C | WAVE | WAVEGEN NFRQ or NPWM, POLx |
//! | 40, 44-50 | PER, CCx | take effect at once |
//! | 6C, 70-7C | PERB, CCBx | copied to PER and CCx at overflow unless LUPD |
//!
//! TCC0 and TCC1 count 24 bits, TCC2 16; TCC0 has four channels, the others two; WO\[n\] follows
//! channel n modulo that number. The output is match-driven (D21-717): it rises at overflow and
//! falls when COUNT meets CC. So a CC written below COUNT while the pin is high finds no match: the
//! pin stays high for the rest of the cycle and until the match in the next.
//!
//! | left out | why |
//! |---|---|
//! | other waveforms, down-counting, ramps, dithering, dead time, swap, pattern, capture | not modelled: setting one faults |
//! | recoverable and non-recoverable faults, events, DMA | no event system is modelled |
//! | CNT interrupt, STATUS.CMPx, STATUS.IDX | belong to what is left out |

#[cfg(test)]
mod tests;

use super::access::{Bus, DONE, ENABLE, Lanes, RESERVED, Read, Refusal, SWRST, Write};
use super::clock::{Rate, SyncFlags};
use super::counter::Counter;
use super::interrupts::Interrupts;
use super::map::{Block, entry};
use crate::SyncHold;
use crate::board::Ticks;

/// CTRLA: PRESCALER, RUNSTDBY, PRESCSYNC.
const CTRLA_MODELLED: u32 = 0x3F00;

const DIR: u8 = 1 << 0;
const LUPD: u8 = 1 << 1;
const ONESHOT: u8 = 1 << 2;

const OVF: u32 = 1 << 0;
const TRG: u32 = 1 << 1;
const ERR: u32 = 1 << 3;
const MC0: u32 = 1 << 16;
const MCX: u32 = 0xF << 16;

const STATUS_STOP: u32 = 1 << 0;
const PERBV: u32 = 1 << 7;
const CCBV0: u32 = 1 << 16;

/// Bits of SYNCBUSY.
mod busy {
    pub(super) const SWRST: usize = 0;
    pub(super) const ENABLE: usize = 1;
    pub(super) const CTRLB: usize = 2;
    pub(super) const COUNT: usize = 4;
    pub(super) const WAVE: usize = 6;
    pub(super) const PER: usize = 7;
    pub(super) const CC0: usize = 8;
    pub(super) const PERB: usize = 18;
    pub(super) const CCB0: usize = 19;
}

/// WAVE.WAVEGEN.
const NPWM: u32 = 2;
/// WAVE: WAVEGEN and POLx.
const WAVE_MODELLED: u32 = 0x000F_0007;

#[derive(Clone, Debug, Default)]
pub(crate) struct Tcc {
    index: usize,
    channels: usize,
    max: u32,
    counter: Counter<4>,
    sync: SyncFlags<23>,
    ctrla: u32,
    ctrlb: u8,
    command: u8,
    interrupts: Interrupts<{ OVF | TRG | ERR | MCX }>,
    wave: u32,
    per: u32,
    perb: u32,
    cc: [u32; 4],
    ccb: [u32; 4],
    /// PERBV and CCBVx as in STATUS.
    valid: u32,
    /// What reading COUNT gives, and what it gives from when on.
    count_read: u32,
    count_synced: (Ticks, u32),
    /// Outputs of the channels before polarity, bit n.
    levels: u8,
}

impl Tcc {
    pub(crate) fn new(index: usize, hold: SyncHold) -> Self {
        let max = if index == 2 { 0xFFFF } else { 0xFF_FFFF };
        Self {
            index,
            channels: if index == 0 { 4 } else { 2 },
            max,
            sync: SyncFlags::new(hold),
            interrupts: Interrupts::of(Block::Tcc(index)),
            per: max,
            perb: max,
            ..Self::default()
        }
    }

    /// The generic clock runs at another rate, or no longer.
    pub(crate) fn set_clock(&mut self, now: Ticks, clock: Option<Rate>) {
        if self.counter.set_clock(now, clock) {
            self.sync.set_clocked(now, clock.is_some());
            self.resume(now);
        }
    }

    /// Levels of WO\[0\] to WO\[7\], `None` while the timer drives no pin.
    pub(crate) fn outputs(&self) -> Option<u8> {
        if self.ctrla & ENABLE == 0 {
            return None;
        }
        let levels = self.levels ^ (self.wave >> 16) as u8;
        Some((0..8).fold(0, |outputs, output| {
            outputs | (levels >> (output % self.channels) & 1) << output
        }))
    }

    pub(crate) fn irq(&self) -> u32 {
        self.interrupts.irq()
    }

    pub(crate) fn next(&self) -> Ticks {
        self.counter.next()
    }

    /// Overflow and matches that fall on `now`.
    pub(crate) fn advance(&mut self, now: Ticks) {
        if self.counter.next_overflow <= now {
            self.overflow(now);
        }
        for channel in 0..self.channels {
            let next = &mut self.counter.next_match[channel];
            if *next <= now {
                *next = Ticks::NEVER;
                self.meet(channel);
            }
        }
    }

    fn overflow(&mut self, now: Ticks) {
        self.interrupts.flags |= OVF;
        if self.ctrlb & LUPD == 0 {
            self.update();
        }
        if self.counter.overflow(now, self.ctrlb & ONESHOT != 0) {
            self.begin_cycle(now);
        }
    }

    /// COUNT meets CC of a channel.
    fn meet(&mut self, channel: usize) {
        self.interrupts.flags |= MC0 << channel;
        let bit = 1 << channel;
        if self.is_npwm() {
            self.levels &= !bit;
        } else {
            self.levels ^= bit;
        }
    }

    /// COUNT is 0: outputs rise.
    fn begin_cycle(&mut self, now: Ticks) {
        if self.is_npwm() {
            self.levels = (1 << self.channels) - 1;
        }
        for channel in 0..self.channels {
            if self.cc[channel] == 0 {
                self.meet(channel);
            }
        }
        self.schedule(now);
    }

    fn is_npwm(&self) -> bool {
        self.wave & 7 == NPWM
    }

    /// Finds the end of the cycle and the matches still to come in it.
    fn schedule(&mut self, now: Ticks) {
        let cc = &self.cc[..self.channels];
        self.counter.schedule(now, self.per, self.max, cc);
    }

    /// Copies the valid buffers.
    fn update(&mut self) {
        if self.valid & PERBV != 0 {
            self.per = self.perb;
        }
        for channel in 0..self.channels {
            if self.valid & CCBV0 << channel != 0 {
                self.cc[channel] = self.ccb[channel];
            }
        }
        self.valid = 0;
    }

    /// Counts on from where COUNT stands, if enabled, not stopped and clocked.
    fn resume(&mut self, now: Ticks) {
        self.counter.resume(now, self.ctrla);
        self.schedule(now);
    }

    fn enable(&mut self, now: Ticks) {
        self.ctrla |= ENABLE;
        self.counter.stopped = false;
        self.levels = 0;
        if self.is_npwm() {
            for channel in 0..self.channels {
                self.levels |= u8::from(self.cc[channel] > self.counter.held) << channel;
            }
        }
        self.resume(now);
    }

    /// A bit of a register flips: see [`upset`](crate::upset).
    pub(crate) fn flip(&mut self, now: Ticks, offset: u32, bit: u32) -> bool {
        let mask = 1 << bit;
        match offset {
            0x00 if mask & (ENABLE | 0x0700) != 0 => {
                self.counter.halt(now);
                self.ctrla ^= mask;
                self.resume(now);
                return true;
            }
            0x04 if mask & u32::from(LUPD | ONESHOT) != 0 => self.ctrlb ^= mask as u8,
            0x28 => return self.interrupts.flip(mask),
            0x3C if mask & WAVE_MODELLED != 0 && matches!((self.wave ^ mask) & 7, 0 | NPWM) => {
                self.wave ^= mask;
            }
            0x40 if mask <= self.max => self.per ^= mask,
            0x44..=0x50 if mask <= self.max => match self.channel(offset, 0x44) {
                Ok(channel) => self.cc[channel] ^= mask,
                Err(_) => return false,
            },
            0x6C if mask <= self.max => self.perb ^= mask,
            0x70..=0x7C if mask <= self.max => match self.channel(offset, 0x70) {
                Ok(channel) => self.ccb[channel] ^= mask,
                Err(_) => return false,
            },
            _ => return false,
        }
        self.schedule(now);
        true
    }

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
            0x0C | 0x10 | 0x14 | 0x18 | 0x1C | 0x20 | 0x38 | 0x64 | 0x68 => 0,
            0x24 | 0x28 | 0x2C => self.interrupts.read_words(offset - 0x24),
            0x30 => self.valid | if self.counter.stopped { STATUS_STOP } else { 0 },
            0x34 => {
                let (from, count) = self.count_synced;
                if now >= from { count } else { self.count_read }
            }
            0x3C => self.wave,
            0x40 => self.per,
            0x44..=0x50 => self.cc[self.channel(offset, 0x44)?],
            0x6C => self.perb,
            0x70..=0x7C => self.ccb[self.channel(offset, 0x70)?],
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let now = bus.now;
        match offset {
            0x00 => return self.write_ctrla(bus, lanes.merge(self.ctrla)),
            0x04 => {
                if let Some(clear) = lanes.byte(0)
                    && self.synchronise(bus, busy::CTRLB)
                {
                    self.ctrlb &= !clear;
                }
                if let Some(set) = lanes.byte(1) {
                    return self.write_ctrlbset(bus, set);
                }
            }
            0x08 | 0x1C => {}
            0x0C | 0x10 | 0x14 | 0x18 | 0x20 | 0x38 | 0x64 | 0x68 => {
                if lanes.bits() != 0 {
                    return Err(Refusal::Unmodelled(feature(offset)));
                }
            }
            0x28 if lanes.bits() & !(OVF | TRG | ERR | MCX) != 0 => {
                return Err(Refusal::Unmodelled("this bit of INTENSET"));
            }
            0x24 | 0x28 | 0x2C => self.interrupts.write_words(offset - 0x24, lanes),
            0x30 => self.valid &= !lanes.bits(),
            0x34 => {
                if self.synchronise(bus, busy::COUNT) {
                    self.counter.halt(now);
                    self.counter.held = lanes.merge(0) & self.max;
                    self.count_read = self.counter.held;
                    self.count_synced = (now, self.counter.held);
                    self.resume(now);
                }
            }
            0x3C => {
                let wave = lanes.merge(self.wave);
                if wave & !WAVE_MODELLED != 0 || !matches!(wave & 7, 0 | NPWM) {
                    return Err(Refusal::Unmodelled("WAVE other than NFRQ, NPWM and POLx"));
                }
                if self.synchronise(bus, busy::WAVE) {
                    self.wave = wave;
                }
            }
            0x40 => {
                if self.synchronise(bus, busy::PER) {
                    self.per = lanes.merge(self.per) & self.max;
                    self.counter.set_top(now, self.per, self.max);
                }
            }
            0x44..=0x50 => {
                let channel = self.channel(offset, 0x44)?;
                if self.synchronise(bus, busy::CC0 + channel) {
                    self.cc[channel] = lanes.merge(self.cc[channel]) & self.max;
                    self.counter.set_match(now, channel, self.cc[channel]);
                }
            }
            0x6C => {
                if self.synchronise(bus, busy::PERB) {
                    self.perb = lanes.merge(self.perb) & self.max;
                    self.valid |= PERBV;
                }
            }
            0x70..=0x7C => {
                let channel = self.channel(offset, 0x70)?;
                if self.synchronise(bus, busy::CCB0 + channel) {
                    self.ccb[channel] = lanes.merge(self.ccb[channel]) & self.max;
                    self.valid |= CCBV0 << channel;
                }
            }
            _ => return Err(RESERVED),
        }
        DONE
    }

    fn write_ctrla(&mut self, bus: &mut Bus<'_>, value: u32) -> Write {
        if value & SWRST != 0 {
            if self.synchronise(bus, busy::SWRST) {
                self.software_reset();
            }
            return DONE;
        }
        if value & !(ENABLE | CTRLA_MODELLED) != 0 {
            return Err(Refusal::Unmodelled("this bit of CTRLA"));
        }
        let was_enabled = self.ctrla & ENABLE != 0;
        let enables = value & ENABLE != 0;
        if was_enabled != enables && !self.synchronise(bus, busy::ENABLE) {
            return DONE;
        }
        bus.write_ctrla(self.name(), &mut self.ctrla, value, CTRLA_MODELLED);
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

    fn software_reset(&mut self) {
        let fresh = Self::new(self.index, SyncHold::Instant);
        *self = Self {
            sync: self.sync.clone(),
            counter: self.counter.fresh(),
            ..fresh
        };
    }

    fn write_ctrlbset(&mut self, bus: &mut Bus<'_>, set: u8) -> Write {
        let command = set >> 5;
        if set & DIR != 0 || set & 0x18 != 0 || command > 4 {
            return Err(Refusal::Unmodelled("this bit of CTRLBSET"));
        }
        if !self.synchronise(bus, busy::CTRLB) {
            return DONE;
        }
        let now = bus.now;
        self.ctrlb |= set & (LUPD | ONESHOT);
        self.command = command;
        match command {
            1 if self.ctrla & ENABLE != 0 => {
                self.counter.retrigger(now);
                self.interrupts.flags |= TRG;
                self.resume(now);
                self.begin_cycle(now);
            }
            2 => self.counter.stop(now),
            3 => {
                self.update();
                self.schedule(now);
            }
            4 => {
                let (from, count) = self.count_synced;
                if now >= from {
                    self.count_read = count;
                }
                let ready = now + self.sync.remaining(now, busy::CTRLB);
                self.count_synced = (ready, self.counter.count(now));
                self.sync.begin(now, busy::COUNT);
            }
            _ => {}
        }
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

    fn name(&self) -> &'static str {
        entry(Block::Tcc(self.index)).name
    }

    fn channel(&self, offset: u32, base: u32) -> Result<usize, Refusal> {
        let channel = ((offset - base) / 4) as usize;
        (channel < self.channels).then_some(channel).ok_or(RESERVED)
    }
}

fn feature(offset: u32) -> &'static str {
    match offset {
        0x0C => "FCTRLA",
        0x10 => "FCTRLB",
        0x14 => "WEXCTRL",
        0x18 => "DRVCTRL",
        0x20 => "EVCTRL",
        0x38 => "PATT",
        0x64 => "PATTB",
        _ => "WAVEB",
    }
}
