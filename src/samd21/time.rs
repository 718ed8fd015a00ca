//! Time since start-up in microseconds, 64 bits wide, from SysTick.
//!
//! SysTick interrupts every millisecond; between interrupts its counter gives the rest. Its
//! interrupt has the highest priority, so no other code runs between the counter's overflow and the
//! addition of that millisecond. With interrupts held off the interrupt is either pending, which
//! [`now`] sees, or done.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering};

use atsamd_hal::pac::{SCB, SYST};
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use critical_section::{CriticalSection, Mutex};
use tvc_imu::Micros;
use tvc_nano::sleep::{TIMER_PERIOD_US, may_sleep};

use super::{wake, watchdog};

/// CPU clock cycles in a microsecond.
pub(crate) const CYCLES_PER_US: u32 = 48;
const CYCLES_PER_MS: u32 = 1_000 * CYCLES_PER_US;

/// Microseconds up to the last SysTick interrupt.
static ELAPSED_US: Mutex<Cell<u64>> = Mutex::new(Cell::new(0));

/// What the main loop must not sleep through: SysTick's last interrupt before it asks for the loop.
static ALARM: Mutex<Cell<Micros>> = Mutex::new(Cell::new(Micros(0)));

/// An interrupt has [asked to be seen in time](wake_before), and nobody has looked since.
static UNSEEN: AtomicBool = AtomicBool::new(false);

/// Start the clock at zero.
pub(crate) fn start(syst: &mut SYST) {
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(CYCLES_PER_MS - 1);
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
}

/// The time.
pub(crate) fn now() -> Micros {
    critical_section::with(now_within)
}

/// The time, for whoever holds interrupts off already.
pub(crate) fn now_within(cs: CriticalSection) -> Micros {
    let before = SYST::get_current();
    let (whole, count) = if SCB::is_pendst_pending() {
        // The counter has come round, perhaps since `before` was read.
        (1_000, SYST::get_current())
    } else {
        (0, before)
    };
    Micros(ELAPSED_US.borrow(cs).get() + whole + u64::from(since_interrupt_us(count)))
}

/// Sleep until an interrupt [asks](wake::request) for the main loop, or `turn` [is near](is_near),
/// or `deadline` has come. Gives the time then, and for how long the main loop slept, us. Less than
/// a period of SysTick before the deadline it stays awake: nothing would wake it in time.
pub(crate) fn sleep_until(deadline: Micros, turn: Micros) -> (Micros, u32) {
    let end = deadline.min(turn);
    let (is_unseen, is_turn, is_last) = critical_section::with(|cs| {
        ALARM.borrow(cs).set(end);
        let interrupted = Micros(ELAPSED_US.borrow(cs).get());
        let is_unseen = UNSEEN.load(Ordering::Relaxed);
        UNSEEN.store(false, Ordering::Relaxed);
        (is_unseen, !may_sleep(interrupted, turn), !may_sleep(interrupted, end))
    });
    // It came after its reader had looked: the deadlines are not the newest.
    if is_unseen {
        return (now(), 0);
    }
    if is_last {
        while !is_turn && now() < deadline && !critical_section::with(wake::take) {}
        return (now(), 0);
    }
    let began = now();
    wake::sleep();
    let ended = now();
    (ended, ended.since(began) as u32)
}

/// Have SysTick [ask](wake::request) for the main loop before `deadline`, unless something else
/// does so earlier.
pub(crate) fn wake_before(deadline: Micros) {
    critical_section::with(|cs| {
        let alarm = ALARM.borrow(cs);
        alarm.set(alarm.get().min(deadline));
    });
    UNSEEN.store(true, Ordering::Relaxed);
}

/// What the interrupt had to say has been read.
pub(crate) fn seen() {
    UNSEEN.store(false, Ordering::Relaxed);
}

/// Whether `turn` comes before the next interrupt of SysTick.
pub(crate) fn is_near(turn: Micros) -> bool {
    critical_section::with(|cs| !may_sleep(Micros(ELAPSED_US.borrow(cs).get()), turn))
}

/// Microseconds of up to 48,000 cycles. Division by 48 as a multiplication: 43,691 / 2^21 is 1/48 +
/// 1.6e-7, exact for every value that there is.
const fn micros(cycles: u32) -> u32 {
    (cycles * 43_691) >> 21
}

/// Microseconds since SysTick last became pending. It does so as the counter reaches 0, one cycle
/// before the reload.
const fn since_interrupt_us(count: u32) -> u32 {
    micros(if count == 0 { 0 } else { CYCLES_PER_MS - count })
}

const _: () = {
    assert!(micros(CYCLES_PER_MS) == 1_000);
    assert!(since_interrupt_us(0) == 0);
    assert!(since_interrupt_us(CYCLES_PER_MS - 47) == 0);
    assert!(since_interrupt_us(CYCLES_PER_MS - 48) == 1);
    assert!(since_interrupt_us(25) == 999);
    assert!(since_interrupt_us(1) == 999);
};

/// Wait, busy, for at least `us`: by the processor's cycles, for where the clock stands still.
pub(crate) fn delay_us(us: u32) {
    /// Cycles of a turn of the library's loop: a subtraction and a branch that is taken.
    const TURN_CYCLES: u32 = 3;
    cortex_m::asm::delay(us * CYCLES_PER_US / TURN_CYCLES);
}

/// Poll `ready` for a bounded time, some 100 us at 48 MHz; says whether it came true.
///
/// Synchronisation between clock domains takes about six cycles of the slower clock, here 48 MHz
/// too; where it takes longer than this, the peripheral is broken and its user reports it.
#[must_use]
pub(crate) fn soon(ready: impl Fn() -> bool) -> bool {
    const POLLS: u32 = 500;
    (0..POLLS).any(|_| ready())
}

/// Poll `ready` for `limit_us` at most, for what is slower than [`soon`]; says whether it came
/// true.
#[must_use]
pub(crate) fn within(limit_us: u64, ready: impl Fn() -> bool) -> bool {
    let began = now();
    loop {
        if ready() {
            return true;
        }
        if now().since(began) > limit_us {
            return false;
        }
    }
}

#[exception]
fn SysTick() {
    watchdog::tick();
    // SAFETY: nothing interrupts the highest priority, and the watchdog's warning, which has it
    // too, does not look at the clock.
    let cs = unsafe { CriticalSection::new() };
    let elapsed = ELAPSED_US.borrow(cs);
    let interrupted = elapsed.get() + TIMER_PERIOD_US;
    elapsed.set(interrupted);
    if !may_sleep(Micros(interrupted), ALARM.borrow(cs).get()) {
        wake::request();
    }
}
