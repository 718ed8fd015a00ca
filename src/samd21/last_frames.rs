//! The end of a run whose image may be damaged. Little code, which calls nothing and reads nothing
//! but registers: a flipped bit seldom lies in it.

use core::ptr::{with_exposed_provenance, with_exposed_provenance_mut};

use super::frame::{LONGEST_PULSE_US, OVERFLOW};
use super::watchdog::CLEAR_KEY;

/// TCC0.INTFLAG.
const FRAME_FLAGS: usize = 0x4200_202C;
/// WDT.STATUS, and its flag of a write that is under way; WDT.CLEAR.
const WATCHDOG_STATUS: usize = 0x4000_1007;
const SYNCBUSY: u8 = 1 << 7;
const WATCHDOG_CLEAR: usize = 0x4000_1008;
/// SCB.AIRCR, its key and its order to reset.
const RESET: usize = 0xE000_ED0C;
const RESET_ORDER: u32 = 0x05FA_0004;

/// Looks at the flag in the longest frame, of at least five cycles each, and some more.
const LOOKS: u32 = 200_000;
/// Turns of a loop of three cycles or more in a microsecond.
const TURNS_PER_US: u32 = 48 / 3;
/// The longest frame, us.
const FRAME_US: u32 = 20_000;

/// Resets the chip between two pulses, after the time of this number of frames and one, in which
/// the timer sends its pulses.
///
/// The core counts that time, and only then looks for the end of a frame: where a flipped bit ends
/// the one too soon, the other has a pulse sent.
#[inline(never)]
pub(super) fn reset_behind(frames: u32) -> ! {
    for _ in 0..=frames {
        // SAFETY: registers that are always mapped.
        unsafe {
            let status = with_exposed_provenance::<u8>(WATCHDOG_STATUS).read_volatile();
            if status & SYNCBUSY == 0 {
                with_exposed_provenance_mut::<u8>(WATCHDOG_CLEAR).write_volatile(CLEAR_KEY);
            }
        }
        cortex_m::asm::delay(FRAME_US * TURNS_PER_US);
    }
    // SAFETY: as above.
    unsafe {
        let flags = with_exposed_provenance_mut::<u32>(FRAME_FLAGS);
        flags.write_volatile(OVERFLOW);
        let mut looks = LOOKS;
        while flags.read_volatile() & OVERFLOW == 0 && looks > 0 {
            looks -= 1;
        }
    }
    cortex_m::asm::delay(LONGEST_PULSE_US * TURNS_PER_US);
    // SAFETY: the order to reset.
    unsafe { with_exposed_provenance_mut::<u32>(RESET).write_volatile(RESET_ORDER) };
    loop {
        cortex_m::asm::nop();
    }
}
