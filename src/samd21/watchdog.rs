//! The watchdog and its guard, which alone may feed it.
//!
//! The watchdog runs from its own 1,024 Hz oscillator and resets the chip after [`TIMEOUT`]. Half
//! way there it interrupts, and the servo is sent to neutral: a hung program would otherwise hold
//! the last rudder angle, and the bootloader then leaves the servo without pulses for half a
//! second. A program that does not feed it within [`GRACE_MS`] of that is reset by
//! [`crash::stop_hanging`], between two pulses, where the watchdog itself would cut one. SysTick
//! counts beside the watchdog and does the same.
//!
//! Clearing it takes some 5 ms to reach its slow clock, and a second clear in that time would stall
//! the whole chip until the first has arrived. So it is fed no more often than [`Work`] allows, and
//! only when nothing is on its way.

use core::sync::atomic::{AtomicU8, Ordering};

use atsamd_hal::pac;
use atsamd_hal::pac::interrupt;
use tvc_imu::Micros;
use tvc_nano::watchdog::Work;

use super::registers::restore_clocks;
use super::time::{delay_us, now, within};
use super::{crash, frame, stack};

/// 128 cycles of 1,024 Hz: 125 ms.
const TIMEOUT: pac::wdt::config::Perselect = pac::wdt::config::Perselect::_128;
/// 64 cycles: 62.5 ms.
const EARLY_WARNING: pac::wdt::ewctrl::Ewoffsetselect = pac::wdt::ewctrl::Ewoffsetselect::_64;
/// Writes to the watchdog at start-up wait so long for the one before: three times what it takes.
const SYNC_LIMIT_US: u64 = 15_000;
/// Longest time for which the window is closed: 8 cycles of an oscillator that is 13 % slow.
const CLOSED_US: u32 = 9_500;
/// The key that clears it. Any other value resets the chip.
pub(super) const CLEAR_KEY: u8 = 0xA5;

/// Interrupts of SysTick from the early warning to a reset. The watchdog itself takes 45 where its
/// oscillator is 40 % fast, and some 5 until it has been held off.
const GRACE_MS: u8 = 15;

/// Interrupts of SysTick from a feed to the warning of its own: the watchdog may be off.
const PATIENCE_MS: u8 = 65;

/// Interrupts of SysTick until a reset, unless the watchdog is fed; 0 before it is fed first. The
/// last [`GRACE_MS`] and one follow a warning.
static LEFT_MS: AtomicU8 = AtomicU8::new(0);

/// Feeds the watchdog as long as the loop does its work.
pub(crate) struct WatchdogGuard {
    watchdog: pac::Wdt,
    pub(crate) work: Work,
}

impl WatchdogGuard {
    /// Start the watchdog.
    pub(crate) fn start(watchdog: pac::Wdt) -> Self {
        let guard = Self { watchdog, work: Work::new(now()) };
        guard.settle();
        // In window mode it is closed for 8 ms.
        guard.watchdog.config().write(|w| w.per().variant(TIMEOUT).window()._8());
        guard.settle();
        guard.watchdog.ewctrl().write(|w| w.ewoffset().variant(EARLY_WARNING));
        guard.settle();
        guard.watchdog.intenset().write(|w| w.ew().set_bit());
        guard.watchdog.ctrl().write(|w| w.enable().set_bit());
        guard
    }

    /// Feed the watchdog if the loop has done its work, and the stack has not grown into the
    /// statics.
    pub(crate) fn check(&mut self, now: Micros) {
        if self.work.is_done(now) && !self.is_synchronising() && !is_windowed() {
            stack::check();
            feed(&self.watchdog);
            self.work.fed(now);
            frame::forget_begin();
            crash::has_started();
            LEFT_MS.store(PATIENCE_MS + GRACE_MS, Ordering::Relaxed);
        }
    }

    fn is_synchronising(&self) -> bool {
        self.watchdog.status().read().syncbusy().bit_is_set()
    }

    /// Wait for the write before, for a bounded time; the feeding looks at the flag again.
    pub(crate) fn settle(&self) {
        let _ = within(SYNC_LIMIT_US, || !self.is_synchronising());
    }
}

/// Whether the chip is about to be reset: the servo is to stay at neutral then, whatever a loop
/// that goes on asks for.
pub(crate) fn has_warned() -> bool {
    (1..=GRACE_MS + 1).contains(&LEFT_MS.load(Ordering::Relaxed))
}

/// A millisecond has gone by. Ends a program that hangs.
pub(crate) fn tick() {
    const WARNED: u8 = GRACE_MS + 1;
    let left = LEFT_MS.load(Ordering::Relaxed);
    match left {
        1 => crash::stop_hanging(),
        WARNED => warn(),
        _ => {}
    }
    LEFT_MS.store(left.saturating_sub(1), Ordering::Relaxed);
}

/// Whether the watchdog is running.
pub(crate) fn is_running() -> bool {
    registers().ctrl().read().enable().bit_is_set()
}

/// Feed the watchdog of a vehicle that does nothing but wait, with its servos at neutral.
pub(crate) fn hold_off() {
    let watchdog = registers();
    if is_windowed() {
        delay_us(CLOSED_US);
    }
    if watchdog.status().read().syncbusy().bit_is_clear() {
        feed(watchdog);
    }
}

fn feed(watchdog: &pac::wdt::RegisterBlock) {
    // SAFETY: the one key that clears.
    watchdog.clear().write(|w| unsafe { w.bits(CLEAR_KEY) });
}

/// Whether a flipped bit has turned window mode on, in which an early feed resets.
fn is_windowed() -> bool {
    registers().ctrl().read().wen().bit_is_set()
}

fn registers() -> &'static pac::wdt::RegisterBlock {
    // SAFETY: the block is always mapped. Feeding and the interrupt's flag are all that is written
    // to beside the guard.
    unsafe { &*pac::Wdt::ptr() }
}

#[interrupt]
fn WDT() {
    registers().intflag().write(|w| w.ew().set_bit());
    // An interrupt that comes again and again is not to put the end off.
    if !has_warned() {
        LEFT_MS.store(GRACE_MS + 1, Ordering::Relaxed);
    }
    warn();
}

fn warn() {
    // A clock that is divided otherwise makes the program late and its pulses long, or the watchdog
    // early.
    restore_clocks();
    frame::force_neutral();
}
