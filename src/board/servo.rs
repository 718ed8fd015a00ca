//! The servo's pulses, and the ticks that are locked to them, from one timer.
//!
//! TCC0 counts up at 3 MHz. Its overflow is the rising edge of the pulse, its compare channel 1 the falling edge (normal
//! PWM, data sheet 31.6.2.5). Pulses are written to the buffer register CCB1 and take effect at the next overflow: the
//! compare register itself, written while the pin is high, would make one pulse last a whole frame. The other compare
//! channels have no pin; their interrupts are the ticks of the [`Schedule`]. The last tick of a frame comes [`lead_us`]
//! before the edge that is to carry its sample.
//!
//! A register that is still synchronising with the timer's clock discards a second write (data sheet 14.3): every write
//! here waits for its flag, for a bounded time.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use atsamd_hal::clock::Tcc0Tcc1Clock;
use bno055_driver::Micros;
use critical_section::Mutex;
use tvc_nano::schedule::Schedule;
use tvc_nano::servo::PulseUs;

use super::nano33iot::{SERVO, SERVO_CHANNEL, SERVO_FUNCTION, frame_registers};
use super::time::{now, soon};
use super::{STEP_BUDGET_US, i2c};

/// Timer counts in a microsecond: 48 MHz / 16.
const COUNTS_PER_US: u32 = 3;
/// Slowest and fastest servo frame.
const RATES_HZ: (u32, u32) = (50, 333);
/// Compare channels of the ticks, the frame's last first.
const TICK_CHANNELS: [usize; Schedule::MOST_TICKS as usize] = [3, 2, 0];

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

/// Timer values for a frame rate.
#[derive(Clone, Copy)]
struct Plan {
    schedule: Schedule,
    /// Counts in a frame.
    period: u32,
    /// Counts of the ticks in a frame, the last first; those that there are not repeat it.
    ticks: [u32; TICK_CHANNELS.len()],
    /// Time from tick to tick.
    tick_period_us: u32,
}

const fn plan(frame_hz: u32, i2c_khz: u32) -> Plan {
    let frame_hz = match frame_hz {
        hz if hz < RATES_HZ.0 => RATES_HZ.0,
        hz if hz > RATES_HZ.1 => RATES_HZ.1,
        hz => hz,
    };
    let schedule = Schedule::new(frame_hz, i2c_khz);
    let period = COUNTS_PER_US * 1_000_000 / frame_hz;
    let spacing = period / schedule.ticks_per_frame as u32;
    let last = period - 1 - (COUNTS_PER_US * lead_us(i2c_khz) - 1) % period;
    let mut ticks = [last; TICK_CHANNELS.len()];
    let mut index = 1;
    while index < schedule.ticks_per_frame as usize {
        let back = ticks[index - 1];
        ticks[index] = if back < spacing { back + period } else { back } - spacing;
        index += 1;
    }
    Plan {
        schedule,
        period,
        ticks,
        tick_period_us: schedule.period_us(frame_hz),
    }
}

const _: () = {
    assert!(lead_us(400) == 6_500 && lead_us(100) == 7_900);
    let slow = plan(50, 400);
    assert!(slow.period == 60_000 && slow.tick_period_us == 6_666);
    assert!(matches!(slow.ticks, [40_500, 20_500, 500]));
    let careful = plan(50, 100);
    assert!(matches!(careful.ticks, [36_300, 6_300, 36_300]));
    let fast = plan(300, 400);
    assert!(fast.period == 10_000 && fast.tick_period_us == 6_666);
    assert!(fast.ticks[0] == 500 && fast.schedule.frames_per_tick == 2);
    assert!(tick_flags(3) == 0b1101 << 16 && tick_flags(1) == 1 << 19);
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
        let plan = plan(frame_hz, i2c_khz);
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
            for (channel, tick) in TICK_CHANNELS.into_iter().zip(plan.ticks) {
                timer.cc(channel).write(|w| w.bits(tick));
            }
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

    /// Speed of the sensor bus that the ticks are made for.
    pub(super) fn i2c_khz(&self) -> u32 {
        self.i2c_khz
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
        let plan = plan(frame_hz, i2c_khz);
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
    let Schedule {
        ticks_per_frame,
        frames_per_tick,
    } = plan.schedule;
    FRAMES_PER_TICK.store(frames_per_tick, Ordering::Relaxed);
    let (all, wanted) = (
        tick_flags(Schedule::MOST_TICKS),
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
    let pending = timer.intflag().read().bits() & timer.intenset().read().bits();
    // SAFETY: clears what has been seen.
    timer.intflag().write(|w| unsafe { w.bits(pending) });
    let last = pending & tick_flags(1) != 0;
    let frames = FRAMES.load(Ordering::Relaxed) + u8::from(last);
    let due = pending & !tick_flags(1) != 0 || frames >= FRAMES_PER_TICK.load(Ordering::Relaxed);
    FRAMES.store(if last && due { 0 } else { frames }, Ordering::Relaxed);
    if due {
        let time = now();
        i2c::start_burst(time);
        critical_section::with(|cs| TICK.borrow(cs).set(Some(time)));
    }
}
