//! The servo frame: pulses, and the ticks that are locked to them, from one timer.
//!
//! A TCC counts up at 3 MHz. Its overflow is the rising edge of the pulse, the compare channel of
//! the servo's pin the falling edge (normal PWM, data sheet 31.6.2.5). Pulses are written to the
//! channel's buffer register and take effect at the next overflow: the compare register itself,
//! written while the pin is high, would make one pulse last a whole frame. The other compare
//! channels have no pin; their interrupts are the ticks of the [`TickPlan`].
//!
//! A register that is still synchronising with the timer's clock discards a second write (data
//! sheet 14.3): every write here waits for its flag, for a bounded time.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use bno055_driver::Micros;
use critical_section::Mutex;
use tvc_nano::servo::PulseUs;
use tvc_nano::ticks::{TickPlan, TimerPlan, Timing};

use super::i2c;
use super::nano33iot::{
    FrameClock, SERVO, SERVO_CHANNEL, SERVO_FUNCTION, TICK_CHANNELS, frame_registers,
    on_frame_interrupt,
};
use super::time::{self, now, soon};

/// Timer counts in a microsecond: 48 MHz / 16.
const COUNTS_PER_US: u32 = 3;

/// STATUS.CCBVx and SYNCBUSY.CCBx of the servo's channel.
const BUFFER_IS_FULL: u32 = 1 << (16 + SERVO_CHANNEL);
/// See [`BUFFER_IS_FULL`].
const BUFFER_SYNCHRONISES: u32 = 1 << (19 + SERVO_CHANNEL);

/// The pulse that [`force_neutral`] sends, in counts; 0 until the firmware has said what neutral
/// is.
static NEUTRAL: AtomicU32 = AtomicU32::new(0);
/// The frame has begun to run and the timer may be touched from anywhere.
static RUNNING: AtomicBool = AtomicBool::new(false);
/// A tick comes every so many frames.
static FRAMES_PER_TICK: AtomicU8 = AtomicU8::new(1);
/// Frames since the last tick.
static FRAMES: AtomicU8 = AtomicU8::new(0);
/// So long after a tick its burst is too late for its step, us: a whole one, and one of the rates
/// alone.
static BURST_LIMITS_US: [AtomicU32; 2] = [AtomicU32::new(0), AtomicU32::new(0)];
/// The last tick of a frame reads the rates alone.
static IS_SPLIT: AtomicBool = AtomicBool::new(false);
/// The newest tick that the main loop has not seen.
static TICK: Mutex<Cell<Option<Tick>>> = Mutex::new(Cell::new(None));

/// A tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tick {
    /// When it came.
    pub(super) at: Micros,
    /// The next pulse carries its step.
    pub(super) is_carried: bool,
    /// Its burst reads the rates alone.
    pub(super) alone: bool,
}

/// The interrupt flags of the first `count` tick channels.
const fn tick_flags(count: u8) -> u32 {
    const MATCH_0: u32 = 16;
    let (mut flags, mut index) = (0, 0);
    while index < count as usize {
        flags |= 1 << (MATCH_0 + TICK_CHANNELS[index] as u32);
        index += 1;
    }
    flags
}

const _: () = assert!(tick_flags(3) == 0b1101 << 16 && tick_flags(1) == 1 << 19);

/// The running frame.
pub(super) struct Frame {
    timing: Timing,
    tick_period_us: u32,
}

impl Frame {
    /// Start the frame. The first, 20 ms long, is without a pulse; `neutral` follows.
    pub(super) fn start(_clock: &FrameClock, neutral: PulseUs, timing: Timing) -> Self {
        SERVO.low();
        set_neutral(neutral);
        let plan = TimerPlan::new(COUNTS_PER_US, &timing);
        let timer = frame_registers();
        timer.ctrla().write(|w| w.swrst().set_bit());
        let mut ready = soon(|| timer.syncbusy().read().swrst().bit_is_clear());
        timer.ctrla().write(|w| w.prescaler().div16());
        timer.wave().write(|w| w.wavegen().npwm());
        // Pulses go on while a debugger holds the core.
        #[cfg(feature = "probe")]
        timer.dbgctrl().write(|w| w.dbgrun().set_bit());
        ready &= soon(|| timer.syncbusy().read().wave().bit_is_clear());
        // SAFETY: all values are less than the counter's 24 bits hold.
        unsafe {
            timer.per().write(|w| w.bits(plan.period - 1));
            timer.cc(SERVO_CHANNEL).write(|w| w.bits(0));
            for (channel, tick) in TICK_CHANNELS.into_iter().zip(plan.ticks) {
                timer.cc(channel).write(|w| w.bits(tick));
            }
        }
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        announce(&plan, &timing);
        timer
            .ctrla()
            .modify(|_, w| w.prescaler().div16().enable().set_bit());
        ready &= soon(|| timer.syncbusy().read().enable().bit_is_clear());
        SERVO.connect(SERVO_FUNCTION);
        RUNNING.store(true, Ordering::Release);
        ready &= write_buffer(COUNTS_PER_US * u32::from(neutral.0));
        if !ready {
            // Without its timer the board can do nothing for the servo; the reset counts as a crash
            // and is reported.
            panic!("servo timer does not synchronise");
        }
        Self {
            timing,
            tick_period_us: plan.tick_period_us,
        }
    }

    /// Send `pulse` from the next frame on. `false` if the timer did not take it.
    #[must_use]
    pub(super) fn write(&mut self, pulse: PulseUs) -> bool {
        write_buffer(COUNTS_PER_US * u32::from(pulse.0))
    }

    /// Whether the pulse written last has gone from the buffer to the pin.
    pub(super) fn is_sent(&self) -> bool {
        frame_registers().status().read().bits() & BUFFER_IS_FULL == 0
    }

    /// What the ticks are made for.
    pub(super) fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Time from tick to tick.
    pub(super) fn tick_period_us(&self) -> u32 {
        self.tick_period_us
    }

    /// Change frame rate and tick lead from the next frame on, all at once, so that no pulse is cut
    /// short. `false` if the timer did not take it.
    #[must_use]
    pub(super) fn retime(&mut self, timing: Timing) -> bool {
        if timing == self.timing {
            return true;
        }
        let plan = TimerPlan::new(COUNTS_PER_US, &timing);
        let timer = frame_registers();
        timer.ctrlbset().write(|w| w.lupd().set_bit());
        let mut ready = soon(|| timer.syncbusy().read().ctrlb().bit_is_clear());
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        // SAFETY: as in `start`.
        unsafe {
            timer.perb().write(|w| w.bits(plan.period - 1));
            for (channel, tick) in TICK_CHANNELS.into_iter().zip(plan.ticks) {
                timer.ccb(channel).write(|w| w.bits(tick));
            }
        }
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        timer.ctrlbclr().write(|w| w.lupd().set_bit());
        ready &= soon(|| timer.syncbusy().read().ctrlb().bit_is_clear());
        announce(&plan, &timing);
        if ready {
            *self = Self {
                timing,
                tick_period_us: plan.tick_period_us,
            };
        }
        ready
    }
}

/// Tell the interrupt which ticks to expect.
fn announce(plan: &TimerPlan, timing: &Timing) {
    let timer = frame_registers();
    let TickPlan {
        ticks_per_frame,
        frames_per_tick,
    } = plan.plan;
    FRAMES_PER_TICK.store(frames_per_tick, Ordering::Relaxed);
    let [whole, rates] = &BURST_LIMITS_US;
    whole.store(timing.burst_limit_us(false), Ordering::Relaxed);
    rates.store(timing.burst_limit_us(true), Ordering::Relaxed);
    IS_SPLIT.store(timing.is_split(), Ordering::Relaxed);
    let (all, wanted) = (
        tick_flags(TickPlan::MOST_TICKS),
        tick_flags(ticks_per_frame),
    );
    // SAFETY: flags that exist, of this module's own channels.
    unsafe {
        timer.intenclr().write(|w| w.bits(all & !wanted));
        timer.intflag().write(|w| w.bits(all & !wanted));
        timer.intenset().write(|w| w.bits(wanted));
    }
}

fn write_buffer(counts: u32) -> bool {
    let timer = frame_registers();
    let ready = soon(|| timer.syncbusy().read().bits() & BUFFER_SYNCHRONISES == 0);
    if ready {
        // SAFETY: a pulse is at most 65,535 us, 196,605 counts; the register has 24 bits.
        timer
            .ccb(SERVO_CHANNEL)
            .write(|w| unsafe { w.bits(counts) });
    }
    ready
}

/// What [`force_neutral`] sends.
pub(super) fn set_neutral(pulse: PulseUs) {
    NEUTRAL.store(COUNTS_PER_US * u32::from(pulse.0), Ordering::Relaxed);
}

/// Send the neutral pulse, whoever calls and whatever the main loop was doing.
pub(super) fn force_neutral() {
    if RUNNING.load(Ordering::Acquire) {
        let timer = frame_registers();
        // A change of the frame rate may have been cut short.
        timer.ctrlbclr().write(|w| w.lupd().set_bit());
        // In vain only if the timer itself is broken, and then nothing is left to try.
        let _ = write_buffer(NEUTRAL.load(Ordering::Relaxed));
    }
}

/// The newest tick, once.
pub(super) fn take_tick() -> Option<Tick> {
    critical_section::with(|cs| TICK.borrow(cs).take())
}

on_frame_interrupt!(matched);

/// A compare channel has matched: start the burst, tell the main loop.
fn matched() {
    let timer = frame_registers();
    let pending = timer.intflag().read().bits() & timer.intenset().read().bits();
    // SAFETY: clears what has been seen.
    timer.intflag().write(|w| unsafe { w.bits(pending) });
    let last = pending & tick_flags(1) != 0;
    let frames = FRAMES.load(Ordering::Relaxed) + u8::from(last);
    let due = pending & !tick_flags(1) != 0 || frames >= FRAMES_PER_TICK.load(Ordering::Relaxed);
    FRAMES.store(if last && due { 0 } else { frames }, Ordering::Relaxed);
    if due {
        let at = now();
        let alone = last && IS_SPLIT.load(Ordering::Relaxed);
        i2c::start_burst(at, alone);
        // The burst's end wakes the main loop, or its being late does.
        if let Some(limit_us) = BURST_LIMITS_US.get(usize::from(alone)) {
            time::wake_before(at.after(limit_us.load(Ordering::Relaxed).into()));
        }
        let tick = Tick {
            at,
            is_carried: last,
            alone,
        };
        critical_section::with(|cs| TICK.borrow(cs).set(Some(tick)));
    }
}
