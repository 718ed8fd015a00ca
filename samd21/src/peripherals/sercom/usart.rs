//! A SERCOM as USART (MODE 1), 16 samples for a bit and arithmetic baud rates.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRLA | SWRST, ENABLE, MODE; pads and order are stored |
//! | 04 | CTRLB | TXEN, RXEN, SBMODE |
//! | 0C | BAUD | a bit takes 16 / (1 - BAUD / 65,536) cycles of the generic clock |
//! | 14, 16, 18 | INTENCLR, INTENSET, INTFLAG | DRE, TXC, RXC |
//! | 1A | STATUS | BUFOVF |
//! | 28 | DATA | a write sends, behind the byte under way; a read takes what has come |
//!
//! What is sent goes to [`Board::serial`], and what comes in is asked of [`Board::serial_input`],
//! whatever the pads. Left out: other sample rates, parity, nine bits, break, flow control.
//!
//! [`Board::serial`]: crate::board::Board::serial
//! [`Board::serial_input`]: crate::board::Board::serial_input

use super::super::access::{Bus, Lanes, RESERVED, Read, Refusal};
use super::super::clock::Rate;
use super::super::interrupts::Interrupts;
use crate::board::Ticks;

/// CTRLA: RUNSTDBY, IBON, TXPO, RXPO, DORD.
pub(super) const CTRLA_MODELLED: u32 = 1 << 7 | 1 << 8 | 3 << 16 | 3 << 20 | 1 << 30;
const SBMODE: u32 = 1 << 6;
const TXEN: u32 = 1 << 16;
const RXEN: u32 = 1 << 17;

const DRE: u32 = 1 << 0;
const TXC: u32 = 1 << 1;
const RXC: u32 = 1 << 2;
const BUFOVF: u32 = 1 << 2;

#[derive(Clone, Debug)]
pub(super) struct Usart {
    ctrlb: u32,
    baud: u32,
    pub(super) interrupts: Interrupts<{ DRE | TXC | RXC }>,
    status: u32,
    received: u8,
    /// The byte that is sent, and the next one.
    sending: Option<u8>,
    buffer: Option<u8>,
    sent_at: Ticks,
    comes_at: Ticks,
}

impl Usart {
    pub(super) fn new(interrupts: Interrupts<{ DRE | TXC | RXC }>) -> Self {
        Self {
            ctrlb: 0,
            baud: 0,
            interrupts,
            status: 0,
            received: 0,
            sending: None,
            buffer: None,
            sent_at: Ticks::NEVER,
            comes_at: Ticks::NEVER,
        }
    }

    pub(super) fn next(&self) -> Ticks {
        self.sent_at.min(self.comes_at)
    }

    /// What ENABLE and CTRLB begin or end.
    fn begin(&mut self, now: Ticks, enabled: bool, clock: Option<Rate>) {
        if enabled && self.ctrlb & TXEN != 0 && self.buffer.is_none() {
            self.interrupts.flags |= DRE;
        }
        self.comes_at = match enabled && self.ctrlb & RXEN != 0 {
            true => self.comes_at.min(self.after_a_byte(now, clock)),
            false => Ticks::NEVER,
        };
    }

    /// ENABLE has changed.
    pub(super) fn enable(&mut self, now: Ticks, enabled: bool, clock: Option<Rate>) {
        if !enabled {
            *self = Self { ctrlb: self.ctrlb, baud: self.baud, ..Self::new(self.interrupts) };
            self.interrupts.flags = 0;
        }
        self.begin(now, enabled, clock);
    }

    /// When a byte that begins now has ended: start, eight bits, one stop or two.
    fn after_a_byte(&self, now: Ticks, clock: Option<Rate>) -> Ticks {
        let bits = if self.ctrlb & SBMODE == 0 { 10 } else { 11 };
        let cycles = ((bits * 16_u64) << 16).div_ceil(0x1_0000 - u64::from(self.baud));
        clock.map_or(Ticks::NEVER, |clock| now + clock.duration(cycles))
    }

    pub(super) fn advance(&mut self, bus: &mut Bus<'_>, sercom: usize, clock: Option<Rate>) {
        if self.sent_at <= bus.now {
            if let Some(byte) = self.sending.take() {
                bus.board.serial(bus.now, sercom, byte);
            }
            self.sending = self.buffer.take();
            let (flag, at) = match self.sending {
                Some(_) => (DRE, self.after_a_byte(bus.now, clock)),
                None => (TXC, Ticks::NEVER),
            };
            self.interrupts.flags |= flag;
            self.sent_at = at;
        }
        if self.comes_at <= bus.now {
            if let Some(byte) = bus.board.serial_input(bus.now, sercom) {
                if self.interrupts.flags & RXC != 0 {
                    self.status |= BUFOVF;
                } else {
                    (self.received, self.interrupts.flags) = (byte, self.interrupts.flags | RXC);
                }
            }
            self.comes_at = self.after_a_byte(bus.now, clock);
        }
    }

    pub(super) fn read(&mut self, offset: u32) -> Read {
        Ok(match offset {
            0x04 => self.ctrlb,
            0x0C => self.baud,
            0x14 => self.interrupts.enabled * 0x0001_0001,
            0x18 => self.interrupts.flags | self.status << 16,
            0x28 => {
                self.interrupts.flags &= !RXC;
                self.received.into()
            }
            _ => return Err(RESERVED),
        })
    }

    pub(super) fn write(
        &mut self,
        now: Ticks,
        offset: u32,
        lanes: Lanes,
        (enabled, clock): (bool, Option<Rate>),
    ) -> Result<(), Refusal> {
        match offset {
            0x04 => {
                let value = lanes.merge(self.ctrlb);
                if value & !(SBMODE | TXEN | RXEN) != 0 {
                    return Err(Refusal::Unmodelled("this bit of CTRLB"));
                }
                self.ctrlb = value;
                self.begin(now, enabled, clock);
            }
            0x0C => self.baud = lanes.merge(self.baud) & 0xFFFF,
            0x14 => {
                self.interrupts.disable(lanes.bits() & 0xFF);
                self.interrupts.enable(lanes.bits() >> 16);
            }
            0x18 => {
                self.interrupts.flags &= !(lanes.bits() & (TXC | RXC));
                self.status &= !(lanes.bits() >> 16);
            }
            0x1C => {}
            0x28 if enabled && self.ctrlb & TXEN != 0 => {
                let byte = lanes.merge(0) as u8;
                self.interrupts.flags &= !TXC;
                if self.sending.is_none() {
                    self.sending = Some(byte);
                    self.sent_at = self.after_a_byte(now, clock);
                } else {
                    self.buffer = Some(byte);
                    self.interrupts.flags &= !DRE;
                }
            }
            0x28 => {}
            _ => return Err(RESERVED),
        }
        Ok(())
    }
}
