//! What ends the main loop's sleep: an interrupt that has left it something to do.
//!
//! Most interrupts leave nothing: of a burst's 23, one does. The core goes back to sleep behind the
//! others without the loop (SLEEPONEXIT).

use core::sync::atomic::{AtomicBool, Ordering};

use atsamd_hal::pac::SCB;
use critical_section::CriticalSection;

/// Bit of SCR (ARMv6-M Architecture Reference Manual, B3.2.7): the core sleeps behind an interrupt
/// that has interrupted the main loop.
const SLEEPONEXIT: u32 = 1 << 1;

/// The loop has something to do.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Have the main loop look round.
pub(crate) fn request() {
    REQUESTED.store(true, Ordering::Relaxed);
    sleep_on_exit(0);
}

/// Sleep until an interrupt [asks](request), unless one has asked already.
///
/// Interrupts are not held off in sleep, as WFI would need it: a wrong jump from there into a loop
/// that waits could never end. An interrupt that has come back with all held off, by a bit that has
/// flipped in its code, ends the sleep too; the loop then has them go on.
pub(crate) fn sleep() {
    cortex_m::interrupt::disable();
    if !REQUESTED.load(Ordering::Relaxed) {
        sleep_on_exit(SLEEPONEXIT);
    }
    loop {
        // SAFETY: as before it. Nobody calls this from within a critical section.
        unsafe { cortex_m::interrupt::enable() };
        if REQUESTED.load(Ordering::Relaxed) {
            break;
        }
        // An interrupt that asks in front of WFE is an event, with which WFE does not sleep
        // (ARMv6-M Architecture Reference Manual, B1.5.18).
        cortex_m::asm::wfe();
    }
    REQUESTED.store(false, Ordering::Relaxed);
}

fn sleep_on_exit(bits: u32) {
    // SAFETY: a write of a register that nobody reads; it has no other bit in use.
    unsafe { (*SCB::PTR).scr.write(bits) };
}

/// Whether it has been asked to since it was last told so.
pub(crate) fn take(_held: CriticalSection) -> bool {
    // A plain load and store are enough while interrupts are held off, and all that the core has.
    let requested = REQUESTED.load(Ordering::Relaxed);
    if requested {
        REQUESTED.store(false, Ordering::Relaxed);
    }
    requested
}
