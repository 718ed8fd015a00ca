//! Which interrupts are enabled, with which priorities: see the [table](super).

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
