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
//! TOP is CC0 in MFRQ and MPWM, else the counter's end. All registers share one synchroniser: a write
//! while SYNCBUSY is set stalls the bus. COUNT read without a request gives the present count.
//!
//! | left out | why |
//! |---|---|
//! | waveforms on pins | time bases only: routing one to a pin faults |
//! | COUNT8, down-counting, capture, events, DMA | not used: setting one faults |
//! | the stall of reading COUNT without a request | reads do not stall in this bus |
//! | TC6, TC7 | not on the SAMD21G |

use super::access::{Bus, Lanes, RESERVED, Read, Refusal, Write};
use super::clock::{Rate, SyncFlags};
use super::counter::{Run, prescaler};
use crate::SyncHold;
use crate::board::Ticks;

const SWRST: u32 = 1 << 0;
const ENABLE: u32 = 1 << 1;
const MODE: u32 = 3 << 2;
const MODE_COUNT32: u32 = 2 << 2;
/// CTRLA: MODE, WAVEGEN, PRESCALER, RUNSTDBY, PRESCSYNC.
const CTRLA_MODELLED: u32 = MODE | 3 << 5 | 0x3F00;

const DIR: u8 = 1 << 0;
const ONESHOT: u8 = 1 << 2;

const OVF: u8 = 1 << 0;
const ERR: u8 = 1 << 1;
const SYNCRDY: u8 = 1 << 3;
const MC0: u8 = 1 << 4;

const STOP: u8 = 1 << 3;
const SLAVE: u8 = 1 << 4;
const SYNCBUSY: u8 = 1 << 7;

const RCONT: u16 = 1 << 14;
const RREQ: u16 = 1 << 15;

const NAMES: [&str; 3] = ["TC3", "TC4", "TC5"];
/// TC4: the one that may take the next as its upper half.
const MASTER: usize = 1;

#[derive(Clone, Debug)]
pub(crate) struct Tc {
    index: usize,
    clock: Option<Rate>,
    sync: SyncFlags<1>,
    ctrla: u32,
    ctrlb: u8,
    read_request: u16,
    interrupts: u8,
    flags: u8,
    cc: [u32; 2],
    stopped: bool,
    is_slave: bool,
    run: Option<Run>,
    /// COUNT while the counter stands.
    held: u32,
    /// COUNT as the last request saw it.
    requested: Option<u32>,
    next_overflow: Ticks,
    next_match: [Ticks; 2],
}

impl Tc {
    /// `index` counts from TC3.
    pub(crate) fn new(index: usize, hold: SyncHold) -> Self {
        Self {
            index,
            clock: None,
            sync: SyncFlags::new(hold),
            ctrla: 0,
            ctrlb: 0,
            read_request: 0,
            interrupts: 0,
            flags: 0,
            cc: [0; 2],
            stopped: true,
            is_slave: false,
            run: None,
            held: 0,
            requested: None,
            next_overflow: Ticks::NEVER,
            next_match: [Ticks::NEVER; 2],
        }
    }

    pub(crate) fn set_clock(&mut self, now: Ticks, clock: Option<Rate>) {
        if self.clock == clock {
            return;
        }
        if clock.is_some() {
            self.sync.unhang(now);
        }
        self.halt(now);
        self.clock = clock;
        self.resume(now);
    }

    /// Whether this counter has taken the next one as its upper half.
    pub(crate) fn is_32_bits(&self) -> bool {
        self.ctrla & MODE == MODE_COUNT32
    }

    /// The counter below has taken this one as its upper half, or has let it go.
    pub(crate) fn set_slave(&mut self, is_slave: bool) {
        self.is_slave = is_slave;
    }

    pub(crate) fn irq(&self) -> bool {
        self.flags & self.interrupts != 0
    }

    pub(crate) fn next(&self) -> Ticks {
        self.next_overflow
            .min(self.next_match[0])
            .min(self.next_match[1])
    }

    pub(crate) fn advance(&mut self, now: Ticks) {
        if self.next_overflow <= now {
            self.overflow(now);
        }
        for channel in 0..2 {
            if self.next_match[channel] <= now {
                self.flags |= MC0 << channel;
                self.next_match[channel] = Ticks::NEVER;
            }
        }
    }

    fn overflow(&mut self, now: Ticks) {
        self.flags |= OVF;
        if let Some(run) = &mut self.run {
            run.begin_next_cycle();
        }
        if self.ctrlb & ONESHOT != 0 {
            self.halt(now);
            self.held = 0;
            self.stopped = true;
            return;
        }
        for channel in 0..2 {
            if self.cc[channel] == 0 {
                self.flags |= MC0 << channel;
            }
        }
        self.schedule(now);
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

    fn count(&self, now: Ticks) -> u32 {
        self.run.map_or(self.held, |run| run.count(now))
    }

    fn schedule(&mut self, now: Ticks) {
        let (top, max) = (self.top(), self.max());
        let Some(run) = &mut self.run else { return };
        run.set_top(now, top, max);
        self.next_overflow = run.end();
        self.next_match = self.cc.map(|value| run.next_match(now, value));
    }

    fn halt(&mut self, now: Ticks) {
        if let Some(run) = self.run.take() {
            self.held = run.count(now);
        }
        self.next_overflow = Ticks::NEVER;
        self.next_match = [Ticks::NEVER; 2];
    }

    fn resume(&mut self, now: Ticks) {
        if self.ctrla & ENABLE == 0 || self.stopped {
            return;
        }
        if let Some(clock) = self.clock {
            let rate = clock.divided(prescaler(self.ctrla));
            self.run = Some(Run::new(rate, now, self.held));
            self.schedule(now);
        }
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
                status |= if self.stopped { STOP } else { 0 };
                status |= if self.is_slave { SLAVE } else { 0 };
                (u32::from(self.interrupts) * 0x0101)
                    | u32::from(self.flags) << 16
                    | u32::from(status) << 24
            }
            0x10 => self.requested.unwrap_or_else(|| self.count(now)),
            0x18 if self.is_32_bits() => self.cc[0],
            0x18 => self.cc[0] | self.cc[1] << 16,
            0x1C if self.is_32_bits() => self.cc[1],
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let stall = self.sync.remaining(bus.now, 0);
        if stall == Ticks::NEVER && offset != 0x0C {
            return Err(Refusal::Forbidden(
                "no generic clock: the bus stalls for ever",
            ));
        }
        let now = bus.now;
        let begin = now.saturating_add(stall);
        match offset {
            0x00 => {
                if let Some(value) = lanes.half(0, self.ctrla as u16) {
                    self.write_ctrla(bus, begin, u32::from(value))?;
                }
                if let Some(request) = lanes.half(1, 0) {
                    self.read_request = request & RCONT;
                    if request & RREQ != 0 {
                        self.requested = (request & RCONT == 0).then(|| self.count(now));
                        self.begin_sync(begin);
                    }
                }
            }
            0x04 => {
                if let Some(clear) = lanes.byte(0) {
                    self.ctrlb &= !clear;
                    self.begin_sync(begin);
                }
                if let Some(set) = lanes.byte(1) {
                    self.write_ctrlbset(now, set)?;
                    self.begin_sync(begin);
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
            0x0C => {
                self.interrupts &= !lanes.byte(0).unwrap_or(0);
                self.interrupts |=
                    lanes.byte(1).unwrap_or(0) & (OVF | ERR | SYNCRDY | MC0 | MC0 << 1);
                self.flags &= !lanes.byte(2).unwrap_or(0);
                return Ok(Ticks::ZERO);
            }
            0x10 => {
                self.halt(now);
                self.held = lanes.merge(self.held) & self.max();
                self.requested = None;
                self.resume(now);
                self.begin_sync(begin);
            }
            0x18 if !self.is_32_bits() => {
                let both = lanes.merge(self.cc[0] | self.cc[1] << 16);
                self.cc = [both & 0xFFFF, both >> 16];
                self.schedule(now);
                self.begin_sync(begin);
            }
            0x18 | 0x1C if self.is_32_bits() => {
                let channel = ((offset - 0x18) / 4) as usize;
                self.cc[channel] = lanes.merge(self.cc[channel]);
                self.schedule(now);
                self.begin_sync(begin);
            }
            _ => return Err(RESERVED),
        }
        if stall == Ticks::NEVER {
            return Err(Refusal::Forbidden(
                "no generic clock: the bus stalls for ever",
            ));
        }
        Ok(stall)
    }

    fn write_ctrla(&mut self, bus: &mut Bus<'_>, begin: Ticks, value: u32) -> Result<(), Refusal> {
        if value & SWRST != 0 {
            *self = Self {
                clock: self.clock,
                sync: self.sync.clone(),
                is_slave: self.is_slave,
                ..Self::new(self.index, SyncHold::Instant)
            };
            self.begin_sync(begin);
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
        if was_enabled && (self.ctrla ^ value) & CTRLA_MODELLED != 0 {
            let what = "enable-protected CTRLA written while enabled: discarded";
            bus.violations.note(bus.now, NAMES[self.index], what);
        } else {
            self.ctrla = value & CTRLA_MODELLED | self.ctrla & ENABLE;
        }
        if was_enabled != (value & ENABLE != 0) {
            self.halt(bus.now);
            self.ctrla ^= ENABLE;
            self.stopped = was_enabled;
            self.resume(bus.now);
            self.begin_sync(begin);
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
                self.halt(now);
                self.held = 0;
                self.stopped = false;
                self.resume(now);
            }
            2 => {
                self.halt(now);
                self.stopped = true;
            }
            _ => {}
        }
        Ok(())
    }

    fn begin_sync(&mut self, begin: Ticks) {
        if self.clock.is_some() {
            self.sync.begin(begin, 0);
        } else {
            self.sync.hang(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Unconnected;
    use crate::peripherals::violations::Violations;

    struct Rig {
        tc: Tc,
        now: u64,
    }

    impl Rig {
        fn new(hold: SyncHold) -> Self {
            let mut tc = Tc::new(MASTER, hold);
            tc.set_clock(Ticks::ZERO, Some(Rate::from_hz(48_000_000)));
            Self { tc, now: 0 }
        }

        fn write(&mut self, offset: u32, lanes: Lanes) -> Write {
            let mut bus = Bus {
                now: Ticks(self.now),
                board: &mut Unconnected,
                violations: &mut Violations::default(),
            };
            self.tc.write(&mut bus, offset, lanes)
        }

        fn half(&mut self, offset: u32, value: u32) -> Ticks {
            self.write(offset & !3, Lanes::new(value, offset & 3, 2))
                .unwrap()
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
        let mut rig = Rig::new(SyncHold::Instant);
        rig.half(0x18, 5999);
        rig.half(0x00, 1 << 5 | 3 << 8 | ENABLE);
        rig.write(0x0C, Lanes::new(u32::from(OVF), 1, 1)).unwrap();
        rig.run_to(6000 * 8 - 1);
        assert!(!rig.tc.irq());
        assert_eq!(rig.read(0x10), 5999);
        rig.run_to(6000 * 8);
        assert!(rig.tc.irq());
        assert_eq!(rig.read(0x10), 0);
        rig.write(0x0C, Lanes::new(u32::from(OVF), 2, 1)).unwrap();
        assert!(!rig.tc.irq());
        rig.run_to(12_000 * 8);
        assert!(rig.tc.irq());
    }

    #[test]
    fn the_32_bit_pair_runs_as_a_time_base() {
        let mut rig = Rig::new(SyncHold::Instant);
        rig.half(0x00, MODE_COUNT32 | ENABLE);
        rig.half(0x02, u32::from(RREQ | RCONT) | 0x10);
        rig.run_to(5_000_000_000);
        assert_eq!(rig.read(0x10), (5_000_000_000u64 - (1 << 32)) as u32);
        assert_eq!(rig.read(0x0C) >> 16 & u32::from(OVF), 1);
    }

    #[test]
    fn a_single_request_freezes_what_is_read() {
        let mut rig = Rig::new(SyncHold::Instant);
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
        let mut rig = Rig::new(SyncHold::For(Ticks(100)));
        assert_eq!(rig.half(0x00, 0), Ticks::ZERO);
        assert_eq!(rig.half(0x00, ENABLE), Ticks::ZERO);
        assert_eq!(rig.read(0x0C) >> 31, 1);
        rig.run_to(40);
        assert_eq!(rig.half(0x18, 7), Ticks(60));
    }

    #[test]
    fn oneshot_stops_at_the_overflow_until_retriggered() {
        let mut rig = Rig::new(SyncHold::Instant);
        rig.half(0x18, 99);
        rig.write(0x04, Lanes::new(u32::from(ONESHOT), 1, 1))
            .unwrap();
        rig.half(0x00, 1 << 5 | ENABLE);
        rig.run_to(1000);
        assert_eq!(rig.read(0x0C) >> 24, u32::from(STOP));
        assert_eq!(rig.tc.next(), Ticks::NEVER);
        rig.write(0x04, Lanes::new(1 << 6, 1, 1)).unwrap();
        assert_eq!(rig.tc.next_overflow, Ticks(1100));
    }

    #[test]
    fn only_tc4_takes_a_second_counter() {
        let mut rig = Rig::new(SyncHold::Instant);
        rig.tc.index = 0;
        let lanes = Lanes::new(MODE_COUNT32, 0, 2);
        assert!(rig.write(0x00, lanes).is_err());
    }
}
