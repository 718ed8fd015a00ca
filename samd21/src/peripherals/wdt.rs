//! WDT: watchdog timer.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRL | ENABLE, WEN, ALWAYSON; slowly synchronised |
//! | 01 | CONFIG | PER: timeout after 8 << PER clocks; WINDOW; only while disabled |
//! | 02 | EWCTRL | EWOFFSET: early warning after 8 << EWOFFSET clocks; only while disabled |
//! | 04, 05, 06 | INTENCLR, INTENSET, INTFLAG | EW |
//! | 07 | STATUS | SYNCBUSY |
//! | 08 | CLEAR | 0xA5 restarts the timeout, slowly synchronised; else the chip is reset at once |
//!
//! With WEN the first 8 << WINDOW clocks are closed: a CLEAR in them resets the chip; PER counts
//! from their end. All settings come from the user row at reset, and with its ENABLE the watchdog
//! runs. Codes above 11 are reserved and taken for 11, the longest.
//!
//! CTRL and CLEAR reach the watchdog's own clock (1,024 Hz as a rule) after its next edge and five
//! periods: 4.9 to 5.9 ms, and take effect only then. A second write to one of them meanwhile
//! stalls the bus until the first has arrived (data sheet, register synchronisation): the CPU and
//! all interrupts stand still. With no clock the first write waits for one, as in images that run
//! on boards; the second would stall for ever: that faults.

use super::access::{Bus, Lanes, RESERVED, Read, Refusal, Write};
use super::clock::Rate;
use super::interrupts::Interrupts;
use super::map::Block;
use crate::Options;
use crate::board::Ticks;

const ENABLE: u8 = 1 << 1;
const WEN: u8 = 1 << 2;
const ALWAYSON: u8 = 1 << 7;
/// Early warning, the one interrupt.
const EW: u32 = 1 << 0;
const KEY: u8 = 0xA5;
/// Clock periods from the first edge until a write has arrived.
const SYNC_PERIODS: u64 = 5;

/// The register whose write is being synchronised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arrival {
    Control,
    Clear,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Wdt {
    clock: Option<Rate>,
    /// When the clock stopped, and its rate before: the counter stands still.
    stopped: Option<(Ticks, Rate)>,
    /// How far that was into a cycle at time zero.
    phase: Ticks,
    ctrl: u8,
    config: u8,
    ewctrl: u8,
    pub(crate) interrupts: Interrupts<EW>,
    arriving: Option<(Ticks, Arrival)>,
    early_warning: Ticks,
    timeout: Ticks,
    /// When the closed window ends.
    opens: Ticks,
    bites: bool,
    /// It never resets the chip at its time-out.
    is_dead: bool,
}

impl Wdt {
    pub(crate) fn new(options: &Options) -> Self {
        let row = options.user_row;
        Self {
            phase: options.osculp32k_phase,
            is_dead: !options.watchdog_bites,
            ctrl: row.wdt_ctrl(),
            config: row.wdt_config(),
            ewctrl: row.wdt_early_warning(),
            interrupts: Interrupts::of(Block::Wdt),
            early_warning: Ticks::NEVER,
            timeout: Ticks::NEVER,
            ..Self::default()
        }
    }

    /// It starts if it is enabled: after a reset the user row says so.
    pub(crate) fn power_up(&mut self, now: Ticks) {
        if self.ctrl & ENABLE != 0 {
            self.start(now);
        }
    }

    /// The generic clock. What is counted already stays counted.
    pub(crate) fn set_clock(&mut self, now: Ticks, clock: Option<Rate>) {
        let last = self.stopped.take().or(self.clock.map(|rate| (now, rate)));
        match (last, clock) {
            (Some((until, old)), Some(new)) if (until, old) != (now, new) => {
                for at in [&mut self.early_warning, &mut self.timeout, &mut self.opens] {
                    if *at > until && *at != Ticks::NEVER {
                        *at = now + new.duration(old.cycles_in(*at - until));
                    }
                }
            }
            (_, None) => self.stopped = last,
            _ => {}
        }
        self.clock = clock;
        if let Some((at @ Ticks::NEVER, _)) = &mut self.arriving
            && let Some(clock) = clock
        {
            *at = Self::arrival(clock, now, self.phase);
        }
    }

    /// When a write of this moment reaches the watchdog.
    fn arrival(clock: Rate, now: Ticks, phase: Ticks) -> Ticks {
        let edge = clock.cycles_in(now + phase) + 1;
        clock.duration(edge + SYNC_PERIODS).saturating_sub(phase)
    }

    /// Whether the watchdog has reset the chip since this was last asked.
    pub(crate) fn take_bite(&mut self) -> bool {
        std::mem::take(&mut self.bites)
    }

    pub(crate) fn next(&self) -> Ticks {
        let arrival = self.arriving.map_or(Ticks::NEVER, |(at, _)| at);
        match self.clock {
            Some(_) => arrival.min(self.early_warning).min(self.timeout),
            None => arrival,
        }
    }

    pub(crate) fn advance(&mut self, now: Ticks) {
        let counts = self.clock.is_some();
        if counts && self.early_warning <= now {
            self.early_warning = Ticks::NEVER;
            self.interrupts.flags |= EW;
        }
        if counts && self.timeout <= now {
            self.timeout = Ticks::NEVER;
            self.bites = !self.is_dead;
        }
        if let Some((at, arrival)) = self.arriving
            && at <= now
        {
            self.arriving = None;
            let early = self.ctrl & WEN != 0 && now < self.opens;
            if self.ctrl & ENABLE == 0 {
                self.early_warning = Ticks::NEVER;
                self.timeout = Ticks::NEVER;
            } else if arrival == Arrival::Clear && early {
                self.bites = true;
            } else if arrival == Arrival::Clear || self.timeout == Ticks::NEVER {
                self.start(now);
            }
        }
    }

    /// Restarts timeout and early warning.
    fn start(&mut self, now: Ticks) {
        let Some(clock) = self.clock else { return };
        let edge = clock.cycles_in(now + self.phase);
        let at = |edge| clock.duration(edge).saturating_sub(self.phase);
        let cycles = |exponent: u8| 8 << exponent.min(0xB);
        let closed = match self.ctrl & WEN {
            0 => 0,
            _ => cycles(self.config >> 4),
        };
        self.opens = at(edge + closed);
        self.timeout = at(edge + closed + cycles(self.config & 0xF));
        self.early_warning = at(edge + cycles(self.ewctrl & 0xF));
        if self.early_warning >= self.timeout {
            self.early_warning = Ticks::NEVER;
        }
    }

    /// A bit of a register flips: see [`upset`](crate::upset). CONFIG and EWCTRL count from the
    /// next start on.
    pub(crate) fn flip(&mut self, now: Ticks, offset: u32, bit: u32) -> bool {
        let mask = (1_u32 << (bit % 8)) as u8;
        match (offset, bit / 8) {
            (0x00, 0) if mask & (ENABLE | WEN | ALWAYSON) != 0 => {
                self.ctrl ^= mask;
                if mask == ENABLE {
                    self.early_warning = Ticks::NEVER;
                    self.timeout = Ticks::NEVER;
                    self.power_up(now);
                }
            }
            (0x00, 1) => self.config ^= mask,
            (0x00, 2) if mask < 16 => self.ewctrl ^= mask,
            (0x04, 1) => return self.interrupts.flip(mask.into()),
            _ => return false,
        }
        true
    }

    pub(crate) fn read(&self, offset: u32) -> Read {
        Ok(match offset {
            0x00 => {
                u32::from(self.ctrl) | u32::from(self.config) << 8 | u32::from(self.ewctrl) << 16
            }
            0x04 => {
                let busy = u32::from(self.arriving.is_some());
                self.interrupts.read_bytes() | busy << 31
            }
            0x08 => 0,
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let mut stall = Ticks::ZERO;
        match offset {
            0x00 => {
                if let Some(ctrl) = lanes.byte(0) {
                    stall = self.write_ctrl(bus, ctrl)?;
                }
                if let Some(config) = lanes.byte(1)
                    && self.is_open(bus)
                {
                    self.config = config;
                }
                if let Some(ewctrl) = lanes.byte(2)
                    && self.is_open(bus)
                {
                    self.ewctrl = ewctrl & 0xF;
                }
            }
            0x04 => self.interrupts.write_bytes(lanes),
            0x08 => match lanes.byte(0) {
                Some(KEY) => stall = self.send(bus, Arrival::Clear)?,
                Some(_) => {
                    bus.note("WDT", "CLEAR written without its key");
                    self.bites |= self.ctrl & ENABLE != 0;
                }
                None => {}
            },
            _ => return Err(RESERVED),
        }
        Ok(stall)
    }

    fn write_ctrl(&mut self, bus: &mut Bus<'_>, value: u8) -> Write {
        if self.ctrl & ALWAYSON != 0 {
            bus.note("WDT", "CTRL written with ALWAYSON set: ignored");
            return Ok(Ticks::ZERO);
        }
        let stall = self.send(bus, Arrival::Control)?;
        self.ctrl = value & (ENABLE | WEN | ALWAYSON);
        Ok(stall)
    }

    /// Whether the configuration may be written.
    fn is_open(&self, bus: &mut Bus<'_>) -> bool {
        let open = self.ctrl & (ENABLE | ALWAYSON) == 0;
        if !open {
            bus.note("WDT", "configured while enabled: discarded");
        }
        open
    }

    /// Starts the synchronisation of a write; returns the stall that the one before it causes.
    fn send(&mut self, bus: &mut Bus<'_>, arrival: Arrival) -> Write {
        let begin = match self.arriving {
            Some((Ticks::NEVER, _)) => {
                return Err(Refusal::Forbidden(
                    "a second write without a generic clock stalls the CPU for ever",
                ));
            }
            Some((at, _)) => {
                bus.note("WDT", "written while SYNCBUSY: the CPU stands still");
                // It arrives during the stall.
                self.advance(at);
                at
            }
            None => bus.now,
        };
        let arrives =
            self.clock.map_or(Ticks::NEVER, |clock| Self::arrival(clock, begin, self.phase));
        self.arriving = Some((arrives, arrival));
        Ok(begin - bus.now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripherals::UserRow;

    struct Rig {
        wdt: Wdt,
        now: Ticks,
    }

    impl Rig {
        /// 125 ms timeout, warning at 62.5 ms, enabled at 1 ms.
        fn running() -> Self {
            let mut wdt = Wdt::new(&Options::default());
            wdt.set_clock(Ticks::ZERO, Some(Rate::from_hz(1024)));
            let mut rig = Self { wdt, now: Ticks::from_ms(1) };
            rig.write(0x00, Lanes::new(0x04, 1, 1));
            rig.write(0x00, Lanes::new(0x03, 2, 1));
            rig.write(0x04, Lanes::new(1, 1, 1));
            rig.write(0x00, Lanes::new(u32::from(ENABLE), 0, 1));
            rig
        }

        fn write(&mut self, offset: u32, lanes: Lanes) -> Ticks {
            Bus::alone(self.now, |bus| self.wdt.write(bus, offset, lanes)).unwrap()
        }

        fn clear(&mut self) -> Ticks {
            self.write(0x08, Lanes::new(u32::from(KEY), 0, 1))
        }

        fn busy(&self) -> bool {
            self.wdt.read(0x04).unwrap() >> 31 != 0
        }

        fn run_to(&mut self, us: u64) {
            let until = Ticks::from_us(us);
            while self.wdt.next() <= until {
                self.wdt.advance(self.wdt.next());
            }
            self.now = until;
        }
    }

    #[test]
    fn it_starts_slowly_warns_and_bites() {
        let mut rig = Rig::running();
        // The edge after 1 ms is at 1.953 ms; five periods later the enable arrives: 6.836 ms.
        rig.run_to(6835);
        assert!(rig.busy());
        rig.run_to(6837);
        assert!(!rig.busy());
        // 64 and 128 cycles of 1024 Hz after that.
        rig.run_to(6835 + 62_500);
        assert_eq!(rig.wdt.interrupts.irq(), 0);
        rig.run_to(6837 + 62_500);
        assert_eq!(rig.wdt.interrupts.irq(), 1 << 2);
        rig.run_to(6835 + 125_000);
        assert!(!rig.wdt.take_bite());
        rig.run_to(6837 + 125_000);
        assert!(rig.wdt.take_bite());
        assert!(!rig.wdt.take_bite());
    }

    #[test]
    fn its_clock_has_a_phase_of_its_own() {
        let mut rig = Rig::running();
        rig.wdt.phase = Ticks::from_us(500);
        rig.run_to(20_000);
        rig.clear();
        // Edges are at 20.008, 20.984 ms and so on; the clear arrives at the sixth, 24.891 ms.
        rig.run_to(24_890);
        assert!(rig.busy());
        rig.run_to(24_892);
        assert!(!rig.busy());
        rig.run_to(24_890 + 125_000);
        assert!(!rig.wdt.take_bite());
        rig.run_to(24_892 + 125_000);
        assert!(rig.wdt.take_bite());
    }

    #[test]
    fn a_clear_counts_when_it_arrives() {
        let mut rig = Rig::running();
        for step in 1..50 {
            rig.run_to(20_000 * step);
            assert_eq!(rig.clear(), Ticks::ZERO);
            assert!(rig.busy());
        }
        assert_eq!(rig.wdt.interrupts.flags, 0);
        // The last clear is at 980 ms and arrives at the sixth edge after it: 985.352 ms.
        rig.run_to(985_352 + 62_498);
        assert_eq!(rig.wdt.interrupts.flags, 0);
        rig.run_to(985_352 + 62_502);
        assert_eq!(rig.wdt.interrupts.flags, EW);
        assert!(!rig.wdt.take_bite());
    }

    #[test]
    fn a_second_clear_stalls_until_the_first_has_arrived() {
        let mut rig = Rig::running();
        rig.run_to(20_000);
        assert_eq!(rig.clear(), Ticks::ZERO);
        rig.run_to(20_100);
        let stall = rig.clear().as_us();
        // 20.508 ms is the next edge; 25.391 ms the arrival.
        assert!((5290..=5292).contains(&stall), "{stall} us");
        rig.run_to(20_100 + stall + 1);
        assert!(rig.busy(), "the second is on its way");
    }

    #[test]
    fn another_clock_takes_over_what_is_left() {
        let mut rig = Rig::running();
        rig.run_to(6_836 + 25_000);
        rig.wdt.set_clock(rig.now, Some(Rate::from_hz(2048)));
        rig.run_to(6_836 + 25_000 + 49_000);
        assert!(!rig.wdt.take_bite());
        rig.run_to(6_836 + 25_000 + 51_000);
        assert!(rig.wdt.take_bite(), "100 ms were left");
    }

    #[test]
    fn without_a_clock_it_stands_still() {
        let mut rig = Rig::running();
        rig.run_to(6_836 + 25_000);
        rig.wdt.set_clock(rig.now, None);
        rig.run_to(1_006_836);
        assert_eq!((rig.wdt.take_bite(), rig.wdt.interrupts.flags), (false, 0));
        rig.wdt.set_clock(rig.now, Some(Rate::from_hz(2048)));
        rig.run_to(1_006_836 + 49_000);
        assert!(!rig.wdt.take_bite());
        rig.run_to(1_006_836 + 51_000);
        assert!(rig.wdt.take_bite(), "100 ms were left");
    }

    #[test]
    fn a_dead_one_warns_and_does_not_bite() {
        let mut rig = Rig::running();
        rig.wdt.is_dead = true;
        rig.run_to(1_000_000);
        assert!(!rig.wdt.take_bite());
        assert_eq!(rig.wdt.interrupts.flags, EW);
    }

    #[test]
    fn an_erased_user_row_has_it_always_on_with_a_window_of_16_s() {
        let erased = || {
            let options = Options { user_row: UserRow::ERASED, ..Options::default() };
            let mut wdt = Wdt::new(&options);
            wdt.set_clock(Ticks::ZERO, Some(Rate::from_hz(1024)));
            wdt.power_up(Ticks::ZERO);
            Rig { wdt, now: Ticks::ZERO }
        };
        let mut rig = erased();
        rig.write(0x00, Lanes::new(0, 0, 1));
        rig.run_to(31_999_000);
        assert!(!rig.wdt.take_bite(), "cannot be turned off, takes 32 s");
        rig.run_to(32_001_000);
        assert!(rig.wdt.take_bite());

        let mut rig = erased();
        rig.run_to(15_900_000);
        rig.clear();
        rig.run_to(15_910_000);
        assert!(rig.wdt.take_bite(), "fed in the closed window");

        let mut rig = erased();
        rig.run_to(16_100_000);
        rig.clear();
        rig.run_to(40_000_000);
        assert!(!rig.wdt.take_bite(), "fed in the open one");
    }

    #[test]
    fn a_wrong_key_resets_at_once() {
        let mut rig = Rig::running();
        rig.run_to(20_000);
        rig.write(0x08, Lanes::new(0x5A, 0, 1));
        assert!(rig.wdt.take_bite());
    }

    #[test]
    fn configuration_is_closed_while_enabled() {
        let mut rig = Rig::running();
        rig.write(0x00, Lanes::new(0x0B, 1, 1));
        assert_eq!(rig.wdt.read(0x00).unwrap() >> 8 & 0xFF, 0x04);
    }

    #[test]
    fn disabling_stops_it() {
        let mut rig = Rig::running();
        rig.run_to(20_000);
        rig.write(0x00, Lanes::new(0, 0, 1));
        rig.run_to(1_000_000);
        assert!(!rig.wdt.take_bite());
    }

    #[test]
    fn without_a_clock_the_first_write_waits_and_the_second_is_refused() {
        let mut rig = Rig { wdt: Wdt::new(&Options::default()), now: Ticks::from_ms(1) };
        assert_eq!(rig.write(0x00, Lanes::new(u32::from(ENABLE), 0, 1)), Ticks::ZERO);
        rig.run_to(10_000);
        assert!(rig.busy());
        let lanes = Lanes::new(u32::from(KEY), 0, 1);
        assert!(Bus::alone(rig.now, |bus| rig.wdt.write(bus, 0x08, lanes)).is_err());
        rig.wdt.set_clock(rig.now, Some(Rate::from_hz(1024)));
        rig.run_to(16_000);
        assert!(!rig.busy());
    }
}
