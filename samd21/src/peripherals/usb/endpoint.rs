//! Endpoints: registers, and what tokens from the host do to them.
//!
//! Bank 0 takes OUT and SETUP, bank 1 sends IN. A bank's descriptor in SRAM is ADDR (word 0) and
//! PCKSIZE (word 1): BYTE_COUNT 13:0, MULTI_PACKET_SIZE 27:14, SIZE 30:28, AUTO_ZLP 31.
//!
//! | token | accepted when | then |
//! |---|---|---|
//! | SETUP | RXSTP is 0, else no answer | 8 bytes to bank 0; RXSTP, BK0RDY, DTGLOUT, DTGLIN, CURBK set; BK1RDY, STALLRQ clear |
//! | OUT | BK0RDY is 0, else NAK and TRFAIL0 | bytes to bank 0; BK0RDY and TRCPT0; a wrong toggle is acknowledged and dropped |
//! | IN | BK1RDY is 1, else NAK and TRFAIL1 | bytes from bank 1; BK1RDY clear and TRCPT1 |
//! | OUT, IN | STALLRQ is set | STALL and its flag |
//!
//! With MULTI_PACKET_SIZE, OUT gathers packets until that many bytes or a short packet have come;
//! BYTE_COUNT above SIZE sends several IN packets while MULTI_PACKET_SIZE counts (D21-801). Behind
//! the last it is 0 again: drivers that never write it work on boards. SETUP: D21-798.

use super::{ENDPOINTS, RAMACER, Usb};
use crate::memory::Memory;
use crate::peripherals::access::{DONE, Lanes, RESERVED, Read, Refusal, Write};
use crate::peripherals::interrupts::Interrupts;

const DTGLOUT: u8 = 1 << 0;
const DTGLIN: u8 = 1 << 1;
const CURBK: u8 = 1 << 2;
const STALLRQ0: u8 = 1 << 4;
const STALLRQ1: u8 = 1 << 5;
const BK0RDY: u8 = 1 << 6;
const BK1RDY: u8 = 1 << 7;

const TRCPT0: u32 = 1 << 0;
const TRCPT1: u32 = 1 << 1;
const TRFAIL0: u32 = 1 << 2;
const TRFAIL1: u32 = 1 << 3;
const RXSTP: u32 = 1 << 4;
const STALL0: u32 = 1 << 5;
const STALL1: u32 = 1 << 6;

/// EPCFG: a type for each bank.
const EPCFG_BITS: u32 = 0x77;
const CONTROL: u8 = 1;
const BYTE_COUNT: u32 = 0x3FFF;
const AUTO_ZLP: u32 = 1 << 31;

/// Why the device does not take or give a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refused {
    Nak,
    Stall,
    /// No answer: no such device or endpoint, or it is not ready for a SETUP.
    Silence,
}

/// The device's answer; what it takes or gives is acknowledged.
pub(crate) type Answer<T = ()> = Result<T, Refused>;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Endpoint {
    config: u8,
    status: u8,
    interrupts: Interrupts<0x7F>,
}

impl Endpoint {
    pub(super) fn irq(&self) -> bool {
        self.interrupts.is_requested()
    }

    pub(super) fn bus_reset(&mut self, keeps_config: bool) {
        self.status &= !(STALLRQ0 | STALLRQ1);
        self.interrupts = Interrupts::default();
        if !keeps_config {
            self.configure(0);
        }
    }

    fn type_out(&self) -> u8 {
        self.config & 7
    }

    fn type_in(&self) -> u8 {
        self.config >> 4 & 7
    }

    fn configure(&mut self, config: u8) {
        self.config = config;
        if self.type_out() == 0 {
            self.status &= !DTGLOUT;
        }
        if self.type_in() == 0 {
            self.status &= !DTGLIN;
        }
        if config == 0 {
            self.interrupts.disable(u32::MAX);
        }
    }

    /// A bit of a register flips. A type that is not modelled is as none.
    pub(super) fn flip(&mut self, offset: u32, bit: u32) -> bool {
        match offset {
            0x00 if EPCFG_BITS >> bit & 1 != 0 => {
                let known = |kind| if kind == 2 || kind > 4 { 0 } else { kind };
                let config = self.config ^ 1 << bit;
                self.configure(known(config & 7) | known(config >> 4 & 7) << 4);
                true
            }
            0x08 => self.interrupts.flip(1 << bit),
            _ => false,
        }
    }

    pub(super) fn read(&self, offset: u32) -> Read {
        match offset {
            0x00 => Ok(u32::from(self.config)),
            0x04 => Ok(u32::from(self.status) << 16 | self.interrupts.flags << 24),
            0x08 => Ok(self.interrupts.enabled * 0x0101),
            _ => Err(RESERVED),
        }
    }

    pub(super) fn write(&mut self, offset: u32, lanes: Lanes) -> Write {
        match offset {
            0x00 => {
                if let Some(config) = lanes.byte(0) {
                    if [config & 7, config >> 4 & 7].iter().any(|&kind| kind == 2 || kind > 4) {
                        return Err(Refusal::Unmodelled("isochronous and dual-bank endpoints"));
                    }
                    self.configure(config & 0x77);
                }
            }
            0x04 => {
                self.status &= !lanes.byte(0).unwrap_or(0);
                self.status |= lanes.byte(1).unwrap_or(0) & 0xF7;
                self.interrupts.flags &= !(lanes.bits() >> 24);
            }
            0x08 => {
                self.interrupts.disable(lanes.bits() & 0xFF);
                if self.config != 0 {
                    self.interrupts.enable(lanes.bits() >> 8 & 0xFF);
                }
            }
            _ => return Err(RESERVED),
        }
        DONE
    }
}

/// A bank's descriptor in SRAM.
struct Bank {
    at: u32,
    address: u32,
    pcksize: u32,
}

impl Bank {
    fn byte_count(&self) -> u32 {
        self.pcksize & BYTE_COUNT
    }

    fn multi_packet_size(&self) -> u32 {
        self.pcksize >> 14 & BYTE_COUNT
    }

    fn size(&self) -> u32 {
        match self.pcksize >> 28 & 7 {
            7 => 1023,
            exponent => 8 << exponent,
        }
    }

    fn set_counts(&mut self, byte_count: u32, multi_packet_size: u32) {
        let rest = self.pcksize & 0xF000_0000;
        self.pcksize = rest | multi_packet_size << 14 | byte_count;
    }

    fn store(&self, memory: &mut Memory) -> Option<()> {
        memory.write_u32(self.at + 4, self.pcksize)
    }
}

impl Usb {
    /// Whether a token for this endpoint will be answered with NAK, so that the host can
    /// plan a short transaction. Direction is the host's.
    pub(crate) fn would_nak(&self, number: u8, is_in: bool) -> bool {
        let Some(endpoint) = self.endpoints.get(usize::from(number)) else { return false };
        if is_in {
            endpoint.type_in() != 0 && endpoint.status & (STALLRQ1 | BK1RDY) == 0
        } else {
            endpoint.type_out() != 0 && endpoint.status & (STALLRQ0 | BK0RDY) == BK0RDY
        }
    }

    /// Whether a token that is answered with NAK interrupts the processor.
    pub(crate) fn interrupts_at_nak(&self, number: u8) -> bool {
        let interrupts = &self.endpoints[usize::from(number)].interrupts;
        interrupts.enabled & (TRFAIL0 | TRFAIL1) != 0
    }

    /// A token that was answered with NAK.
    pub(crate) fn nak(&mut self, number: u8, is_in: bool) {
        self.endpoints[usize::from(number)].interrupts.flags |=
            if is_in { TRFAIL1 } else { TRFAIL0 };
    }

    fn is_addressed(&self, device: u8, number: u8) -> bool {
        let own = if self.address & 0x80 != 0 { self.address & 0x7F } else { 0 };
        self.is_attached() && device == own && usize::from(number) < ENDPOINTS
    }

    fn bank(&mut self, memory: &Memory, number: u8, bank: u32) -> Answer<Bank> {
        let at = self.descriptors.wrapping_add(u32::from(number) * 32 + bank * 16);
        let found = memory
            .read_u32(at)
            .zip(memory.read_u32(at.wrapping_add(4)))
            .map(|(address, pcksize)| Bank { at, address, pcksize });
        self.in_memory(found)
    }

    /// What is not there in memory is an error of the device, which then does not answer.
    fn in_memory<T>(&mut self, found: Option<T>) -> Answer<T> {
        if found.is_none() {
            self.interrupts.flags |= RAMACER;
        }
        found.ok_or(Refused::Silence)
    }

    /// SETUP with its eight bytes.
    pub(crate) fn setup(
        &mut self,
        device: u8,
        number: u8,
        bytes: [u8; 8],
        memory: &mut Memory,
    ) -> Answer {
        let index = usize::from(number);
        if !self.is_addressed(device, number)
            || self.endpoints[index].type_out() != CONTROL
            || self.endpoints[index].interrupts.flags & RXSTP != 0
        {
            return Err(Refused::Silence);
        }
        let mut bank = self.bank(memory, number, 0)?;
        let multi_packet_size = bank.multi_packet_size();
        bank.set_counts(8, multi_packet_size);
        self.deliver(memory, &bank, 0, &bytes)?;
        let endpoint = &mut self.endpoints[index];
        endpoint.status &= !(BK1RDY | STALLRQ0 | STALLRQ1);
        endpoint.status |= BK0RDY | DTGLOUT | DTGLIN | CURBK;
        endpoint.interrupts.flags |= RXSTP;
        Ok(())
    }

    /// OUT with its data packet, DATA1 if `toggle`.
    pub(crate) fn output(
        &mut self,
        device: u8,
        number: u8,
        toggle: bool,
        bytes: &[u8],
        memory: &mut Memory,
    ) -> Answer {
        let index = usize::from(number);
        if !self.is_addressed(device, number) || self.endpoints[index].type_out() == 0 {
            return Err(Refused::Silence);
        }
        let endpoint = &mut self.endpoints[index];
        if endpoint.status & STALLRQ0 != 0 {
            endpoint.interrupts.flags |= STALL0;
            return Err(Refused::Stall);
        }
        if endpoint.status & BK0RDY != 0 {
            self.nak(number, false);
            return Err(Refused::Nak);
        }
        if (endpoint.status & DTGLOUT != 0) != toggle {
            return Ok(());
        }
        let mut bank = self.bank(memory, number, 0)?;
        let length = bytes.len() as u32;
        self.in_memory((length <= bank.size()).then_some(()))?;
        let multi_packet_size = bank.multi_packet_size();
        let gathered = if multi_packet_size > 0 { bank.byte_count() } else { 0 };
        bank.set_counts(gathered + length, multi_packet_size);
        self.deliver(memory, &bank, gathered, bytes)?;
        let complete = length < bank.size() || gathered + length >= multi_packet_size;
        let endpoint = &mut self.endpoints[index];
        endpoint.status ^= DTGLOUT;
        if complete {
            endpoint.status |= BK0RDY;
            endpoint.interrupts.flags |= TRCPT0;
        }
        Ok(())
    }

    /// IN: the bytes, and whether they come as DATA1. Where the host's acknowledgement is lost, the
    /// next IN gives the same once more.
    pub(crate) fn input(
        &mut self,
        device: u8,
        number: u8,
        is_acknowledged: bool,
        memory: &mut Memory,
    ) -> Answer<(Vec<u8>, bool)> {
        let index = usize::from(number);
        if !self.is_addressed(device, number) || self.endpoints[index].type_in() == 0 {
            return Err(Refused::Silence);
        }
        let endpoint = &mut self.endpoints[index];
        if endpoint.status & STALLRQ1 != 0 {
            endpoint.interrupts.flags |= STALL1;
            return Err(Refused::Stall);
        }
        if endpoint.status & BK1RDY == 0 {
            self.nak(number, true);
            return Err(Refused::Nak);
        }
        let mut bank = self.bank(memory, number, 1)?;
        let (total, sent) = (bank.byte_count(), bank.multi_packet_size());
        let length = total.saturating_sub(sent).min(bank.size());
        let start = bank.address.wrapping_add(sent);
        let bytes = memory.bytes(start, length as usize).map(<[u8]>::to_vec);
        let bytes = self.in_memory(bytes)?;
        let toggle = self.endpoints[index].status & DTGLIN != 0;
        if !is_acknowledged {
            return Ok((bytes, toggle));
        }
        let sent = sent + length;
        let zero_packet = length == bank.size() && bank.pcksize & AUTO_ZLP != 0;
        let complete = sent >= total && !zero_packet;
        bank.set_counts(total, if complete { 0 } else { sent });
        self.in_memory(bank.store(memory))?;
        let endpoint = &mut self.endpoints[index];
        endpoint.status ^= DTGLIN;
        if complete {
            endpoint.status &= !BK1RDY;
            endpoint.interrupts.flags |= TRCPT1;
        }
        Ok((bytes, toggle))
    }

    /// Bytes and counts into SRAM.
    fn deliver(&mut self, memory: &mut Memory, bank: &Bank, start: u32, bytes: &[u8]) -> Answer {
        let done = memory
            .ram_bytes_mut(bank.address.wrapping_add(start), bytes.len())
            .map(|target| target.copy_from_slice(bytes))
            .and_then(|()| bank.store(memory));
        self.in_memory(done)
    }
}
