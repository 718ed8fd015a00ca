//! What ends the main loop's sleep: an interrupt that has left it something to do.
//!
//! Most interrupts leave nothing: of a burst's 23, one does. The others are over before the loop
//! has looked at more than a flag.

use core::sync::atomic::{AtomicBool, Ordering};

use critical_section::CriticalSection;

/// The loop has something to do.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Have the main loop look round.
pub(crate) fn request() {
    REQUESTED.store(true, Ordering::Relaxed);
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
