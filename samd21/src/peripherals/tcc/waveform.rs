//! The waveform generator: ramps of the counter, and what they make of the channels' levels
//! (data sheet 31.6.2.5, table 31-3).

use super::{ALOCK, CNT, CPTEN0, DIR, ENABLE, IDX, IDXCMD, LUPD, MC0, ONESHOT, OVF, Tcc};
use super::{CCBV0, PATTBV, PERBV, WAVEBV};
use crate::board::Ticks;

/// WAVE: CIPEREN, and CICCEN0, the first of four.
const CIPEREN: u32 = 1 << 7;
const CICCEN0: u32 = 1 << 8;
/// A value that COUNT never meets.
const NEVER_MET: u32 = u32::MAX;

/// WAVE.WAVEGEN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Generation {
    NormalFrequency,
    MatchFrequency,
    NormalPwm,
    Reserved,
    Critical,
    Bottom,
    Both,
    Top,
}

/// By the value of WAVEGEN.
const GENERATIONS: [Generation; 8] = {
    use Generation::*;
    [NormalFrequency, MatchFrequency, NormalPwm, Reserved, Critical, Bottom, Both, Top]
};

impl Generation {
    fn has_two_slopes(self) -> bool {
        matches!(self, Self::Critical | Self::Bottom | Self::Both | Self::Top)
    }
}

impl Tcc {
    fn generation(&self) -> Generation {
        GENERATIONS[(self.wave & 7) as usize]
    }

    /// Bits of a count that dithering takes (CTRLA.RESOLUTION).
    pub(super) fn dither_bits(&self) -> u32 {
        [0, 4, 5, 6][(self.ctrla >> 5 & 3) as usize]
    }

    /// The count at which a ramp ends.
    pub(super) fn top(&self) -> u32 {
        let top = match self.generation() {
            Generation::MatchFrequency => self.cc[0],
            _ => self.per,
        };
        top >> self.dither_bits()
    }

    /// RAMP2 and RAMP2A: cycles A and B in turn. The reserved value is taken for RAMP2.
    fn has_two_cycles(&self) -> bool {
        self.wave >> 4 & 3 != 0
    }

    /// Whether a channel has a pulse in this cycle: odd ones have none in cycle A, even ones none
    /// in B.
    fn has_cycle(&self, channel: usize) -> bool {
        !self.has_two_cycles() || channel & 1 == usize::from(self.status & IDX != 0)
    }

    /// The count that a channel is compared with on this ramp.
    fn compare(&self, channel: usize) -> u32 {
        const RAMP2A: u32 = 1 << 4;
        let half = self.channels / 2;
        let source = match self.generation() {
            _ if self.ctrla & CPTEN0 << channel != 0 => return NEVER_MET,
            Generation::Reserved => return NEVER_MET,
            Generation::Critical if channel >= half => return NEVER_MET,
            Generation::Critical if self.counter.down => channel + half,
            _ if self.wave & 3 << 4 == RAMP2A => channel & !1,
            _ => channel,
        };
        self.cc[source] >> self.dither_bits()
    }

    /// Finds the end of the ramp and the matches still to come on it.
    pub(super) fn schedule(&mut self, now: Ticks) {
        let compares = [0, 1, 2, 3]
            .map(|channel| if channel < self.channels { self.compare(channel) } else { NEVER_MET });
        let (top, max) = (self.top(), self.max >> self.dither_bits());
        self.counter.schedule(now, top, max, &compares);
    }

    /// Takes over the direction of a single slope, or the choice of two.
    pub(super) fn set_slopes(&mut self) {
        self.counter.two_slopes = self.generation().has_two_slopes();
        if !self.counter.two_slopes {
            self.counter.down = self.ctrlb & DIR != 0;
        }
    }

    /// The levels that the channels have where the counter stands.
    pub(super) fn start_levels(&mut self) {
        let count = self.counter.held;
        for channel in 0..self.channels {
            let compare = self.compare(channel);
            let is_on = match (self.generation(), self.counter.down) {
                (Generation::NormalPwm, false) => compare > count,
                (Generation::NormalPwm, true) => compare >= count,
                _ => false,
            };
            self.put(channel, is_on && self.has_cycle(channel));
        }
    }

    /// A ramp ends.
    pub(super) fn end_ramp(&mut self, now: Ticks) {
        let is_bottom = self.counter.down;
        let (updates, overflows) = match self.generation() {
            Generation::Critical | Generation::Bottom => (is_bottom, is_bottom),
            Generation::Top => (is_bottom, !is_bottom),
            _ => (true, true),
        };
        if updates {
            self.update_condition();
        }
        if overflows {
            self.interrupts.flags |= OVF | CNT;
        }
        let ends = overflows && self.ctrlb & ONESHOT != 0;
        let top = self.top();
        if self.counter.overflow(now, ends, top) {
            self.begin_ramp(now);
        }
    }

    /// The buffers are copied, unless that is locked.
    pub(super) fn update_condition(&mut self) {
        if self.ctrlb & LUPD == 0 {
            self.update();
        }
        if self.ctrla & ALOCK != 0 {
            self.ctrlb |= LUPD;
        }
        self.status = match self.ctrlb & IDXCMD {
            _ if !self.has_two_cycles() => self.status & !IDX,
            0 => self.status ^ IDX,
            0x08 => self.status | IDX,
            0x10 => self.status & !IDX,
            _ => self.status,
        };
        self.ctrlb &= !IDXCMD;
    }

    /// A ramp begins: at 0 if it goes up, else at the top.
    pub(super) fn begin_ramp(&mut self, now: Ticks) {
        let down = self.counter.down;
        let from = if down { self.top() } else { 0 };
        for channel in 0..self.channels {
            let compare = self.compare(channel);
            if self.generation() == Generation::NormalPwm && compare != NEVER_MET {
                self.put(channel, !down && self.has_cycle(channel));
            }
            if compare == from {
                self.meet(channel);
            }
        }
        self.schedule(now);
    }

    /// COUNT meets what a channel is compared with.
    pub(super) fn meet(&mut self, channel: usize) {
        let down = self.counter.down;
        let generation = self.generation();
        if !down || !generation.has_two_slopes() || generation == Generation::Critical {
            self.interrupts.flags |= MC0 << channel;
        }
        match generation {
            Generation::NormalPwm => self.put(channel, down && self.has_cycle(channel)),
            Generation::NormalFrequency | Generation::MatchFrequency => self.levels ^= 1 << channel,
            Generation::Reserved => {}
            _ => self.put(channel, !down && self.has_cycle(channel)),
        }
    }

    /// Sets or clears a channel's level, the other way round with WAVE.POLx.
    fn put(&mut self, channel: usize, is_on: bool) {
        let is_high = is_on != (self.wave >> (16 + channel) & 1 != 0);
        self.levels = self.levels & !(1 << channel) | u8::from(is_high) << channel;
    }

    /// Copies the valid buffers; circular ones are exchanged with what they are copied to.
    pub(super) fn update(&mut self) {
        if self.wave & CIPEREN != 0 {
            std::mem::swap(&mut self.per, &mut self.perb);
        } else if self.status & PERBV != 0 {
            self.per = self.perb;
        }
        for channel in 0..self.channels {
            if self.wave & CICCEN0 << channel != 0 {
                std::mem::swap(&mut self.cc[channel], &mut self.ccb[channel]);
            } else if self.status & CCBV0 << channel != 0 {
                self.cc[channel] = self.ccb[channel];
            }
        }
        if self.status & PATTBV != 0 {
            self.extension.patt = self.extension.pattb;
        }
        if self.status & WAVEBV != 0 {
            self.wave = self.waveb;
            self.set_slopes();
        }
        self.status &= !super::BUFFERS;
    }

    /// The timer starts to count from where it stands.
    pub(super) fn enable(&mut self, now: Ticks) {
        self.ctrla |= ENABLE;
        self.counter.stopped = false;
        self.start_levels();
        self.resume(now);
    }
}
