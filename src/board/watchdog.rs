//! The watchdog and its guard, which alone may feed it.
//!
//! The watchdog runs from its own 1,024 Hz oscillator and resets the chip after [`TIMEOUT`]. Half
//! way there it interrupts, and the servo is sent to neutral: a hung program would otherwise hold
//! the last rudder angle, and the bootloader then leaves the servo without pulses for half a
//! second.
//!
//! Clearing it takes some 5 ms to reach its slow clock, and a second clear in that time would stall
//! the whole chip until the first has arrived. So it is fed no more often than [`Work`] allows, and
//! only when nothing is on its way.

use core::sync::atomic::{AtomicBool, Ordering};

use atsamd_hal::pac;
use atsamd_hal::pac::interrupt;
use bno055_driver::Micros;
use tvc_nano::watchdog::Work;

use super::time::{now, within};
use super::{frame, stack};

/// 128 cycles of 1,024 Hz: 125 ms.
const TIMEOUT: pac::wdt::config::Perselect = pac::wdt::config::Perselect::_128;
/// 64 cycles: 62.5 ms.
const EARLY_WARNING: pac::wdt::ewctrl::Ewoffsetselect = pac::wdt::ewctrl::Ewoffsetselect::_64;
/// Writes to the watchdog at start-up wait so long for the one before: three times what it takes.
const SYNC_LIMIT_US: u64 = 15_000;
/// The key that clears it. Any other value resets the chip.
const CLEAR_KEY: u8 = 0xA5;

/// The early warning has come, and the watchdog has not been fed since.
static WARNED: AtomicBool = AtomicBool::new(false);

/// Feeds the watchdog as long as the loop does its work.
pub(super) struct WatchdogGuard {
    watchdog: pac::Wdt,
    pub(super) work: Work,
}

impl WatchdogGuard {
    /// Start the watchdog.
    pub(super) fn start(watchdog: pac::Wdt) -> Self {
        let guard = Self {
            watchdog,
            work: Work::new(now()),
        };
        guard.settle();
        guard.watchdog.config().write(|w| w.per().variant(TIMEOUT));
        guard.settle();
        guard
            .watchdog
            .ewctrl()
            .write(|w| w.ewoffset().variant(EARLY_WARNING));
        guard.settle();
        guard.watchdog.intenset().write(|w| w.ew().set_bit());
        guard.watchdog.ctrl().write(|w| w.enable().set_bit());
        guard
    }

    /// Feed the watchdog if the loop has done its work, and the stack has not grown into the
    /// statics.
    pub(super) fn check(&mut self, now: Micros) {
        if self.work.is_done(now) && !self.is_synchronising() {
            stack::check();
            self.feed();
            self.work.fed(now);
            WARNED.store(false, Ordering::Relaxed);
        }
    }

    /// Feed the watchdog of a vehicle that does nothing but wait, with its servos at neutral.
    pub(super) fn hold_off(&self) {
        if !self.is_synchronising() {
            self.feed();
        }
    }

    fn feed(&self) {
        // SAFETY: the one key that clears.
        self.watchdog
            .clear()
            .write(|w| unsafe { w.bits(CLEAR_KEY) });
    }

    /// Whether it runs with the times that it was given.
    pub(super) fn is_as_set(&self) -> bool {
        let control = self.watchdog.ctrl().read();
        let config = self.watchdog.config().read();
        self.is_synchronising()
            || control.enable().bit_is_set()
                && control.wen().bit_is_clear()
                && config.per().variant() == Some(TIMEOUT)
                && self.watchdog.ewctrl().read().ewoffset().variant() == Some(EARLY_WARNING)
                && self.watchdog.intenset().read().ew().bit_is_set()
    }

    fn is_synchronising(&self) -> bool {
        self.watchdog.status().read().syncbusy().bit_is_set()
    }

    /// Wait for the write before, for a bounded time; the feeding looks at the flag again.
    fn settle(&self) {
        let _ = within(SYNC_LIMIT_US, || !self.is_synchronising());
    }
}

/// Whether the chip is about to be reset: the servo is to stay at neutral then, whatever a loop
/// that goes on asks for.
pub(super) fn has_warned() -> bool {
    WARNED.load(Ordering::Relaxed)
}

/// Whether the watchdog is running.
pub(super) fn is_running() -> bool {
    // SAFETY: a read of a register that is always mapped.
    unsafe { &*pac::Wdt::ptr() }
        .ctrl()
        .read()
        .enable()
        .bit_is_set()
}

#[interrupt]
fn WDT() {
    // SAFETY: clears the flag of this very interrupt.
    unsafe { &*pac::Wdt::ptr() }
        .intflag()
        .write(|w| w.ew().set_bit());
    WARNED.store(true, Ordering::Relaxed);
    frame::force_neutral();
}
