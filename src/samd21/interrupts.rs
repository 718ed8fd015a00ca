//! Which interrupts are enabled, with which priorities: see the [table](super).

use core::cell::UnsafeCell;
use core::marker::PhantomData;

use atsamd_hal::pac::Interrupt;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::{NVIC, SCB};

use super::i2c;

/// A line of the NVIC.
#[derive(Clone, Copy)]
struct Line(u16);

// SAFETY: those of the PAC, or of a SERCOM that the chip has.
unsafe impl InterruptNumber for Line {
    fn number(self) -> u16 {
        self.0
    }
}

/// Enable all, at start-up.
pub(crate) fn start(scb: &mut SCB) {
    // SAFETY: set once, before any of them is enabled; critical sections mask all alike.
    unsafe { scb.set_priority(SystemHandler::SysTick, priority(0)) };
    enable::<{ Interrupt::TCC0 as u16 }>(1);
    enable::<{ i2c::INTERRUPT }>(1);
    enable::<{ Interrupt::WDT as u16 }>(0);
    enable::<{ Interrupt::USB as u16 }>(3);
}

/// Shows that the interrupts of the tick and of the sensor's bus are held off. They have one
/// priority, so neither interrupts the other.
#[derive(Clone, Copy)]
pub(crate) struct TicksHeld<'a>(PhantomData<&'a ()>);

impl TicksHeld<'_> {
    /// # Safety
    /// The caller is one of these interrupts, or holds both off.
    pub(crate) unsafe fn new() -> Self {
        Self(PhantomData)
    }
}

/// What these interrupts share with the main loop: a `Cell` or a `RefCell`.
pub(crate) struct Shared<T>(UnsafeCell<T>);

// SAFETY: only who holds the interrupts off reaches the content.
unsafe impl<T: Send> Sync for Shared<T> {}

impl<T> Shared<T> {
    pub(crate) const fn new(content: T) -> Self {
        Self(UnsafeCell::new(content))
    }

    pub(crate) fn borrow<'a>(&'a self, _: TicksHeld<'a>) -> &'a T {
        // SAFETY: nothing makes an exclusive reference.
        unsafe { &*self.0.get() }
    }
}

/// Holds off the interrupts of the tick and of the sensor's bus alone: SysTick and the watchdog
/// still end a program that hangs in `action`.
pub(crate) fn hold_ticks<R>(action: impl FnOnce(TicksHeld<'_>) -> R) -> R {
    let held = hold();
    // SAFETY: both are held off until `action` ends. Enabled again are those that were.
    unsafe {
        let result = action(TicksHeld::new());
        (*NVIC::PTR).iser[0].write(held);
        result
    }
}

/// Disables the lines of both; gives those that were enabled.
#[inline(never)]
fn hold() -> u32 {
    const LINES: u32 = 1 << Interrupt::TCC0 as u16 | 1 << i2c::INTERRUPT;
    // SAFETY: the barriers have the core take none of them from here on (ARMv6-M Architecture
    // Reference Manual, B3.4.4).
    let held = unsafe {
        let held = (*NVIC::PTR).iser[0].read() & LINES;
        (*NVIC::PTR).icer[0].write(held);
        held
    };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    held
}

fn enable<const NUMBER: u16>(level: u8) {
    let line = Line(NUMBER);
    // SAFETY: nobody else sets priorities, and critical sections mask all interrupts alike.
    unsafe {
        let mut nvic = cortex_m::Peripherals::steal().NVIC;
        nvic.set_priority(line, priority(level));
        NVIC::unmask(line);
    }
}

/// Of four levels, in the upper two bits.
const fn priority(level: u8) -> u8 {
    level << 6
}
