//! EIC: external interrupt controller.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRL | SWRST, ENABLE |
//! | 01 | STATUS | SYNCBUSY; a write meanwhile stalls the bus |
//! | 02-04 | NMICTRL, NMIFLAG, EVCTRL | only 0 |
//! | 08, 0C, 10 | INTENCLR, INTENSET, INTFLAG | one bit a line |
//! | 14 | WAKEUP | stored; every interrupt wakes |
//! | 18, 1C | CONFIG | SENSE of each line; FILTEN stored |
//!
//! A line is the level at the pin that function A gives to it. Pins are looked at every 100 us
//! while a line is sensed; edges need the generic clock, levels do not.
//!
//! | left out | why |
//! |---|---|
//! | pulses shorter than 100 us | looking more often would slow the emulation |
//! | NMI, events | not used: setting one faults |
//! | the filter | a board has no noise on its pins |

use super::access::{Bus, Lanes, RESERVED, Read, Refusal, Write};
use super::clock::SyncFlags;
use super::interrupts::Interrupts;
use super::map::Block;
use super::multiplexer::interrupt_line;
use super::port::Port;
use crate::board::Ticks;

const SWRST: u8 = 1 << 0;
const ENABLE: u8 = 1 << 1;
const LINES: u32 = 0xFFFF;
const SAMPLE: Ticks = Ticks::from_us(100);

#[derive(Clone, Debug, Default)]
pub(crate) struct Eic {
    sync: SyncFlags<1>,
    enabled: bool,
    pub(crate) interrupts: Interrupts<LINES>,
    wakeup: u32,
    config: [u32; 2],
    levels: u32,
    pub(crate) next_sample: Ticks,
}

impl Eic {
    pub(crate) fn new(hold: Ticks) -> Self {
        Self {
            sync: SyncFlags::new(hold),
            interrupts: Interrupts::of(Block::Eic),
            next_sample: Ticks::NEVER,
            ..Self::default()
        }
    }

    pub(crate) fn set_clock(&mut self, now: Ticks, clocked: bool) {
        self.sync.set_clocked(now, clocked);
    }

    pub(crate) fn advance(&mut self, bus: &mut Bus<'_>, port: &Port) {
        let before = self.levels;
        let clocked = self.sync.clocked;
        self.sample(bus, port);
        for line in 0..16 {
            let (was, is) = (before >> line & 1 != 0, self.levels >> line & 1 != 0);
            let sensed = match self.sense(line) {
                1 => clocked && !was && is,
                2 => clocked && was && !is,
                3 => clocked && was != is,
                4 => is,
                5 => !is,
                _ => false,
            };
            self.interrupts.flags |= u32::from(sensed) << line;
        }
        self.next_sample = bus.now + SAMPLE;
    }

    fn sense(&self, line: usize) -> u32 {
        self.config[line / 8] >> (4 * (line % 8)) & 7
    }

    fn sample(&mut self, bus: &Bus<'_>, port: &Port) {
        self.levels = 0;
        for pin in Port::pins() {
            if let Some(line) = interrupt_line(pin)
                && self.sense(usize::from(line)) != 0
                && port.interrupt_routed(pin)
                && port.level(bus.now, pin, bus.board)
            {
                self.levels |= 1 << line;
            }
        }
    }

    pub(crate) fn read(&self, now: Ticks, offset: u32) -> Read {
        Ok(match offset {
            0x00 => {
                let enable = if self.enabled { ENABLE } else { 0 };
                u32::from(enable) | u32::from(self.sync.is_busy(now, 0)) << 15
            }
            0x04 => 0,
            0x08 | 0x0C | 0x10 => self.interrupts.read_words(offset - 0x08),
            0x14 => self.wakeup,
            0x18 => self.config[0],
            0x1C => self.config[1],
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(
        &mut self,
        bus: &mut Bus<'_>,
        offset: u32,
        lanes: Lanes,
        port: &Port,
    ) -> Write {
        let mut stall = Ticks::ZERO;
        match offset {
            0x00 => {
                if lanes.bits() >> 16 != 0 {
                    return Err(Refusal::Unmodelled("the non-maskable interrupt"));
                }
                if let Some(ctrl) = lanes.byte(0) {
                    stall = self.sync.stall(bus.now, 0)?;
                    if ctrl & SWRST != 0 {
                        *self = Self { sync: self.sync.clone(), ..Self::new(Ticks::ZERO) };
                    } else {
                        self.enabled = ctrl & ENABLE != 0;
                    }
                    self.sync.begin(bus.now + stall, 0);
                }
            }
            0x04 => {
                if lanes.bits() != 0 {
                    return Err(Refusal::Unmodelled("EVCTRL"));
                }
            }
            0x08 | 0x0C | 0x10 => self.interrupts.write_words(offset - 0x08, lanes),
            0x14 => self.wakeup = lanes.merge(self.wakeup) & LINES,
            0x18 | 0x1C => {
                let config = &mut self.config[((offset - 0x18) / 4) as usize];
                *config = lanes.merge(*config);
            }
            _ => return Err(RESERVED),
        }
        let was_watching = self.next_sample != Ticks::NEVER;
        let watches = self.enabled && (0..16).any(|line| self.sense(line) != 0);
        if watches && !was_watching {
            // Edges count from here on.
            self.sample(bus, port);
            self.next_sample = bus.now + SAMPLE;
        } else if !watches {
            self.next_sample = Ticks::NEVER;
        }
        Ok(stall)
    }
}
