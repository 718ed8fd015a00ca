//! TC3 to TC5: timer/counters, as time bases.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE, MODE COUNT16 or (TC4 with TC5) COUNT32, WAVEGEN, PRESCALER |
//! | 02 | READREQ | RREQ: COUNT reads as now; RCONT: COUNT is read as it runs |
//! | 04, 05 | CTRLBCLR, CTRLBSET | ONESHOT, CMD RETRIGGER and STOP; DIR only up |
//! | 06, 08, 0A | CTRLC, DBGCTRL, EVCTRL | only 0 |
//! | 0C, 0D, 0E | INTENCLR, INTENSET, INTFLAG | OVF, ERR, SYNCRDY, MC0, MC1 |
//! | 0F | STATUS | STOP, SLAVE, SYNCBUSY |
//! | 10 | COUNT | 16 or 32 bits |
//! | 18, 1A or 1C | CC0, CC1 | 16 or 32 bits |
//!
//! TOP is CC0 in MFRQ and MPWM, else the counter's end. All registers share one synchroniser: a
//! write while SYNCBUSY is set stalls the bus. COUNT read without a request gives the present
//! count, and stalls the bus for 14 cycles at equal clocks: with 12 to 18 an image whose limits are
//! published from a SAMD21G18 reaches them here, too.
//!
//! | left out | why |
//! |---|---|
//! | waveforms on pins | time bases only: routing one to a pin faults |
//! | COUNT8, down-counting, capture, events, DMA | not used: setting one faults |
//! | TC6, TC7 | not on the SAMD21G |

use super::access::{Bus, DONE, ENABLE, Lanes, RESERVED, Read, Refusal, SWRST, Write};
use super::clock::{Rate, SyncFlags};
use super::counter::Counter;
use super::interrupts::Interrupts;
use super::map::{Block, entry};
use crate::board::Ticks;

const MODE: u32 = 3 << 2;
const MODE_COUNT32: u32 = 2 << 2;
/// CTRLA: MODE, WAVEGEN, PRESCALER, RUNSTDBY, PRESCSYNC.
const CTRLA_MODELLED: u32 = MODE | 3 << 5 | 0x3F00;

/// Offset of COUNT.
pub(crate) const COUNT: u32 = 0x10;

const DIR: u8 = 1 << 0;
const ONESHOT: u8 = 1 << 2;

const OVF: u32 = 1 << 0;
const ERR: u32 = 1 << 1;
const SYNCRDY: u32 = 1 << 3;
const MC0: u32 = 1 << 4;
const MC1: u32 = 1 << 5;

const STOP: u8 = 1 << 3;
const SLAVE: u8 = 1 << 4;
const SYNCBUSY: u8 = 1 << 7;

const RCONT: u16 = 1 << 14;
const RREQ: u16 = 1 << 15;

/// TC4: the one that may take the next as its upper half.
const MASTER: usize = 1;

#[derive(Clone, Debug, Default)]
pub(crate) struct Tc {
    index: usize,
    counter: Counter<2>,
    sync: SyncFlags<1>,
    ctrla: u32,
    ctrlb: u8,
    read_request: u16,
    pub(crate) interrupts: Interrupts<{ OVF | ERR | SYNCRDY | MC0 | MC1 }>,
    cc: [u32; 2],
    pub(crate) is_slave: bool,
    /// COUNT as the last request saw it.
    requested: Option<u32>,
}

impl Tc {
    /// `index` counts from TC3.
    pub(crate) fn new(index: usize, hold: Ticks) -> Self {
        Self {
            index,
            sync: SyncFlags::new(hold),
            interrupts: Interrupts::of(Block::Tc(index)),
            ..Self::default()
        }
    }

    pub(crate) fn set_clock(&mut self, now: Ticks, clock: Option<Rate>) {
        if self.counter.set_clock(now, clock) {
            self.sync.set_clocked(now, clock.is_some());
            self.resume(now);
        }
    }

    /// Whether this counter has taken the next one as its upper half.
    pub(crate) fn is_32_bits(&self) -> bool {
        self.ctrla & MODE == MODE_COUNT32
    }

    pub(crate) fn next(&self) -> Ticks {
        self.counter.next()
    }

    pub(crate) fn advance(&mut self, now: Ticks) {
        if self.counter.next_overflow <= now {
            self.overflow(now);
        }
        for (channel, next) in self.counter.next_match.iter_mut().enumerate() {
            if *next <= now {
                *next = Ticks::NEVER;
                self.interrupts.flags |= MC0 << channel;
            }
        }
    }

    fn overflow(&mut self, now: Ticks) {
        self.interrupts.flags |= OVF;
        if self.counter.overflow(now, self.ctrlb & ONESHOT != 0, 0) {
            for (channel, cc) in self.cc.iter().enumerate() {
                self.interrupts.flags |= u32::from(*cc == 0) * (MC0 << channel);
            }
            self.schedule(now);
        }
    }

    fn max(&self) -> u32 {
        if self.is_32_bits() { u32::MAX } else { 0xFFFF }
    }

    fn top(&self) -> u32 {
        match self.ctrla >> 5 & 3 {
            1 | 3 => self.cc[0],
            _ => self.max(),
        }
    }

    fn schedule(&mut self, now: Ticks) {
        let (top, max) = (self.top(), self.max());
        self.counter.schedule(now, top, max, &self.cc);
    }

    fn resume(&mut self, now: Ticks) {
        self.counter.resume(now, self.ctrla);
        self.schedule(now);
    }

    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => {
                let swrst = self.sync.is_busy(now, 0) && self.ctrla == 0;
                self.ctrla | u32::from(swrst) | u32::from(self.read_request) << 16
            }
            0x04 => u32::from(self.ctrlb) * 0x0101,
            0x08 => 0,
            0x0C => {
                let busy = self.sync.is_busy(now, 0);
                let mut status = if busy { SYNCBUSY } else { 0 };
                status |= if self.counter.stopped { STOP } else { 0 };
                status |= if self.is_slave { SLAVE } else { 0 };
                self.interrupts.read_bytes() | u32::from(status) << 24
            }
            COUNT => self.requested.unwrap_or_else(|| self.counter.count(now)),
            0x18 if self.is_32_bits() => self.cc[0],
            0x18 => self.cc[0] | self.cc[1] << 16,
            0x1C if self.is_32_bits() => self.cc[1],
            _ => return Err(RESERVED),
        })
    }

    /// For how many cycles reading COUNT stalls the bus.
    pub(crate) fn count_stall_cycles(&self) -> u64 {
        let is_unasked = self.read_request & RCONT == 0 && self.requested.is_none();
        if is_unasked { 14 } else { 0 }
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        if offset == 0x0C {
            self.interrupts.write_bytes(lanes);
            return DONE;
        }
        let now = bus.now;
        let stall = self.sync.stall(now, 0)?;
        let begin = now + stall;
        match offset {
            0x00 => {
                if let Some(value) = lanes.half(0, self.ctrla as u16) {
                    self.write_ctrla(bus, begin, u32::from(value))?;
                }
                if let Some(request) = lanes.half(1, 0) {
                    self.read_request = request & RCONT;
                    if request & RREQ != 0 {
                        self.requested = (request & RCONT == 0).then(|| self.counter.count(now));
                        self.sync.begin(begin, 0);
                    }
                }
            }
            0x04 => {
                if let Some(clear) = lanes.byte(0) {
                    self.ctrlb &= !clear;
                    self.sync.begin(begin, 0);
                }
                if let Some(set) = lanes.byte(1) {
                    self.write_ctrlbset(now, set)?;
                    self.sync.begin(begin, 0);
                }
                if lanes.byte(2).unwrap_or(0) != 0 {
                    return Err(Refusal::Unmodelled("CTRLC"));
                }
            }
            0x08 => {
                if lanes.bits() & 0xFFFF_0000 != 0 {
                    return Err(Refusal::Unmodelled("EVCTRL"));
                }
            }
            COUNT => {
                self.counter.halt(now);
                self.counter.held = lanes.merge(self.counter.held) & self.max();
                self.requested = None;
                self.resume(now);
                self.sync.begin(begin, 0);
            }
            0x18 if !self.is_32_bits() => {
                let both = lanes.merge(self.cc[0] | self.cc[1] << 16);
                self.cc = [both & 0xFFFF, both >> 16];
                self.schedule(now);
                self.sync.begin(begin, 0);
            }
            0x18 | 0x1C if self.is_32_bits() => {
                let channel = ((offset - 0x18) / 4) as usize;
                self.cc[channel] = lanes.merge(self.cc[channel]);
                self.schedule(now);
                self.sync.begin(begin, 0);
            }
            _ => return Err(RESERVED),
        }
        Ok(stall)
    }

    fn write_ctrla(&mut self, bus: &mut Bus<'_>, begin: Ticks, value: u32) -> Result<(), Refusal> {
        if value & SWRST != 0 {
            *self = Self {
                counter: self.counter.fresh(),
                sync: self.sync.clone(),
                is_slave: self.is_slave,
                ..Self::new(self.index, Ticks::ZERO)
            };
            self.sync.begin(begin, 0);
            return Ok(());
        }
        if value & !(ENABLE | CTRLA_MODELLED) != 0 {
            return Err(Refusal::Unmodelled("this bit of CTRLA"));
        }
        match value & MODE {
            0 => {}
            MODE_COUNT32 if self.index == MASTER => {}
            _ => return Err(Refusal::Unmodelled("this MODE")),
        }
        let was_enabled = self.ctrla & ENABLE != 0;
        let name = entry(Block::Tc(self.index)).name;
        bus.write_ctrla(name, &mut self.ctrla, value, CTRLA_MODELLED);
        if was_enabled != (value & ENABLE != 0) {
            self.counter.halt(bus.now);
            self.ctrla ^= ENABLE;
            self.counter.stopped = was_enabled;
            self.resume(bus.now);
            self.sync.begin(begin, 0);
        }
        Ok(())
    }

    fn write_ctrlbset(&mut self, now: Ticks, set: u8) -> Result<(), Refusal> {
        if set & DIR != 0 {
            return Err(Refusal::Unmodelled("down-counting"));
        }
        self.ctrlb |= set & ONESHOT;
        match set >> 6 {
            1 if self.ctrla & ENABLE != 0 => {
                self.counter.retrigger(now, 0);
                self.resume(now);
            }
            2 => self.counter.stop(now),
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Rig {
        tc: Tc,
        now: u64,
    }

    impl Rig {
        fn new(hold: Ticks) -> Self {
            let mut tc = Tc::new(MASTER, hold);
            tc.set_clock(Ticks::ZERO, Some(Rate::from_hz(48_000_000)));
            Self { tc, now: 0 }
        }

        fn write(&mut self, offset: u32, lanes: Lanes) -> Write {
            Bus::alone(Ticks(self.now), |bus| self.tc.write(bus, offset, lanes))
        }

        fn half(&mut self, offset: u32, value: u32) -> Ticks {
            self.write(offset & !3, Lanes::new(value, offset & 3, 2)).unwrap()
        }

        fn run_to(&mut self, until: u64) {
            while self.tc.next() <= Ticks(until) {
                self.tc.advance(self.tc.next());
            }
            self.now = until;
        }

        fn read(&self, offset: u32) -> u32 {
            self.tc.read(Ticks(self.now), offset).unwrap()
        }
    }

    #[test]
    fn match_frequency_overflows_every_cc0_plus_one_counts() {
        let mut rig = Rig::new(Ticks::ZERO);
        rig.half(0x18, 5999);
        rig.half(0x00, 1 << 5 | 3 << 8 | ENABLE);
        rig.write(0x0C, Lanes::new(OVF, 1, 1)).unwrap();
        rig.run_to(6000 * 8 - 1);
        assert_eq!(rig.tc.interrupts.irq(), 0);
        assert_eq!(rig.read(0x10), 5999);
        rig.run_to(6000 * 8);
        assert_eq!(rig.tc.interrupts.irq(), 1 << 19);
        assert_eq!(rig.read(0x10), 0);
        rig.write(0x0C, Lanes::new(OVF, 2, 1)).unwrap();
        assert_eq!(rig.tc.interrupts.irq(), 0);
        rig.run_to(12_000 * 8);
        assert_eq!(rig.tc.interrupts.irq(), 1 << 19);
    }

    #[test]
    fn the_32_bit_pair_runs_as_a_time_base() {
        let mut rig = Rig::new(Ticks::ZERO);
        rig.half(0x00, MODE_COUNT32 | ENABLE);
        rig.half(0x02, u32::from(RREQ | RCONT) | 0x10);
        rig.run_to(5_000_000_000);
        assert_eq!(rig.read(0x10), (5_000_000_000u64 - (1 << 32)) as u32);
        assert_eq!(rig.read(0x0C) >> 16 & OVF, 1);
    }

    #[test]
    fn a_single_request_freezes_what_is_read() {
        let mut rig = Rig::new(Ticks::ZERO);
        rig.half(0x00, ENABLE);
        rig.run_to(1000);
        rig.half(0x02, u32::from(RREQ) | 0x10);
        rig.run_to(2000);
        assert_eq!(rig.read(0x10), 1000);
        rig.half(0x02, u32::from(RREQ) | 0x10);
        assert_eq!(rig.read(0x10), 2000);
    }

    #[test]
    fn a_write_while_synchronising_stalls() {
        let mut rig = Rig::new(Ticks(100));
        assert_eq!(rig.half(0x00, 0), Ticks::ZERO);
        assert_eq!(rig.half(0x00, ENABLE), Ticks::ZERO);
        assert_eq!(rig.read(0x0C) >> 31, 1);
        rig.run_to(40);
        assert_eq!(rig.half(0x18, 7), Ticks(60));
    }

    #[test]
    fn oneshot_stops_at_the_overflow_until_retriggered() {
        let mut rig = Rig::new(Ticks::ZERO);
        rig.half(0x18, 99);
        rig.write(0x04, Lanes::new(u32::from(ONESHOT), 1, 1)).unwrap();
        rig.half(0x00, 1 << 5 | ENABLE);
        rig.run_to(1000);
        assert_eq!(rig.read(0x0C) >> 24, u32::from(STOP));
        assert_eq!(rig.tc.next(), Ticks::NEVER);
        rig.write(0x04, Lanes::new(1 << 6, 1, 1)).unwrap();
        assert_eq!(rig.tc.counter.next_overflow, Ticks(1100));
    }

    #[test]
    fn only_tc4_takes_a_second_counter() {
        let mut rig = Rig::new(Ticks::ZERO);
        rig.tc.index = 0;
        let lanes = Lanes::new(MODE_COUNT32, 0, 2);
        assert!(rig.write(0x00, lanes).is_err());
    }
}
