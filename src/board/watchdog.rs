//! The watchdog and the supervisor that alone may feed it.
//!
//! The watchdog runs from its own 1,024 Hz oscillator and resets the chip after [`TIMEOUT`]. Half way there it
//! interrupts, and the servo is sent to neutral: a hung program would otherwise hold the last rudder angle, and the
//! bootloader then leaves the servo without pulses for half a second.
//!
//! Clearing it takes some 5 ms to reach its slow clock, and a second clear in that time would stall the whole chip until
//! the first has arrived. So it is fed at most every [`FEED_PERIOD_US`], and only when nothing is on its way.

use atsamd_hal::pac;
use atsamd_hal::pac::interrupt;
use bno055_driver::Micros;

use super::time::{now, within};
use super::{servo, stack};

/// 128 cycles of 1,024 Hz: 125 ms.
const TIMEOUT: pac::wdt::config::Perselect = pac::wdt::config::Perselect::_128;
/// 64 cycles: 62.5 ms.
const EARLY_WARNING: pac::wdt::ewctrl::Ewoffsetselect = pac::wdt::ewctrl::Ewoffsetselect::_64;
/// A third of the early warning, and two steps.
const FEED_PERIOD_US: u64 = 20_000;
/// Writes to the watchdog at start-up wait so long for the one before: three times what it takes.
const SYNC_LIMIT_US: u64 = 15_000;
/// The key that clears it. Any other value resets the chip.
const CLEAR_KEY: u8 = 0xA5;

/// What must have happened since the last feed.
#[derive(Clone, Copy, Default)]
struct Seen {
    tick: bool,
    step: bool,
    pulse: bool,
}

/// Feeds the watchdog as long as the loop does its work.
pub(super) struct Supervisor {
    watchdog: pac::Wdt,
    seen: Seen,
    fed: Micros,
}

impl Supervisor {
    /// Start the watchdog.
    pub(super) fn start(watchdog: pac::Wdt) -> Self {
        let supervisor = Self {
            watchdog,
            seen: Seen::default(),
            fed: now(),
        };
        supervisor.settle();
        supervisor
            .watchdog
            .config()
            .write(|w| w.per().variant(TIMEOUT));
        supervisor.settle();
        supervisor
            .watchdog
            .ewctrl()
            .write(|w| w.ewoffset().variant(EARLY_WARNING));
        supervisor.settle();
        supervisor.watchdog.intenset().write(|w| w.ew().set_bit());
        supervisor.watchdog.ctrl().write(|w| w.enable().set_bit());
        supervisor
    }

    /// A tick has come.
    pub(super) fn tick_seen(&mut self) {
        self.seen.tick = true;
    }

    /// The flight has been stepped; `taken` says whether the servo timer took its pulse.
    pub(super) fn step_done(&mut self, taken: bool) {
        self.seen.step |= taken;
    }

    /// Whether the servo timer has nothing left in its buffer.
    pub(super) fn pulse_sent(&mut self, sent: bool) {
        self.seen.pulse |= sent && self.seen.step;
    }

    /// Feed the watchdog if the loop has ticked, stepped and had a pulse go out since the last time, and the stack has
    /// not grown into the statics.
    pub(super) fn check(&mut self, now: Micros) {
        let Seen { tick, step, pulse } = self.seen;
        if tick
            && step
            && pulse
            && now.since(self.fed) >= FEED_PERIOD_US
            && !self.is_synchronising()
        {
            stack::check();
            // SAFETY: the one key that clears.
            self.watchdog
                .clear()
                .write(|w| unsafe { w.bits(CLEAR_KEY) });
            self.seen = Seen::default();
            self.fed = now;
        }
    }

    fn is_synchronising(&self) -> bool {
        self.watchdog.status().read().syncbusy().bit_is_set()
    }

    /// Wait for the write before, for a bounded time; the feeding looks at the flag again.
    fn settle(&self) {
        let _ = within(SYNC_LIMIT_US, || !self.is_synchronising());
    }
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
    servo::force_neutral();
}
