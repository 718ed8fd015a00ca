//! Which interrupts are enabled, with which priorities: see the [table](super).

use atsamd_hal::pac::Interrupt;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::{NVIC, SCB};
use critical_section::CriticalSection;

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

/// What the interrupts of the tick and of the sensor's bus share with the main loop. They alone are
/// held off: SysTick and the watchdog still end a program that hangs in `action`. Its token is for
/// what these interrupts share, and for nothing of SysTick's.
pub(crate) fn hold_ticks<R>(action: impl FnOnce(CriticalSection<'_>) -> R) -> R {
    let held = hold();
    // SAFETY: the token stands for what these interrupts share, which those above leave alone.
    // Enabled again are those that were.
    unsafe {
        let result = action(CriticalSection::new());
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
