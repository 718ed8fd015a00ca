//! A pin at register level: the sensor bus needs its lines as GPIO and as SERCOM in turn, where the
//! HAL's pins change their type with each.

use atsamd_hal::gpio::{DynAlternate, DynPinId, PinId};
use atsamd_hal::pac;
use tvc_nano::registers::{Register, Width};

/// PINCFG.PMUXEN: a peripheral has the pin.
const PERIPHERAL: u8 = 1 << 0;
/// PINCFG.INEN: its level can be read.
const INPUT: u8 = 1 << 1;
/// PINCFG.PULLEN.
const PULL: u8 = 1 << 2;

/// One pin of the chip.
#[derive(Clone, Copy)]
pub(crate) struct Pin(DynPinId);

impl Pin {
    /// The HAL's pin of this name.
    pub(crate) const fn of<Id: PinId>() -> Self {
        Self(Id::DYN)
    }

    /// Drive it high.
    pub(crate) fn high(self) {
        // SAFETY: set registers act on the bits written 1 only; every pin has one user.
        unsafe {
            port().outset(self.group()).write(|w| w.bits(self.mask()));
            port().dirset(self.group()).write(|w| w.bits(self.mask()));
        }
    }

    /// Drive it low.
    pub(crate) fn low(self) {
        // SAFETY: as in `high`.
        unsafe {
            port().outclr(self.group()).write(|w| w.bits(self.mask()));
            port().dirset(self.group()).write(|w| w.bits(self.mask()));
        }
    }

    /// Stop driving it: a line with a pull-up goes high.
    pub(crate) fn release(self) {
        // SAFETY: as in `high`.
        unsafe { port().dirclr(self.group()).write(|w| w.bits(self.mask())) };
    }

    /// Its level; needs the input buffer that [`gpio`](Self::gpio) and [`connect`](Self::connect)
    /// turn on.
    pub(crate) fn is_high(self) -> bool {
        port().in_(self.group()).read().bits() & self.mask() != 0
    }

    /// Make it a GPIO with its input buffer on; direction and level stay.
    pub(crate) fn gpio(self) {
        self.configure(INPUT);
    }

    /// Give it to a peripheral, its input buffer on.
    #[inline(never)]
    pub(crate) fn connect(self, function: DynAlternate) {
        let (at, shift) = self.multiplexer();
        let place = at as usize as *mut u8;
        // SAFETY: read-modify-write of a register that two pins share; only the main loop
        // configures pins.
        unsafe {
            let others = place.read_volatile() & !(0xF << shift);
            place.write_volatile(others | number(function) << shift);
        }
        self.configure(INPUT | PERIPHERAL);
    }

    /// Whether a peripheral has it.
    pub(crate) fn is_connected(self) -> bool {
        // SAFETY: reads a register that is always mapped.
        let config = unsafe { (self.settings().at as usize as *const u8).read_volatile() };
        config & PERIPHERAL != 0
    }

    /// Make it an input that a pull-down holds low, where it has not been driven high before.
    pub(crate) fn pull_down(self) {
        self.configure(INPUT | PULL);
    }

    /// Its function in its PMUX, as a row of the [table](super::registers).
    pub(crate) const fn function(self) -> Register {
        let (at, shift) = self.multiplexer();
        Register::new(at, Width::Byte).bits(0xF << shift)
    }

    /// Its PINCFG, as such a row.
    pub(crate) const fn settings(self) -> Register {
        Register::new(self.at(0x40 + self.0.num as u32), Width::Byte)
    }

    fn configure(self, config: u8) {
        // SAFETY: the register is this pin's own.
        unsafe { (self.settings().at as usize as *mut u8).write_volatile(config) };
    }

    /// Its PMUX, and where its function stands there.
    const fn multiplexer(self) -> (u32, u32) {
        let number = self.0.num as u32;
        (self.at(0x30 + number / 2), 4 * (number % 2))
    }

    /// The address of a register of its group.
    const fn at(self, offset: u32) -> u32 {
        const PORT: u32 = 0x4100_4400;
        const GROUP_BYTES: u32 = 0x80;
        PORT + self.group() as u32 * GROUP_BYTES + offset
    }

    const fn mask(self) -> u32 {
        1 << self.0.num
    }

    /// The number of its group, of which the compiler sees that it is one of two.
    const fn group(self) -> usize {
        self.0.group as usize % 2
    }
}

/// What PMUX holds for a peripheral's function (data sheet, table 7-1).
const fn number(function: DynAlternate) -> u8 {
    // A, which is not a peripheral's, is missing there.
    function as u8 + 1
}

fn port() -> &'static pac::port::RegisterBlock {
    // SAFETY: the block is always mapped.
    unsafe { &*pac::Port::ptr() }
}
