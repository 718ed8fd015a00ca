//! GCLK: generic clock generators and their routing.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRL | SWRST resets the generators and the routing at once |
//! | 01 | STATUS | SYNCBUSY |
//! | 02 | CLKCTRL | ID, GEN, CLKEN, WRTLOCK; a byte write of ID selects what is read back |
//! | 04 | GENCTRL | ID, SRC, GENEN, DIVSEL and stored flags; byte write of ID likewise |
//! | 08 | GENDIV | ID, DIV; byte write of ID likewise |
//!
//! Generator 2 is to divide OSCULP32K by 32 at reset, which its five bits of DIV do not hold: it
//! does not divide. A watchdog that an erased user row has on then takes a second, as on boards.
//!
//! A write while SYNCBUSY is set stalls the bus until it is clear (common synchroniser).
//! Generator 0 must run: a write that would stop it faults, as the chip would stop for ever. While
//! the source that was chosen for it is not ready, it runs on from the source before (15.6.2.6),
//! and that this one may stop is left out.
//!
//! | left out | why |
//! |---|---|
//! | clock output on pins (OE) | no board looks at it; OE is stored |
//! | sources XOSC, GCLKIN, DPLL | not modelled: such a generator stands still |
//! | duty cycle (IDC), RUNSTDBY | no model depends on them |

use super::access::{Bus, Lanes, RESERVED, Read, Refusal, Write};
use super::clock::{Rate, SyncFlags};
use super::sysctrl::Sysctrl;
use crate::Options;
use crate::board::Ticks;

const GENERATORS: usize = 9;
const CLOCKS: usize = 0x25;
const SRC: u32 = 0x1F << 8;
const GENEN: u32 = 1 << 16;
const DIVSEL: u32 = 1 << 20;
const CLKEN: u16 = 1 << 14;
const WRTLOCK: u16 = 1 << 15;

/// CLKCTRL.ID of the watchdog's clock.
const WDT: usize = 0x03;
/// CLKCTRL.ID of the slow clock of all SERCOMs: time-outs.
pub(crate) const SERCOM_SLOW: usize = 0x13;

#[derive(Clone, Debug)]
pub(crate) struct Gclk {
    sync: SyncFlags<1>,
    control: Indirect,
    divisor: Indirect,
    clocks: [u16; CLOCKS],
    /// The clock that CLKCTRL reads back.
    selected: usize,
    rates: [Option<Rate>; GENERATORS],
    /// The source that was chosen for generator 0 is not ready yet.
    waits: bool,
    /// CLKCTRL of the watchdog at reset: on if the user row has it on.
    wdt: u16,
}

/// GENCTRL or GENDIV: one register for all generators, of which ID selects one.
#[derive(Clone, Debug, Default)]
struct Indirect {
    selected: usize,
    of: [u32; GENERATORS],
}

impl Indirect {
    fn read(&self) -> u32 {
        self.of[self.selected] | self.selected as u32
    }

    /// Selects the generator that is written, and returns its new value unless ID is all that is
    /// written.
    fn select(&mut self, lanes: Lanes) -> Result<Option<u32>, Refusal> {
        let value = lanes.merge(self.read());
        let id = (value & 0xF) as usize;
        if id >= GENERATORS {
            return Err(Refusal::Unmodelled("generator ID above 8"));
        }
        self.selected = id;
        Ok(lanes.touches(!0xFF).then_some(value))
    }
}

impl Gclk {
    pub(crate) fn new(options: &Options) -> Self {
        let mut sync = SyncFlags::new(options.syncbusy_hold);
        let wdt_runs = options.user_row.wdt_ctrl() & 1 << 1 != 0;
        sync.set_clocked(Ticks::ZERO, true);
        Self::after_reset(sync, [None; GENERATORS], 2 << 8 | if wdt_runs { CLKEN } else { 0 })
    }

    fn after_reset(sync: SyncFlags<1>, rates: [Option<Rate>; GENERATORS], wdt: u16) -> Self {
        let (mut control, mut divisor) = (Indirect::default(), Indirect::default());
        // Generator 0 from OSC8M; generator 2, the watchdog's, from OSCULP32K.
        control.of[0] = 6 << 8 | GENEN;
        control.of[2] = 3 << 8 | GENEN;
        divisor.of[2] = 32 << 8;
        let mut clocks = [0; CLOCKS];
        clocks[WDT] = wdt;
        Self { sync, control, divisor, clocks, selected: 0, rates, waits: false, wdt }
    }

    /// The rate of generator 0, the CPU's.
    pub(crate) fn main(&self) -> Option<Rate> {
        self.rates[0]
    }

    /// The rate of the clock with identity `id`, `None` if it stands still.
    pub(crate) fn clock(&self, id: usize) -> Option<Rate> {
        let entry = self.clocks[id];
        let generator = usize::from(entry >> 8 & 0xF);
        (entry & CLKEN != 0).then(|| self.rates.get(generator).copied().flatten()).flatten()
    }

    /// Works out all rates anew from the oscillators.
    pub(crate) fn resolve(&mut self, now: Ticks, sysctrl: &Sysctrl) {
        // Generator 1 first: it may be the source of others.
        for index in [1, 0, 2, 3, 4, 5, 6, 7, 8] {
            let control = self.control.of[index];
            let source = match (control & SRC) >> 8 {
                2 if index != 1 => self.rates[1],
                3 => Some(sysctrl.osculp32k()),
                4 => sysctrl.osc32k(now),
                6 => sysctrl.osc8m(),
                7 => sysctrl.dfll(now),
                _ => None,
            };
            let rate = source
                .filter(|_| control & GENEN != 0)
                .map(|rate| rate.divided(self.division(index)));
            self.waits &= index != 0 || rate.is_none();
            if index != 0 || !self.waits {
                self.rates[index] = rate;
            }
        }
    }

    fn division(&self, index: usize) -> u64 {
        let bits = match index {
            1 => 16,
            2 => 5,
            _ => 8,
        };
        let div = u64::from(self.divisor.of[index] >> 8 & 0xFFFF) & ((1 << bits) - 1);
        if self.control.of[index] & DIVSEL != 0 { 1 << (div + 1).min(bits + 1) } else { div.max(1) }
    }

    /// A bit of a register flips: see [`upset`](crate::upset).
    pub(crate) fn flip(&mut self, offset: u32, bit: u32) -> bool {
        let mask = 1_u32 << bit;
        let index = (offset as usize % 0x40) / 4;
        match offset {
            0x40..0x64 if mask & (0x1F00 | GENEN | DIVSEL) != 0 => self.control.of[index] ^= mask,
            0x80..0xA4 if (8..24).contains(&bit) => self.divisor.of[index] ^= mask,
            0x100..0x194 if mask & (0x0F00 | u32::from(CLKEN)) != 0 => {
                self.clocks[(offset as usize - 0x100) / 4] ^= mask as u16;
            }
            _ => return false,
        }
        true
    }

    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => {
                let busy = u32::from(self.sync.is_busy(now, 0));
                let clkctrl = u32::from(self.clocks[self.selected]) | self.selected as u32;
                // CTRL.SWRST reads 1 while the reset synchronises; it shares the one flag.
                busy << 15 | clkctrl << 16
            }
            0x04 => self.control.read(),
            0x08 => self.divisor.read(),
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let stall = self.sync.remaining(bus.now, 0);
        let begin = bus.now + stall;
        match offset {
            0x00 => {
                if lanes.byte(0).is_some_and(|ctrl| ctrl & 1 != 0) {
                    *self = Self::after_reset(self.sync.clone(), self.rates, self.wdt);
                    self.sync.begin(begin, 0);
                }
                let selected = self.clocks[self.selected] | self.selected as u16;
                if let Some(value) = lanes.half(1, selected) {
                    let id = usize::from(value & 0x3F);
                    if id >= CLOCKS {
                        return Err(Refusal::Unmodelled("CLKCTRL.ID"));
                    }
                    self.selected = id;
                    if lanes.byte(3).is_some() && self.clocks[id] & WRTLOCK == 0 {
                        if usize::from(value >> 8 & 0xF) >= GENERATORS {
                            return Err(Refusal::Unmodelled("CLKCTRL.GEN above 8"));
                        }
                        self.clocks[id] = value & 0xCF00;
                    }
                }
            }
            0x04 => {
                if let Some(value) = self.control.select(lanes)? {
                    if self.control.selected == 0 && value & GENEN == 0 {
                        return Err(Refusal::Forbidden("generator 0 drives the CPU"));
                    }
                    let before = &mut self.control.of[self.control.selected];
                    let changes = (*before ^ value) & SRC != 0;
                    let is_modelled = matches!((value & SRC) >> 8, 2 | 3 | 4 | 6 | 7);
                    self.waits |= self.control.selected == 0 && changes && is_modelled;
                    *before = value & 0x003F_1F00;
                    self.sync.begin(begin, 0);
                }
            }
            0x08 => {
                if let Some(value) = self.divisor.select(lanes)? {
                    self.divisor.of[self.divisor.selected] = value & 0x00FF_FF00;
                    self.sync.begin(begin, 0);
                }
            }
            _ => return Err(RESERVED),
        }
        Ok(stall)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(gclk: &mut Gclk, now: Ticks, offset: u32, lanes: Lanes) -> Ticks {
        Bus::alone(now, |bus| gclk.write(bus, offset, lanes)).unwrap()
    }

    fn hz(rate: Option<Rate>) -> f64 {
        rate.map_or(0.0, Rate::hz)
    }

    #[test]
    fn reset_runs_at_1_mhz_from_osc8m() {
        let mut gclk = Gclk::new(&Options::default());
        gclk.resolve(Ticks::ZERO, &Sysctrl::new(&Options::default()));
        assert_eq!(hz(gclk.main()), 1e6);
        assert_eq!(gclk.clock(0x14), None);
    }

    /// The DFLL is off: generator 0 goes on from OSC8M, and a change of its divisor counts later.
    #[test]
    fn generator_0_runs_on_until_its_new_source_is_ready() {
        let mut gclk = Gclk::new(&Options::default());
        let sysctrl = Sysctrl::new(&Options::default());
        gclk.resolve(Ticks::ZERO, &sysctrl);
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::word(7 << 8 | GENEN));
        gclk.resolve(Ticks::ZERO, &sysctrl);
        assert_eq!(hz(gclk.main()), 1e6);
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::word(3 << 8 | GENEN));
        gclk.resolve(Ticks::ZERO, &sysctrl);
        assert_eq!(hz(gclk.main()), 32_768.0);
        // A crystal is not modelled.
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::word(5 << 8 | GENEN));
        gclk.resolve(Ticks::ZERO, &sysctrl);
        assert_eq!(gclk.main(), None);
    }

    #[test]
    fn a_generator_divides_linearly_or_by_powers_of_two() {
        let mut gclk = Gclk::new(&Options::default());
        let route = |gclk: &mut Gclk, id: u32, generator: u32| {
            let half = id | generator << 8 | 1 << 14;
            write(gclk, Ticks::ZERO, 0x00, Lanes::new(half, 2, 2));
        };
        // Generator 3: OSCULP32K / 32, as a watchdog wants it.
        write(&mut gclk, Ticks::ZERO, 0x08, Lanes::word(3 | 32 << 8));
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::word(3 | 3 << 8 | GENEN));
        route(&mut gclk, 0x03, 3);
        gclk.resolve(Ticks::ZERO, &Sysctrl::new(&Options::default()));
        assert_eq!(hz(gclk.clock(WDT)), 1024.0);
        // The same with DIVSEL: 2^(4+1).
        write(&mut gclk, Ticks::ZERO, 0x08, Lanes::word(3 | 4 << 8));
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::word(3 | 3 << 8 | GENEN | DIVSEL));
        gclk.resolve(Ticks::ZERO, &Sysctrl::new(&Options::default()));
        assert_eq!(hz(gclk.clock(WDT)), 1024.0);
    }

    #[test]
    fn a_byte_write_of_the_id_selects_what_is_read() {
        let mut gclk = Gclk::new(&Options::default());
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::new(2, 0, 1));
        assert_eq!(gclk.read(Ticks::ZERO, 0x04), Ok(2 | 3 << 8 | GENEN));
        write(&mut gclk, Ticks::ZERO, 0x04, Lanes::new(0, 0, 1));
        assert_eq!(gclk.read(Ticks::ZERO, 0x04), Ok(6 << 8 | GENEN));
        write(&mut gclk, Ticks::ZERO, 0x00, Lanes::new(0x03, 2, 1));
        assert_eq!(gclk.read(Ticks::ZERO, 0x00), Ok(0x0203 << 16));
    }

    #[test]
    fn a_write_during_synchronisation_stalls_the_bus() {
        let mut gclk = Gclk::new(&Options { syncbusy_hold: Ticks(100), ..Options::default() });
        assert_eq!(write(&mut gclk, Ticks(0), 0x08, Lanes::word(3)), Ticks(0));
        assert_eq!(gclk.read(Ticks(99), 0x00).unwrap() & 0x8000, 0x8000);
        assert_eq!(write(&mut gclk, Ticks(40), 0x08, Lanes::word(3)), Ticks(60));
        assert_eq!(gclk.read(Ticks(199), 0x00).unwrap() & 0x8000, 0x8000);
        assert_eq!(gclk.read(Ticks(200), 0x00).unwrap() & 0x8000, 0);
    }
}
