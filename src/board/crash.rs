//! Panics and faults: the servo goes to neutral, the reason survives the reset.
//!
//! The record lies in RAM that neither this program's start-up nor the bootloader touches. It is
//! sealed by a checksum, for RAM holds noise after power-on. It is read once at the next start and
//! cleared.
//!
//! After the servo has been sent to neutral the chip does not reset at once: the watchdog does
//! that, within 125 ms. Until then the timer goes on sending neutral pulses, so that the rudder
//! gets there before the bootloader's half second without any. A processor that locks up (a fault
//! within the fault handler, or a stack pointer outside RAM) leaves no record; the watchdog ends
//! that too.

use core::ptr::addr_of_mut;

use atsamd_hal::pac;
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use tvc_nano::failsafe::Crash;

use super::{frame, time, watchdog};

/// Marks a record, and its layout's version.
const MAGIC: u32 = 0x5456_4332;
const PANIC: u32 = 1;
const HARD_FAULT: u32 = 2;

/// The stack's RAM, less the last word.
#[cfg(not(feature = "probe"))]
const RAM: core::ops::Range<u32> = 0x2000_0000..0x2000_77FC;

/// Longer than the watchdog takes.
const LAST_WAIT_US: u32 = 150_000;

#[repr(C)]
#[derive(Clone, Copy)]
struct Record {
    magic: u32,
    kind: u32,
    /// Return addresses of a panic, innermost first; a fault's instruction in the first.
    places: [u32; 3],
    crc: u32,
}

unsafe extern "C" {
    /// Where the record lies (see memory.x).
    static mut _crash_record: Record;
}

impl Record {
    const EMPTY: Self = Self {
        magic: 0,
        kind: 0,
        places: [0; 3],
        crc: 0,
    };

    fn new(kind: u32, places: [u32; 3]) -> Self {
        let mut record = Self {
            magic: MAGIC,
            kind,
            places,
            crc: 0,
        };
        record.crc = record.checksum();
        record
    }

    fn checksum(&self) -> u32 {
        let [a, b, c] = self.places;
        crc32([self.magic, self.kind, a, b, c])
    }

    fn crash(self) -> Option<Crash> {
        let sealed = self.magic == MAGIC && self.crc == self.checksum();
        match self.kind {
            PANIC if sealed => Some(Crash::Panic {
                callers: self.places,
            }),
            HARD_FAULT if sealed => Some(Crash::HardFault { pc: self.places[0] }),
            _ => None,
        }
    }

    fn store(self) {
        // SAFETY: RAM of its own, aligned; volatile because only the next run reads it.
        unsafe { addr_of_mut!(_crash_record).write_volatile(self) };
    }

    fn take() -> Self {
        // SAFETY: as in `store`; any bits are a valid record of integers.
        let record = unsafe { addr_of_mut!(_crash_record).read_volatile() };
        Self::EMPTY.store();
        record
    }
}

/// CRC-32 of IEEE 802.3 over words, low byte first.
fn crc32(words: [u32; 5]) -> u32 {
    let crc = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    for word in words {
        digest.update(&word.to_le_bytes());
    }
    digest.finalize()
}

/// How the last run ended: the record, if the reset was not a power-on, else the reset's own cause.
pub(super) fn report(pm: &pac::Pm) -> Option<Crash> {
    let cause = pm.rcause().read();
    let recorded = Record::take().crash();
    if cause.por().bit_is_set() {
        None
    } else if recorded.is_some() {
        recorded
    } else if cause.wdt().bit_is_set() {
        Some(Crash::Watchdog)
    } else if cause.bod33().bit_is_set() || cause.bod12().bit_is_set() {
        Some(Crash::BrownOut)
    } else {
        None
    }
}

/// Neutral, record, reset.
fn end(record: Record) -> ! {
    cortex_m::interrupt::disable();
    frame::force_neutral();
    record.store();
    if watchdog::is_running() {
        time::delay_us(LAST_WAIT_US);
    }
    SCB::sys_reset()
}

/// A panic says where it is by its return addresses and not by file and line: those of every place
/// that could panic would take 4 KB of the image. The ELF tells function, file and line of an
/// address.
#[cfg(not(feature = "probe"))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // The innermost is in the core library's own code for panics.
    let [_, places @ ..] = return_addresses();
    end(Record::new(PANIC, places))
}

/// Where the functions under way return to, innermost first; 0 where the chain of their frames
/// ends.
///
/// The target's functions keep their frame's address in r7, where the caller's frame and the return
/// address lie.
#[cfg(not(feature = "probe"))]
#[inline(always)]
fn return_addresses() -> [u32; 4] {
    let mut frame: u32;
    // SAFETY: reads a register.
    unsafe { core::arch::asm!("mov {}, r7", out(reg) frame, options(nomem, nostack)) };
    [(); 4].map(|()| {
        if !frame.is_multiple_of(4) || !RAM.contains(&frame) {
            return 0;
        }
        let words = frame as *const u32;
        // SAFETY: two aligned words in RAM, whatever they hold.
        let (caller, address) = unsafe { (words.read_volatile(), words.add(1).read_volatile()) };
        // The stack grows down: a chain that does not rise has no end.
        frame = if caller > frame { caller } else { 0 };
        // Without the bit that stands for Thumb code.
        address & !1
    })
}

/// With a probe the panic prints there and ends in a hard fault, which comes by here.
#[cfg(feature = "probe")]
use panic_probe as _;

// SAFETY: only reads the frame; never returns.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    end(Record::new(HARD_FAULT, [frame.pc(), 0, 0]))
}

/// An interrupt that nobody enabled.
// SAFETY: never returns.
#[exception]
unsafe fn DefaultHandler(_number: i16) -> ! {
    panic!("unexpected interrupt")
}
