//! The servo's pulses, and the ticks that are locked to them, from one timer.
//!
//! TCC0 counts up at 3 MHz. Its overflow is the rising edge of the pulse, its compare channel 1 the falling edge (normal
//! PWM, data sheet 31.6.2.5). Pulses are written to the buffer register CCB1 and take effect at the next overflow: the
//! compare register itself, written while the pin is high, would make one pulse last a whole frame. Compare channels 2
//! and 3 have no pin; their interrupts are the ticks. The last tick of a frame comes [`lead_us`] before the edge that is
//! to carry its sample.
//!
//! | servo frame | ticks |
//! |---|---|
//! | 50 Hz | two a frame, 10 ms apart; the second one's pulse is sent |
//! | 100 Hz | one a frame |
//! | 200 to 333 Hz | one in `rate / 100` frames |
//!
//! A register that is still synchronising with the timer's clock discards a second write (data sheet 14.3): every write
//! here waits for its flag, for a bounded time.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use atsamd_hal::clock::Tcc0Tcc1Clock;
use atsamd_hal::pac;
use bno055_driver::Micros;
use critical_section::Mutex;
use tvc_nano::servo::PulseUs;

use super::nano33iot::{SERVO, SERVO_CHANNEL, SERVO_FUNCTION, frame_registers};
use super::time::{now, soon};
use super::{STEP_BUDGET_US, i2c};

/// Timer counts in a microsecond: 48 MHz / 16.
const COUNTS_PER_US: u32 = 3;
/// Slowest and fastest servo frame.
const RATES_HZ: (u32, u32) = (50, 333);
/// Rate of the ticks, exceeded only where the frame rate is not a multiple of it.
const TICK_HZ: u32 = 100;

/// The pulse that [`force_neutral`] sends, in counts; 0 until the firmware has said what neutral is.
static NEUTRAL: AtomicU32 = AtomicU32::new(0);
/// The frame has begun to run and the timer may be touched from anywhere.
static RUNNING: AtomicBool = AtomicBool::new(false);
/// A tick comes every so many frames.
static FRAMES_PER_TICK: AtomicU8 = AtomicU8::new(1);
/// Frames since the last tick.
static FRAMES: AtomicU8 = AtomicU8::new(0);
/// When the newest tick came that the main loop has not seen.
static TICK: Mutex<Cell<Option<Micros>>> = Mutex::new(Cell::new(None));

/// How long before the edge a tick comes: the burst, [`STEP_BUDGET_US`] for the step, and a millisecond to spare.
const fn lead_us(i2c_khz: u32) -> u32 {
    burst_us(i2c_khz) + STEP_BUDGET_US + 1_000
}

/// 18 bytes with their two addresses and the register are 192 bit times, plus the BNO055's clock stretching of about
/// 180 us for each of 21 bytes.
const fn burst_us(i2c_khz: u32) -> u32 {
    if i2c_khz < 400 { 5_700 } else { 4_300 }
}

/// Timer values for a frame rate.
#[derive(Clone, Copy)]
struct Plan {
    /// Counts in a frame.
    period: u32,
    /// Count of the only or last tick.
    last: u32,
    /// Count of the tick before it in the same frame.
    first: Option<u32>,
    frames_per_tick: u8,
    /// Time from tick to tick.
    tick_period_us: u32,
}

const fn plan(frame_hz: u32, lead_us: u32) -> Plan {
    let frame_hz = match frame_hz {
        hz if hz < RATES_HZ.0 => RATES_HZ.0,
        hz if hz > RATES_HZ.1 => RATES_HZ.1,
        hz => hz,
    };
    let period = COUNTS_PER_US * 1_000_000 / frame_hz;
    let last = period - 1 - (COUNTS_PER_US * lead_us - 1) % period;
    let half = period / 2;
    if 2 * frame_hz <= TICK_HZ {
        let first = if last < half {
            last + half
        } else {
            last - half
        };
        return Plan {
            period,
            last,
            first: Some(first),
            frames_per_tick: 1,
            tick_period_us: half / COUNTS_PER_US,
        };
    }
    let frames_per_tick = if frame_hz < TICK_HZ {
        1
    } else {
        frame_hz / TICK_HZ
    };
    Plan {
        period,
        last,
        first: None,
        frames_per_tick: frames_per_tick as u8,
        tick_period_us: frames_per_tick * period / COUNTS_PER_US,
    }
}

const _: () = {
    assert!(lead_us(400) == 6_800 && lead_us(100) == 8_200);
    let slow = plan(50, 6_800);
    assert!(slow.period == 60_000 && slow.last == 60_000 - 20_400);
    assert!(matches!(slow.first, Some(9_600)) && slow.tick_period_us == 10_000);
    let fast = plan(300, 6_800);
    assert!(fast.period == 10_000 && fast.last == 9_600 && fast.frames_per_tick == 3);
    assert!(fast.first.is_none() && fast.tick_period_us == 10_000);
    let fastest = plan(333, 6_800);
    assert!(fastest.last < fastest.period && fastest.tick_period_us == 9_009);
};

/// The servo output.
pub(super) struct Servo {
    frame_hz: u32,
    i2c_khz: u32,
    tick_period_us: u32,
}

impl Servo {
    /// Start the frame. The first, 20 ms long, is without a pulse; `neutral` follows.
    pub(super) fn start(
        _clock: &Tcc0Tcc1Clock,
        neutral: PulseUs,
        frame_hz: u32,
        i2c_khz: u32,
    ) -> Self {
        SERVO.low();
        set_neutral(neutral);
        let plan = plan(frame_hz, lead_us(i2c_khz));
        let timer = frame_registers();
        timer.ctrla().write(|w| w.swrst().set_bit());
        let mut ready = soon(|| timer.syncbusy().read().swrst().bit_is_clear());
        timer.ctrla().write(|w| w.prescaler().div16());
        timer.wave().write(|w| w.wavegen().npwm());
        ready &= soon(|| timer.syncbusy().read().wave().bit_is_clear());
        // SAFETY: all values are less than the counter's 24 bits hold.
        unsafe {
            timer.per().write(|w| w.bits(plan.period - 1));
            timer.cc(SERVO_CHANNEL).write(|w| w.bits(0));
            timer
                .cc(2)
                .write(|w| w.bits(plan.first.unwrap_or(plan.last)));
            timer.cc(3).write(|w| w.bits(plan.last));
        }
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        announce(&plan);
        timer
            .ctrla()
            .modify(|_, w| w.prescaler().div16().enable().set_bit());
        ready &= soon(|| timer.syncbusy().read().enable().bit_is_clear());
        SERVO.connect(SERVO_FUNCTION);
        RUNNING.store(true, Ordering::Release);
        ready &= write_buffer(COUNTS_PER_US * u32::from(neutral.0));
        if !ready {
            // Without its timer the board can do nothing for the servo; the reset counts as a crash and is reported.
            panic!("servo timer does not synchronise");
        }
        Self {
            frame_hz,
            i2c_khz,
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
        frame_registers().status().read().ccbv1().bit_is_clear()
    }

    /// How long after its tick a burst may come home.
    pub(super) fn burst_limit_us(&self) -> u64 {
        u64::from(lead_us(self.i2c_khz) - STEP_BUDGET_US)
    }

    /// Time from tick to tick.
    pub(super) fn tick_period_us(&self) -> u64 {
        u64::from(self.tick_period_us)
    }

    /// Change frame rate and tick lead from the next frame on, all at once, so that no pulse is cut short. `false` if
    /// the timer did not take it.
    #[must_use]
    pub(super) fn retime(&mut self, frame_hz: u32, i2c_khz: u32) -> bool {
        if (frame_hz, i2c_khz) == (self.frame_hz, self.i2c_khz) {
            return true;
        }
        let plan = plan(frame_hz, lead_us(i2c_khz));
        let timer = frame_registers();
        timer.ctrlbset().write(|w| w.lupd().set_bit());
        let mut ready = soon(|| timer.syncbusy().read().ctrlb().bit_is_clear());
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        // SAFETY: as in `start`.
        unsafe {
            timer.perb().write(|w| w.bits(plan.period - 1));
            timer
                .ccb(2)
                .write(|w| w.bits(plan.first.unwrap_or(plan.last)));
            timer.ccb(3).write(|w| w.bits(plan.last));
        }
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        timer.ctrlbclr().write(|w| w.lupd().set_bit());
        ready &= soon(|| timer.syncbusy().read().ctrlb().bit_is_clear());
        announce(&plan);
        if ready {
            *self = Self {
                frame_hz,
                i2c_khz,
                tick_period_us: plan.tick_period_us,
            };
        }
        ready
    }
}

/// Tell the interrupt which ticks to expect.
fn announce(plan: &Plan) {
    let timer = frame_registers();
    FRAMES_PER_TICK.store(plan.frames_per_tick, Ordering::Relaxed);
    timer.intenset().write(|w| w.mc3().set_bit());
    if plan.first.is_some() {
        timer.intflag().write(|w| w.mc2().set_bit());
        timer.intenset().write(|w| w.mc2().set_bit());
    } else {
        timer.intenclr().write(|w| w.mc2().set_bit());
    }
}

fn write_buffer(counts: u32) -> bool {
    let timer = frame_registers();
    let ready = soon(|| timer.syncbusy().read().ccb1().bit_is_clear());
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

/// When the newest tick came, once.
pub(super) fn take_tick() -> Option<Micros> {
    critical_section::with(|cs| TICK.borrow(cs).take())
}

/// Whether a tick waits to be taken.
pub(super) fn tick_waits(cs: critical_section::CriticalSection) -> bool {
    TICK.borrow(cs).get().is_some()
}

/// A compare channel has matched: start the burst, tell the main loop.
pub(super) fn interrupt() {
    let timer = frame_registers();
    let flags: pac::tcc0::intflag::R = timer.intflag().read();
    let first = flags.mc2().bit_is_set() && timer.intenset().read().mc2().bit_is_set();
    let last = flags.mc3().bit_is_set();
    timer
        .intflag()
        .write(|w| w.mc2().bit(flags.mc2().bit()).mc3().bit(last));
    let frames = FRAMES.load(Ordering::Relaxed) + u8::from(last);
    let due = first || frames >= FRAMES_PER_TICK.load(Ordering::Relaxed);
    FRAMES.store(if last && due { 0 } else { frames }, Ordering::Relaxed);
    if due {
        let time = now();
        i2c::start_burst(time);
        critical_section::with(|cs| TICK.borrow(cs).set(Some(time)));
    }
}
