//! SERCOM0 to SERCOM5 as I2C masters, and as USARTs ([`usart`]). The master whose pads 0 and 1 the
//! pin multiplexers connect to the board's I2C lines reaches its bus; the data sheet's list of pins
//! that support I2C is not checked.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE, MODE 5, SPEED, SDAHOLD (stored), INACTOUT, LOWTOUTEN |
//! | 04 | CTRLB | ACKACT; CMD 1 to 3, reads 0 |
//! | 0C | BAUD | BAUD and BAUDLOW: bit time below |
//! | 14, 16, 18 | INTENCLR, INTENSET, INTFLAG | MB, SB, ERROR; cleared by ones |
//! | 1A | STATUS | BUSERR, ARBLOST, RXNACK, BUSSTATE, LOWTOUT, CLKHOLD |
//! | 1C | SYNCBUSY | SWRST, ENABLE, SYSOP |
//! | 24 | ADDR | 7-bit address and direction: START or repeated START |
//! | 28 | DATA | a write sends, a read gives the byte received |
//! | 30 | DBGCTRL | stored |
//!
//! A command, ADDR or DATA write in a state where the chip ignores it is ignored and noted. What
//! happens on the bus is in `bus`.
//!
//! | left out | why |
//! |---|---|
//! | SPI, I2C slave, USART with an external clock | setting MODE to one faults |
//! | smart mode, quick command, LENEN, 10 bits, high speed, PINOUT, MEXT and SEXT time-outs | not modelled: setting one faults |
//! | DMA | DMAC is not modelled |

mod bus;
#[cfg(test)]
mod tests;
mod usart;

use super::access::{Bus, DONE, ENABLE, Lanes, RESERVED, Read, Refusal, SWRST, Write};
use super::clock::{Rate, SyncFlags};
use super::interrupts::Interrupts;
use super::map::{Block, entry};
use crate::board::{Board, Lines, Ticks};
use bus::{BusState, Direction, Motion};
use usart::Usart;

const MODE: u32 = 7 << 2;
const MODE_I2C_MASTER: u32 = 5 << 2;
const MODE_USART: u32 = 1 << 2;
const LOWTOUTEN: u32 = 1 << 30;
/// CTRLA: MODE, RUNSTDBY, SDAHOLD, SPEED up to fast-mode plus, INACTOUT, LOWTOUTEN.
const CTRLA_MODELLED: u32 = MODE | 1 << 7 | 3 << 20 | 1 << 24 | 3 << 28 | LOWTOUTEN;

const ACKACT: u32 = 1 << 18;

const MB: u32 = 1 << 0;
const SB: u32 = 1 << 1;
const ERROR: u32 = 1 << 7;

const BUSERR: u16 = 1 << 0;
const ARBLOST: u16 = 1 << 1;
const RXNACK: u16 = 1 << 2;
const LOWTOUT: u16 = 1 << 6;
const CLKHOLD: u16 = 1 << 7;

/// Bits of SYNCBUSY.
mod busy {
    pub(super) const SWRST: usize = 0;
    pub(super) const ENABLE: usize = 1;
    pub(super) const SYSOP: usize = 2;
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Sercom {
    index: usize,
    clock: Option<Rate>,
    /// GCLK_SERCOM_SLOW runs: time-outs work.
    slow_clock: bool,
    /// The bus hangs on this SERCOM's pads.
    pub(crate) connected: bool,
    sync: SyncFlags<3>,
    ctrla: u32,
    ctrlb: u32,
    baud: u32,
    debug: u8,
    pub(crate) interrupts: Interrupts<{ MB | SB | ERROR }>,
    /// STATUS without BUSSTATE and CLKHOLD.
    status: u16,
    state: BusState,
    busy_since: Ticks,
    address: u8,
    data: u8,
    /// The master holds SCL low, after a byte of this direction, until it gets a command.
    held: Option<Direction>,
    motion: Motion,
    /// A start waits for the end of the stop.
    restarts: bool,
    /// When the motion goes on.
    due: Ticks,
    /// Since when SCL is low without going on.
    scl_low_since: Option<Ticks>,
    /// What others held low when last looked at.
    lines: Lines,
    /// In place of all this, with MODE 1.
    usart: Option<Box<Usart>>,
}

impl Sercom {
    pub(crate) fn new(index: usize, hold: Ticks) -> Self {
        Self {
            index,
            sync: SyncFlags::new(hold),
            interrupts: Interrupts::of(Block::Sercom(index)),
            due: Ticks::NEVER,
            ..Self::default()
        }
    }

    /// The generic clocks: the core's rate, and whether the slow one runs.
    pub(crate) fn set_clocks(&mut self, now: Ticks, core: Option<Rate>, slow: bool) {
        self.sync.set_clocked(now, core.is_some());
        self.clock = core;
        self.slow_clock = slow;
    }

    /// The NVIC's line if it is requested, else 0.
    pub(crate) fn irq(&self) -> u32 {
        self.interrupts.irq() | self.usart.as_ref().map_or(0, |usart| usart.interrupts.irq())
    }

    fn is_enabled(&self) -> bool {
        self.ctrla & ENABLE != 0
    }

    /// A bit of a register flips: see [`upset`](crate::upset).
    pub(crate) fn flip(&mut self, offset: u32, bit: u32) -> bool {
        let mask = 1 << bit;
        match offset {
            0x00 if mask & (CTRLA_MODELLED & !MODE | ENABLE) != 0 => self.ctrla ^= mask,
            0x0C => self.baud ^= mask,
            0x14 => return self.interrupts.flip(mask),
            0x24 if bit < 8 => self.address ^= mask as u8,
            _ => return false,
        }
        true
    }

    pub(crate) fn read(&mut self, now: Ticks, offset: u32, board: &dyn Board) -> Read {
        if let (Some(usart), 0x04..0x1C | 0x20..) = (&mut self.usart, offset) {
            return usart.read(offset);
        }
        Ok(match offset {
            0x00 => self.ctrla | u32::from(self.sync.is_busy(now, busy::SWRST)),
            0x04 => self.ctrlb,
            0x0C => self.baud,
            0x14 => self.interrupts.enabled * 0x0001_0001,
            0x18 => {
                self.observe(now, board);
                let hold = if self.held.is_some() { CLKHOLD } else { 0 };
                let status = self.status | hold | (self.state as u16) << 4;
                self.interrupts.flags | u32::from(status) << 16
            }
            0x1C => self.sync.bits(now),
            0x24 => u32::from(self.address),
            0x28 => u32::from(self.data),
            0x30 => u32::from(self.debug),
            _ => return Err(RESERVED),
        })
    }

    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        if let (Some(usart), 0x04..) = (&mut self.usart, offset) {
            let enabled = self.ctrla & ENABLE != 0;
            usart.write(bus.now, offset, lanes, (enabled, self.clock))?;
            self.due = usart.next();
            return DONE;
        }
        match offset {
            0x00 => return self.write_ctrla(bus, lanes.merge(self.ctrla)),
            0x04 => return self.write_ctrlb(bus, lanes.merge(self.ctrlb)),
            0x0C => {
                if self.is_enabled() {
                    self.note(bus, "enable-protected BAUD written while enabled: discarded");
                } else {
                    self.baud = lanes.merge(self.baud);
                }
            }
            0x14 => {
                self.interrupts.disable(lanes.bits() & 0xFF);
                self.interrupts.enable(lanes.bits() >> 16);
            }
            0x18 => {
                self.interrupts.flags &= !(lanes.bits() & 0xFF);
                if let Some(status) = lanes.half(1, 0) {
                    self.write_status(bus, status);
                }
            }
            0x1C => {}
            0x24 => {
                let value = lanes.merge(0);
                if value & !0xFF != 0 {
                    return Err(Refusal::Unmodelled("ADDR beyond a 7-bit address"));
                }
                if self.synchronise(bus) {
                    self.write_address(bus, value as u8);
                }
            }
            0x28 => {
                if self.synchronise(bus) {
                    self.write_data(bus, lanes.merge(0) as u8);
                }
            }
            0x30 => self.debug = lanes.merge(0) as u8 & 1,
            _ => return Err(RESERVED),
        }
        DONE
    }

    fn write_ctrla(&mut self, bus: &mut Bus<'_>, value: u32) -> Write {
        if value & SWRST != 0 {
            self.tell_cut(bus);
            let fresh = Self::new(self.index, Ticks::ZERO);
            *self = Self {
                clock: self.clock,
                slow_clock: self.slow_clock,
                connected: self.connected,
                sync: self.sync.clone(),
                ..fresh
            };
            self.sync.begin(bus.now, busy::SWRST);
            return DONE;
        }
        let mode = value & MODE;
        let modelled =
            if mode == MODE_USART { MODE | usart::CTRLA_MODELLED } else { CTRLA_MODELLED };
        if value & !(ENABLE | modelled) != 0 {
            return Err(Refusal::Unmodelled("this bit of CTRLA"));
        }
        if ![MODE_I2C_MASTER, MODE_USART].contains(&mode) && (mode != 0 || value & ENABLE != 0) {
            return Err(Refusal::Unmodelled("any mode but I2C master and USART"));
        }
        bus.write_ctrla(self.name(), &mut self.ctrla, value, modelled);
        if self.ctrla & MODE == MODE_USART {
            let interrupts = || Box::new(Usart::new(Interrupts::of(Block::Sercom(self.index))));
            self.usart.get_or_insert_with(interrupts);
        } else {
            self.usart = None;
        }
        if (self.ctrla ^ value) & ENABLE != 0 {
            if self.sync.is_busy(bus.now, busy::ENABLE) {
                self.note(bus, "ENABLE written while it synchronises: discarded");
                return DONE;
            }
            self.sync.begin(bus.now, busy::ENABLE);
            self.ctrla ^= ENABLE;
            match &mut self.usart {
                Some(usart) => {
                    usart.enable(bus.now, self.ctrla & ENABLE != 0, self.clock);
                    self.due = usart.next();
                }
                None => self.release_lines(bus),
            }
        }
        DONE
    }

    fn write_ctrlb(&mut self, bus: &mut Bus<'_>, value: u32) -> Write {
        if value & !(ACKACT | 3 << 16) != 0 {
            return Err(Refusal::Unmodelled("this bit of CTRLB"));
        }
        self.ctrlb = value & ACKACT;
        let command = value >> 16 & 3;
        if command != 0 && self.synchronise(bus) {
            self.command(bus, command);
        }
        DONE
    }

    fn write_status(&mut self, bus: &mut Bus<'_>, value: u16) {
        self.status &= !(value & (BUSERR | ARBLOST | LOWTOUT));
        if value >> 4 & 3 == 0 || !self.synchronise(bus) {
            return;
        }
        if value >> 4 & 3 == BusState::Idle as u16 && self.state == BusState::Unknown {
            self.state = BusState::Idle;
        } else {
            self.note(bus, "BUSSTATE only goes from UNKNOWN to IDLE: ignored");
        }
    }

    /// Starts the synchronisation of a system operation; false, and noted, if the write comes while
    /// one is going on or the master is off: then it is discarded.
    fn synchronise(&mut self, bus: &mut Bus<'_>) -> bool {
        if !self.is_enabled() {
            self.note(bus, "a bus operation while disabled: ignored");
            return false;
        }
        if self.sync.is_busy(bus.now, busy::SYSOP) {
            self.note(bus, "a bus operation while SYSOP synchronises: discarded");
            return false;
        }
        self.sync.begin(bus.now, busy::SYSOP);
        true
    }

    fn name(&self) -> &'static str {
        entry(Block::Sercom(self.index)).name
    }

    fn note(&self, bus: &mut Bus<'_>, what: &'static str) {
        bus.note(self.name(), what);
    }
}
