//! How deep the stack has been.
//!
//! The stack grows down towards the statics, and nothing in this core stops it there. So the free
//! RAM is painted at start-up, and the watchdog's guard looks at its lowest words before it feeds
//! the watchdog. A stack that has reached them ends in a reset with a reason, within 20 ms, and
//! cannot change statics unnoticed. The paint also shows a debugger, or the emulated chip's owner,
//! the deepest point so far.

use core::ptr::addr_of_mut;

use tvc_nano::SelfCheck;
use tvc_nano::bringup::words::STACK_PAINT;

use super::crash;

/// Words looked at.
const GUARD_WORDS: usize = 8;
/// Bytes just below the stack pointer that are left alone while painting.
const MARGIN: usize = 64;

unsafe extern "C" {
    /// First word above the statics.
    static mut _stack_end: u32;
}

/// Paint what the stack has not used yet.
pub(crate) fn paint() {
    let mut word = addr_of_mut!(_stack_end);
    let top = (cortex_m::register::msp::read() as usize - MARGIN) as *mut u32;
    while word < top {
        // SAFETY: between the end of the statics and the stack pointer nothing lives; aligned by
        // the linker script.
        unsafe {
            word.write_volatile(STACK_PAINT);
            word = word.add(1);
        }
    }
}

/// Stops if the stack has reached the statics.
pub(crate) fn check() {
    let lowest = addr_of_mut!(_stack_end);
    // SAFETY: the words are RAM above the statics.
    let untouched =
        (0..GUARD_WORDS).all(|index| unsafe { lowest.add(index).read_volatile() } == STACK_PAINT);
    if !untouched {
        crash::stop(SelfCheck::Stack);
    }
}
