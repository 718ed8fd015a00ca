//! Failed self-checks and faults: the servo goes to neutral, the reason survives the reset.
//!
//! The record lies in RAM that neither this program's start-up nor the bootloader touches. It is
//! sealed, for RAM holds noise after power-on. It is read once at the next start and cleared.
//!
//! What ends a run may be a bit that has flipped in the image. So the neutral pulses come before
//! all else, and the little that follows has neither loops nor tables, which a flipped bit could
//! make endless or wrong.
//!
//! After the servo has been sent to neutral the chip does not reset at once. For a tenth of a
//! second the timer goes on sending neutral pulses, so that the rudder gets there before the
//! bootloader's half second without any. Then the chip is reset between two pulses, because the
//! servo would follow a pulse that is cut short.
//!
//! A processor that locks up (a fault within the fault handler, or a stack pointer outside RAM)
//! leaves no record, and the watchdog ends it at any moment. The next start sends neutral pulses
//! before it runs what may lock up again ([`behind_lock_up`]).

use core::ptr::addr_of_mut;

use atsamd_hal::pac;
use cortex_m_rt::{ExceptionFrame, exception};
use tvc_nano::{Axis, Crash, SelfCheck};

use super::registers::restore_clocks;
use super::{dfll, frame, last_frames, time, usb, watchdog};

/// Marks a record, and its layout's version.
const MAGIC: u32 = 0x5456_4334;
const SELF_CHECK: u32 = 1;
const HARD_FAULT: u32 = 2;
const HANG: u32 = 3;

/// Frames of 50 Hz with neutral pulses before the reset of a damaged image: a tenth of a second.
const LAST_FRAMES: u32 = 6;

/// Frames of 50 Hz in which a slow servo turns through all of its travel: 0.6 s.
const REFUSED_FRAMES: u32 = 30;

/// Half of the time for which neutral pulses go on before a reset, us. The watchdog, which is fed
/// before either half, takes 89 ms where its oscillator is 40 % fast: this, a frame and a pulse are
/// less.
const LAST_PULSES_US: u32 = 45_000;

#[repr(C)]
#[derive(Clone, Copy)]
struct Record {
    magic: u32,
    kind: u32,
    /// Which self-check, or the address of a fault's instruction.
    detail: u32,
    seal: u32,
}

unsafe extern "C" {
    /// Where the record lies (see memory.x).
    static mut _crash_record: Record;
    /// Where the neutral pulses are kept, behind it.
    static mut _kept_neutral: KeptNeutral;
    /// Where starts are counted.
    static mut _starts: Starts;
}

impl Record {
    const EMPTY: Self = Self { magic: 0, kind: 0, detail: 0, seal: 0 };

    fn new(kind: u32, detail: u32) -> Self {
        Self { magic: MAGIC, kind, detail, seal: seal(kind, detail) }
    }

    fn crash(self) -> Option<Crash> {
        let sealed = self.magic == MAGIC && self.seal == seal(self.kind, self.detail);
        match self.kind {
            SELF_CHECK if sealed => {
                let check = SelfCheck::try_from(self.detail as u8);
                check.ok().map(Crash::SelfCheck)
            }
            HARD_FAULT if sealed => Some(Crash::HardFault { pc: self.detail }),
            HANG if sealed => Some(Crash::Watchdog),
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

/// What two words are sealed with behind [`MAGIC`]: another value for any one flipped bit of them,
/// and for zeros and ones that RAM may come up with.
fn seal(first: u32, second: u32) -> u32 {
    !(MAGIC ^ first ^ second.rotate_left(16))
}

/// How the last run ended: the record, if the reset was not a power-on, else the reset's own cause.
pub(crate) fn report(pm: &pac::Pm) -> Option<Crash> {
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
fn end(kind: u32, detail: u32) -> ! {
    cortex_m::interrupt::disable();
    frame::force_neutral();
    Record::new(kind, detail).store();
    const DAMAGED: u32 = SelfCheck::Flash.code() as u32;
    // What follows here may be what is damaged.
    if kind == SELF_CHECK && detail == DAMAGED {
        last_frames::reset_behind(LAST_FRAMES);
    }
    if watchdog::is_running() {
        watchdog::hold_off();
        restore_clocks();
        dfll::restore();
        frame::end_in_neutral();
        watchdog::hold_off();
        time::delay_us(LAST_PULSES_US);
        watchdog::hold_off();
        time::delay_us(LAST_PULSES_US);
    }
    frame::reset_in_gap()
}

/// The program hangs: the watchdog has warned, and nobody has fed it since.
#[cold]
#[inline(never)]
pub(crate) fn stop_hanging() -> ! {
    end(HANG, 0)
}

/// Hangs with interrupts off, where only the watchdog itself ends it. The pulses end before: the
/// watchdog would cut one.
#[cold]
#[inline(never)]
pub(crate) fn hang() -> ! {
    cortex_m::interrupt::disable();
    frame::end_pulses();
    loop {
        cortex_m::asm::nop();
    }
}

/// Something is wrong with the firmware or its chip, and cannot be put right while it runs.
#[cold]
#[inline(never)]
pub(crate) fn stop(check: SelfCheck) -> ! {
    end(SELF_CHECK, check.code().into())
}

/// The image is not to be run: it is left to the bootloader, where another one can be put in its
/// place. A rudder that was steered before the reset is brought to neutral first, by the pulses
/// that the sound image had worked out, unless the damage has made another clock of the timer's.
#[cold]
#[inline(never)]
pub(crate) fn refuse_to_start(check: SelfCheck) -> ! {
    let is_sent = send_kept_neutral();
    leave_to_bootloader(Record::new(SELF_CHECK, check.code().into()), is_sent)
}

/// The start of a program that the watchdog itself has ended: the processor locked up, or hung with
/// its interrupts off, and the rudder is where it was. Neutral pulses come before the image is
/// read, for a flipped bit may be in the code that reads it. The first time they end before that,
/// where another lock-up would cut one. The second time in a row the image is left to the
/// bootloader.
pub(crate) fn behind_lock_up(pm: &pac::Pm, starts: u32) {
    if pm.rcause().read().wdt().bit_is_clear() {
        return;
    }
    let is_sent = send_kept_neutral();
    if starts > 1 {
        leave_to_bootloader(Record::new(HANG, 0), is_sent);
    }
    if is_sent {
        // The sensor waits for as long.
        frame::begin_next();
        time::delay_us(frame::SECOND_PULSE_US);
        frame::end_pulses();
    }
}

/// Sends the neutral pulses that the last run has kept, from here on. `false` if it has kept none.
fn send_kept_neutral() -> bool {
    let kept = KeptNeutral::read().filter(|_| dfll::is_as_meant() && dfll::is_untuned());
    if let Some(counts) = kept {
        frame::will_be_sent(counts);
        frame::send_pulses(counts);
    }
    kept.is_some()
}

fn leave_to_bootloader(record: Record, is_neutral_sent: bool) -> ! {
    record.store();
    usb::ask_for_bootloader();
    last_frames::reset_behind(if is_neutral_sent { REFUSED_FRAMES } else { 0 })
}

/// The neutral pulses, in counts of the servo frame's timer, where a reset leaves them; sealed as
/// the [`Record`] is.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct KeptNeutral {
    counts: [u32; Axis::COUNT],
    seal: u32,
}

impl KeptNeutral {
    /// Keeps them.
    pub(crate) fn store(counts: [u32; Axis::COUNT]) {
        let [first, second] = counts;
        let kept = Self { counts, seal: seal(first, second) };
        // SAFETY: as in `Record::store`.
        unsafe { addr_of_mut!(_kept_neutral).write_volatile(kept) };
    }

    fn read() -> Option<[u32; Axis::COUNT]> {
        // SAFETY: as in `Record::take`.
        let kept = unsafe { addr_of_mut!(_kept_neutral).read_volatile() };
        let [first, second] = kept.counts;
        (kept.seal == seal(first, second)).then_some(kept.counts)
    }
}

/// Starts in a row behind which the loop has not worked, with their seal.
#[repr(C)]
#[derive(Clone, Copy)]
struct Starts {
    count: u32,
    seal: u32,
}

/// An image that has not come to work after this number of starts is left to the bootloader.
const STARTS_MAX: u32 = 4;

/// The program starts: for which time in a row. What ends it before it works, a bit that has
/// flipped in the code of its start, does so again and again.
pub(crate) fn count_start(pm: &pac::Pm) -> u32 {
    let cause = pm.rcause().read();
    // SAFETY: as in `Record::take`.
    let kept = unsafe { addr_of_mut!(_starts).read_volatile() };
    let goes_on = cause.wdt().bit_is_set() || cause.syst().bit_is_set();
    let count =
        if goes_on && kept.seal == seal(kept.count, 0) { kept.count.saturating_add(1) } else { 1 };
    if count > STARTS_MAX {
        keep_starts(0);
        usb::enter_bootloader();
    }
    keep_starts(count);
    count
}

/// The loop works.
pub(crate) fn has_started() {
    keep_starts(0);
}

fn keep_starts(count: u32) {
    let starts = Starts { count, seal: seal(count, 0) };
    // SAFETY: as in `Record::store`.
    unsafe { addr_of_mut!(_starts).write_volatile(starts) };
}

/// Every program needs one. Nothing calls it: no call of a panic is linked into the image, to which
/// a test holds its symbols and its machine code.
#[cfg(not(feature = "probe"))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    stop(SelfCheck::Panic)
}

/// With a probe the panic prints there and ends in a hard fault, which comes by here.
#[cfg(feature = "probe")]
use panic_probe as _;

// SAFETY: only reads the frame; never returns.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    end(HARD_FAULT, frame.pc())
}

/// An interrupt that nobody enabled.
// SAFETY: never returns.
#[exception]
unsafe fn DefaultHandler(_number: i16) -> ! {
    stop(SelfCheck::Interrupt)
}
