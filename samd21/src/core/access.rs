//! Fetches, loads and stores: alignment, who answers at an address, and flash wait states.
//!
//! | address | who answers |
//! |---|---|
//! | flash | loads and fetches here; stores go to NVMCTRL's page buffer |
//! | SRAM | here |
//! | 0xE000_E000, 4 KB | the system control space, words only |
//! | all else | the peripherals, at the time of the instruction |
//!
//! Flash wait states are counted as this chip's NVMCTRL makes them with its reset setting (CTRLB:
//! cache on, READMODE no miss penalty). A direct-mapped cache of 8 lines of 8 bytes serves fetches
//! and data loads alike. An access that hits costs nothing; an access that misses fills the line
//! and costs the wait states. The core's own prefetch is not modelled: only instructions that are
//! executed are fetched, a half-word each.

use super::{Core, FLASH_LINES, Outcome, Trap, parts};
use crate::board::Ticks;
use crate::bus::Bus;
use crate::fault::FaultKind;
use crate::memory::{RAM_BASE, RAM_SIZE};
use crate::peripherals::{BusError, Refusal, Width};

pub(super) type Ram = [u8; RAM_SIZE as usize];

impl Core {
    /// The half-word at `pc`.
    #[inline(always)]
    pub(super) fn fetch(&mut self, bus: &Bus<'_>, pc: u32) -> Outcome<u16> {
        if let Some(op) = read::<2, _>(bus.memory.flash(), pc) {
            self.wait_for_flash(pc);
            return Ok(op as u16);
        }
        read::<2, _>(bus.memory.ram(), pc.wrapping_sub(RAM_BASE))
            .map(|op| op as u16)
            .ok_or_else(|| Trap::Fault(FaultKind::UnmappedFetch { address: pc }).into())
    }

    /// Loads `N` (1, 2 or 4) bytes, zero-extended.
    #[inline(always)]
    pub(super) fn load<const N: usize>(&mut self, bus: &mut Bus<'_>, address: u32) -> Outcome<u32> {
        if !(address as usize).is_multiple_of(N) {
            return Err(unaligned_load(address, width::<N>()));
        }
        if let Some(word) = read::<N, _>(bus.memory.ram(), address.wrapping_sub(RAM_BASE)) {
            return Ok(word);
        }
        if let Some(word) = read::<N, _>(bus.memory.flash(), address) {
            self.wait_for_flash(address);
            return Ok(word);
        }
        self.load_device(bus, address, width::<N>())
    }

    /// Stores the low `N` (1, 2 or 4) bytes of `value`.
    #[inline(always)]
    pub(super) fn store<const N: usize>(
        &mut self,
        bus: &mut Bus<'_>,
        address: u32,
        value: u32,
    ) -> Outcome<()> {
        if !(address as usize).is_multiple_of(N) {
            return Err(unaligned_store(address, width::<N>()));
        }
        if write::<N>(bus.memory.ram_mut(), address.wrapping_sub(RAM_BASE), value) {
            return Ok(());
        }
        self.store_device(bus, address, width::<N>(), value)
    }

    /// Cycles of a single load or store: the IOBUS answers in one.
    #[inline(always)]
    pub(super) fn access_cycles(address: u32) -> u32 {
        if address >> 29 == 3 { 1 } else { 2 }
    }

    #[inline(always)]
    fn wait_for_flash(&mut self, address: u32) {
        if self.wait_states != 0 {
            let held = address / 8;
            let line = &mut self.flash_lines[held as usize % FLASH_LINES];
            if *line != held {
                *line = held;
                self.counters.flash_wait_cycles += self.wait_states;
                self.now += self.wait_states * self.cycle;
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn load_device(&mut self, bus: &mut Bus<'_>, address: u32, width: Width) -> Outcome<u32> {
        // Reading moves neither what is due next nor a line of an interrupt.
        if is_system_control(address) {
            return self.read_system_control(address, width);
        }
        let (value, stall) = bus
            .read(self.now(), address, width)
            .map_err(|error| refused(error, FaultKind::UnmappedLoad { address }))?;
        if stall > Ticks::ZERO {
            self.ask_attention();
            self.stall = parts(stall);
        }
        Ok(value)
    }

    #[cold]
    #[inline(never)]
    fn store_device(
        &mut self,
        bus: &mut Bus<'_>,
        address: u32,
        width: Width,
        value: u32,
    ) -> Outcome<()> {
        self.ask_attention();
        if is_system_control(address) {
            return self.write_system_control(address, width, value);
        }
        let stall = bus
            .write(self.now(), address, width, value)
            .map_err(|error| refused(error, FaultKind::UnmappedStore { address }))?;
        self.stall = parts(stall);
        Ok(())
    }
}

fn is_system_control(address: u32) -> bool {
    address >> 12 == 0xE_000E
}

const fn width<const N: usize>() -> Width {
    match N {
        1 => Width::Byte,
        2 => Width::Half,
        _ => Width::Word,
    }
}

/// Up to four bytes, zero-extended.
#[inline(always)]
pub(super) fn word(bytes: &[u8]) -> u32 {
    let mut word = [0; 4];
    word[..bytes.len()].copy_from_slice(bytes);
    u32::from_le_bytes(word)
}

/// `N` bytes at offset `at` of a memory, if they are aligned and lie in it.
#[inline(always)]
pub(super) fn read<const N: usize, const SIZE: usize>(memory: &[u8; SIZE], at: u32) -> Option<u32> {
    let at = at as usize;
    if !at.is_multiple_of(N) {
        return None;
    }
    memory.get(at..at + N).map(word)
}

/// Writes the low `N` bytes of `value` at offset `at` of the SRAM; whether that can be.
#[inline(always)]
pub(super) fn write<const N: usize>(ram: &mut Ram, at: u32, value: u32) -> bool {
    let at = at as usize;
    if !at.is_multiple_of(N) {
        return false;
    }
    let Some(bytes) = ram.get_mut(at..at + N) else {
        return false;
    };
    bytes.copy_from_slice(&value.to_le_bytes()[..N]);
    true
}

/// `count` words of SRAM at `address`, if they are aligned and lie in it.
#[inline(always)]
pub(super) fn block(ram: &mut Ram, address: u32, count: u8) -> Option<&mut [u8]> {
    let at = address.wrapping_sub(RAM_BASE) as usize;
    if !at.is_multiple_of(4) {
        return None;
    }
    ram.get_mut(at..at + 4 * usize::from(count))
}

/// Where nothing answers, or an exception does, the core takes a HardFault; anything else is a
/// limit of the models.
fn refused(error: BusError, unmapped: FaultKind) -> Box<Trap> {
    match error.refusal {
        Refusal::Unmapped => Trap::Fault(unmapped).into(),
        Refusal::Protected | Refusal::Exception(_) => {
            Trap::Fault(FaultKind::Peripheral(error)).into()
        }
        _ => Trap::Unmodelled(FaultKind::Peripheral(error)).into(),
    }
}

#[cold]
fn unaligned_load(address: u32, width: Width) -> Box<Trap> {
    Trap::Fault(FaultKind::UnalignedLoad { address, width }).into()
}

#[cold]
fn unaligned_store(address: u32, width: Width) -> Box<Trap> {
    Trap::Fault(FaultKind::UnalignedStore { address, width }).into()
}
