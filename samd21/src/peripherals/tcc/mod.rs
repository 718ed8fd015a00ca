//! TCC0 to TCC2: timer/counters for control applications (data sheet, chapter 31).
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE, RESOLUTION, PRESCALER, ALOCK; RUNSTDBY and PRESCSYNC stored; CPTENx by a flip |
//! | 04, 05 | CTRLBCLR, CTRLBSET | DIR, LUPD, ONESHOT, IDXCMD; CMD: RETRIGGER, STOP, UPDATE, READSYNC |
//! | 08 | SYNCBUSY | one flag a register; a second write meanwhile is discarded and noted |
//! | 0C, 10 | FCTRLA, FCTRLB | by a flip: SRC INVERT is a fault for ever (below), with HALT and RESTART |
//! | 14 | WEXCTRL | OTMX, DTIENx, DTLS, DTHS |
//! | 18 | DRVCTRL | INVENx; NREx and NRVx where the outputs are in the safe state |
//! | 1E | DBGCTRL | stored: no debugger |
//! | 20 | EVCTRL | by a flip: an action that counts events stops the counter (below) |
//! | 24, 28, 2C | INTENCLR, INTENSET, INTFLAG | OVF, TRG, CNT, ERR, MC0-MC3; DFS and FAULTx never come |
//! | 30 | STATUS | STOP, IDX, PATTBV, WAVEBV, PERBV, FAULTAIN, FAULTBIN, FAULTA, FAULTB, FAULT0, FAULT1, CCBVx, CMPx |
//! | 34 | COUNT | writing sets it; reading gives what the last READSYNC saw |
//! | 38, 64 | PATT, PATTB | PGEx, PGVx |
//! | 3C, 68 | WAVE, WAVEB | WAVEGEN, RAMP, CIPEREN, CICCENx, POLx, SWAPx |
//! | 40, 44-50 | PER, CCx | take effect at once |
//! | 6C, 70-7C | PERB, CCBx | copied to PER and CCx at an update unless LUPD |
//!
//! TCC0 and TCC1 count 24 bits, TCC2 16; TCC0 has four channels, the others two; WO\[n\] follows
//! channel n modulo that number, and on TCC0 what [`extension`] makes of them. The output is
//! match-driven (D21-717): counting up it rises at overflow and falls when COUNT meets CC. So a CC
//! written below COUNT while the pin is high finds no match: the pin stays high for the rest of the
//! cycle and until the match in the next.
//!
//! The outputs are in the safe state, released or as NREx and NRVx say, while the counter is
//! stopped by a command or by ONESHOT, and in a non-recoverable fault (FAULT0 or FAULT1).
//!
//! What a flipped bit does where the data sheet says little is assumed to do harm:
//!
//! | what | assumed |
//! |---|---|
//! | SRC INVERT of a recoverable fault | the event's input is low without an event system: the fault lasts, and holds its channel's waveform low |
//! | HALT, RESTART with it | the counter stands; HALT NR: safe state |
//! | EVACT0 COUNTEV, INC, COUNT, EVACT1 DEC | the counter counts events alone, that is nothing |
//! | CPTENx, the reserved WAVEGEN | nothing changes the channel's level any more |
//! | RESOLUTION while it runs | COUNT stays, now beyond a TOP that is a sixteenth or less: it counts to its end |
//! | CMD | the command is carried out once |
//!
//! | left out | why |
//! |---|---|
//! | events in and out, capture, ALTFAULT, KEEP, QUAL, BLANK, filters, TCINVx | no event system is modelled: writing them faults; a flip of one bit alone does nothing |
//! | the counts that dithering adds, CCx's highest bit as the choice of a slope for MCx | less than a count a cycle; used by nobody |
//! | DMA, debugger's faults | not modelled |

mod extension;
mod flip;
mod registers;
#[cfg(test)]
mod tests;
mod waveform;

use super::access::{Bus, DONE, ENABLE, Lanes, RESERVED, Read, Refusal, SWRST, Write};
use super::clock::{Rate, SyncFlags};
use super::counter::Counter;
use super::interrupts::Interrupts;
use super::map::{Block, entry};
use super::port::Waveforms;
use crate::board::Ticks;
use extension::Extension;

/// CTRLA: RESOLUTION, PRESCALER, RUNSTDBY, PRESCSYNC, ALOCK.
const CTRLA_MODELLED: u32 = 0x7F60;
const ALOCK: u32 = 1 << 14;
/// The first of four.
const CPTEN0: u32 = 1 << 24;
const CPTENX: u32 = 0xF << 24;

const DIR: u8 = 1 << 0;
const LUPD: u8 = 1 << 1;
const ONESHOT: u8 = 1 << 2;
const IDXCMD: u8 = 3 << 3;

const OVF: u32 = 1 << 0;
const TRG: u32 = 1 << 1;
const CNT: u32 = 1 << 2;
const ERR: u32 = 1 << 3;
const MC0: u32 = 1 << 16;
const MCX: u32 = 0xF << 16;
/// DFS, FAULTA, FAULTB, FAULT0, FAULT1.
const FAULTS: u32 = 0x1F << 11;
/// All flags.
const FLAGS: u32 = OVF | TRG | CNT | ERR | FAULTS | MCX;

const STATUS_STOP: u32 = 1 << 0;
const IDX: u32 = 1 << 1;
const PATTBV: u32 = 1 << 5;
const WAVEBV: u32 = 1 << 6;
const PERBV: u32 = 1 << 7;
const FAULT0: u32 = 1 << 14;
const FAULT1: u32 = 1 << 15;
const CCBV0: u32 = 1 << 16;
/// All that say that a buffer is valid.
const BUFFERS: u32 = PATTBV | WAVEBV | PERBV | 0xF << 16;

/// FCTRLA and FCTRLB: SRC, of which INVERT; RESTART; HALT, of which NR.
const SRC: u32 = 3;
const INVERT: u32 = 2;
const RESTART: u32 = 1 << 7;
const HALT: u32 = 3 << 8;

/// Bits of SYNCBUSY.
mod busy {
    pub(super) const SWRST: usize = 0;
    pub(super) const ENABLE: usize = 1;
    pub(super) const CTRLB: usize = 2;
    pub(super) const COUNT: usize = 4;
}

/// WAVE: WAVEGEN, RAMP, CIPEREN, CICCENx, POLx, SWAPx.
const WAVE_MODELLED: u32 = 0x0F0F_0FB7;
/// WEXCTRL: OTMX, DTIENx, DTLS, DTHS.
const WEXCTRL_MODELLED: u32 = 0xFFFF_0F03;

#[derive(Clone, Debug, Default)]
pub(crate) struct Tcc {
    index: usize,
    channels: usize,
    max: u32,
    counter: Counter<4>,
    sync: SyncFlags<23>,
    ctrla: u32,
    /// DIR, LUPD, ONESHOT, IDXCMD.
    ctrlb: u8,
    command: u8,
    fctrl: [u32; 2],
    extension: Extension,
    dbgctrl: u32,
    evctrl: u32,
    pub(crate) interrupts: Interrupts<FLAGS>,
    wave: u32,
    waveb: u32,
    per: u32,
    perb: u32,
    cc: [u32; 4],
    ccb: [u32; 4],
    /// STATUS: IDX, what buffers are valid, FAULT0 and FAULT1.
    status: u32,
    /// What reading COUNT gives, and what it gives from when on.
    count_read: u32,
    count_synced: (Ticks, u32),
    /// Levels of the channels, bit n.
    levels: u8,
}

impl Tcc {
    pub(crate) fn new(index: usize, hold: Ticks) -> Self {
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

    /// What WO\[0\] to WO\[7\] are driven to.
    pub(crate) fn outputs(&self) -> Waveforms {
        if self.ctrla & ENABLE == 0 {
            Waveforms::default()
        } else if self.is_safe() {
            self.extension.safe_outputs()
        } else {
            self.extension.outputs(self.wave >> 24)
        }
    }

    pub(crate) fn next(&self) -> Ticks {
        self.counter.next().min(self.extension.next())
    }

    /// Overflow, matches and ends of dead times that fall on `now`.
    pub(crate) fn advance(&mut self, now: Ticks) {
        self.extension.advance(now);
        if self.counter.next_overflow <= now {
            self.end_ramp(now);
        }
        for channel in 0..self.channels {
            let next = &mut self.counter.next_match[channel];
            if *next <= now {
                *next = Ticks::NEVER;
                self.meet(channel);
            }
        }
        self.follow(now);
    }

    /// The extension sees the channels' levels; a fault holds its channel low.
    fn follow(&mut self, now: Ticks) {
        let held = (0..2).fold(0, |held, fault| held | u8::from(self.has(fault)) << fault);
        let cycles = |cycles| self.counter.cycles(cycles);
        let levels = self.levels & !held;
        self.extension.follow(now, levels, self.channels, cycles);
    }

    /// Whether recoverable fault A (0) or B (1) is there.
    fn has(&self, fault: usize) -> bool {
        self.fctrl[fault] & SRC == INVERT
    }

    /// Whether the outputs are in the safe state.
    fn is_safe(&self) -> bool {
        let halted = |fault: usize| self.has(fault) && self.fctrl[fault] & HALT == HALT;
        self.counter.stopped || self.status & (FAULT0 | FAULT1) != 0 || halted(0) || halted(1)
    }

    /// Whether a fault or an event's action keeps the counter from counting its clock.
    fn is_held(&self) -> bool {
        let halted = |fault| self.has(fault) && self.fctrl[fault] & (HALT | RESTART) != 0;
        let counts_events = matches!(self.evctrl & 7, 2 | 4 | 5) || self.evctrl >> 3 & 7 == 4;
        self.status & (FAULT0 | FAULT1) != 0 || counts_events || halted(0) || halted(1)
    }

    /// Counts on from where COUNT stands, if enabled, not stopped or held, and clocked.
    fn resume(&mut self, now: Ticks) {
        self.set_slopes();
        if !self.is_held() {
            self.counter.resume(now, self.ctrla);
        }
        self.schedule(now);
    }

    /// Counts on from where COUNT stands, another way if direction or slopes have changed.
    fn turn(&mut self, now: Ticks) {
        let (down, two_slopes) = (self.counter.down, self.counter.two_slopes);
        self.set_slopes();
        if (down, two_slopes) != (self.counter.down, self.counter.two_slopes) {
            self.counter.halt(now);
            self.resume(now);
        } else {
            self.schedule(now);
        }
    }

    fn software_reset(&mut self) {
        let fresh = Self::new(self.index, Ticks::ZERO);
        *self = Self { sync: self.sync.clone(), counter: self.counter.fresh(), ..fresh };
    }

    /// Carries out a command of CTRLBSET.CMD.
    fn carry_out(&mut self, now: Ticks, command: u8) {
        self.command = command;
        match command {
            1 if self.ctrla & ENABLE != 0 => {
                self.interrupts.flags |= TRG;
                if self.counter.stopped {
                    self.counter.stopped = false;
                    self.resume(now);
                } else {
                    self.set_slopes();
                    let from = if self.counter.down { self.top() } else { 0 };
                    self.update_condition();
                    self.counter.retrigger(now, from);
                    self.resume(now);
                    self.begin_ramp(now);
                }
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
    }

    fn name(&self) -> &'static str {
        entry(Block::Tcc(self.index)).name
    }
}
