//! The servo frame: pulses, and the ticks that are locked to them, from one timer.
//!
//! A TCC counts up at 3 MHz. Its overflow is the rising edge of the pulses, the compare channel of
//! a servo's pin the falling edge (normal PWM, data sheet 31.6.2.5). Pulses are written to the
//! channel's buffer register and take effect at the next overflow: the compare register itself,
//! written while the pin is high, would make one pulse last a whole frame.
//!
//! The other two compare channels have no pin; their interrupts are the ticks of the [`TickPlan`].
//! Of three ticks in a frame the first two share a channel: each match sets it to the next of them.
//!
//! A register that is still synchronising with the timer's clock discards a second write (data
//! sheet 14.3): every write here waits for its flag, for a bounded time.

use core::cell::Cell;
use core::ops::RangeInclusive;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use atsamd_hal::clock::Tcc0Tcc1Clock;
use atsamd_hal::pac;
use atsamd_hal::pac::interrupt;
use cortex_m::peripheral::SCB;
use tvc_nano::config::{PULSE_MAX_US, PULSE_MIN_US};
use tvc_nano::sampling::Tick;
use tvc_nano::servo::PulseUs;
use tvc_nano::ticks::{TickPlan, TimerPlan, Timing};
use tvc_nano::{Axis, SelfCheck};

use super::clocks::clock_frame_again;
use super::interrupts::{Shared, TicksHeld, hold_ticks};
use super::time::{self, now, soon};
use super::wiring::Output;
use super::{crash, i2c, watchdog};
use crate::boards::WIRING;

/// Timer counts in a microsecond: 48 MHz / 16.
const COUNTS_PER_US: u32 = 3;

/// Counts of the pulses that a servo answers.
const PULSE_COUNTS: RangeInclusive<u32> =
    COUNTS_PER_US * PULSE_MIN_US as u32..=COUNTS_PER_US * PULSE_MAX_US as u32;

/// Compare channels of the timer.
pub(crate) const CHANNELS: usize = 4;
/// Those of the servos.
const SERVO_CHANNELS: [usize; Axis::COUNT] = {
    let [first, second] = WIRING.servos;
    [first.channel, second.channel]
};
/// The channel, of those that end no pulse, that makes the last tick of a frame.
const LAST_TICK_CHANNEL: usize = {
    let [first, second] = SERVO_CHANNELS;
    let mut channel = CHANNELS - 1;
    while channel == first || channel == second {
        channel -= 1;
    }
    channel
};
/// The other one, for the ticks before it, one after the other.
const EARLY_TICK_CHANNEL: usize =
    CHANNELS * (CHANNELS - 1) / 2 - SERVO_CHANNELS[0] - SERVO_CHANNELS[1] - LAST_TICK_CHANNEL;

/// INTFLAG.OVF: the frame begins.
pub(super) const OVERFLOW: u32 = 1;
/// INTFLAG.MCx of the ticks.
const LAST: u32 = 1 << (16 + LAST_TICK_CHANNEL);
/// See [`LAST`].
const EARLY: u32 = 1 << (16 + EARLY_TICK_CHANNEL);

/// The pulses that [`force_neutral`] sends, in counts; 0 until the firmware has said what neutral
/// is, and for an axis that has never been steered.
static NEUTRAL: [AtomicU32; Axis::COUNT] = [AtomicU32::new(0), AtomicU32::new(0)];
/// The same as they are [kept](crash::KeptNeutral) over a reset.
static KEPT: [AtomicU32; Axis::COUNT] = [AtomicU32::new(0), AtomicU32::new(0)];
/// What was written to each compare channel's buffer last, in counts.
static SENT: [AtomicU32; CHANNELS] = [const { AtomicU32::new(0) }; CHANNELS];
/// The frame has begun to run and the timer may be touched from anywhere.
static RUNNING: AtomicBool = AtomicBool::new(false);
/// Frames from one tick to the next.
static FRAMES_PER_TICK: AtomicU8 = AtomicU8::new(1);
/// Frames since the last tick.
static FRAMES: AtomicU8 = AtomicU8::new(0);
/// So long after a tick its burst is too late for its step, us: a whole one, and one of the rates
/// alone.
static BURST_LIMITS_US: [AtomicU32; 2] = [AtomicU32::new(0), AtomicU32::new(0)];
/// Longer than any pulse, us.
pub(super) const LONGEST_PULSE_US: u32 = 2_250;

const _: () = assert!(PULSE_MAX_US < LONGEST_PULSE_US as f32);

/// Counts to the ticks before the last of a frame, the first first; where there is one, it twice.
static EARLY_TICKS: [AtomicU32; 2] = [AtomicU32::new(0), AtomicU32::new(0)];
/// The last tick of a frame reads the rates alone.
static IS_SPLIT: AtomicBool = AtomicBool::new(false);
/// The newest tick that the main loop has not seen.
static TICK: Shared<Cell<Option<Tick>>> = Shared::new(Cell::new(None));

/// The running frame.
pub(crate) struct Frame {
    timing: Timing,
    plan: TimerPlan,
    /// Number of servos whose pins the timer has.
    connected: usize,
}

impl Frame {
    /// Start the frame. The first, 20 ms long, is without a pulse; `neutral` follows.
    pub(crate) fn start(
        _clock: &Tcc0Tcc1Clock,
        neutral: [PulseUs; Axis::COUNT],
        timing: Timing,
    ) -> Self {
        set_neutral(neutral, false);
        let plan = TimerPlan::new(COUNTS_PER_US, &timing);
        let timer = frame_registers();
        let mut ready = reset();
        // Pulses go on while a debugger holds the core.
        #[cfg(feature = "probe")]
        timer.dbgctrl().write(|w| w.dbgrun().set_bit());
        ready &= soon(|| timer.syncbusy().read().wave().bit_is_clear());
        // SAFETY: all values are less than the counter's 24 bits hold.
        unsafe {
            timer.per().write(|w| w.bits(plan.period - 1));
            for channel in SERVO_CHANNELS {
                timer.cc(channel % CHANNELS).write(|w| w.bits(0));
            }
            let [last, _, first] = plan.ticks;
            timer.cc(LAST_TICK_CHANNEL).write(|w| w.bits(last));
            timer.cc(EARLY_TICK_CHANNEL).write(|w| w.bits(first));
        }
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        announce(&plan, &timing);
        timer.ctrla().modify(|_, w| w.prescaler().div16().enable().set_bit());
        ready &= soon(|| timer.syncbusy().read().enable().bit_is_clear());
        let mut frame = Self { timing, plan, connected: 0 };
        RUNNING.store(true, Ordering::Release);
        ready &= frame.write(neutral);
        if !ready {
            // Without its timer the board can do nothing for the servo; the reset counts as a crash
            // and is reported.
            crash::stop(SelfCheck::ServoTimer);
        }
        frame
    }

    /// Send `pulses` from the next frame on. `false` if the timer did not take them. A pin is the
    /// timer's from its first pulse on: the second servo's is another's before. From then on it is
    /// never without: a servo whose axis is steered no more is kept at neutral, where without
    /// pulses it would stay as it was.
    #[must_use]
    pub(crate) fn write(&mut self, pulses: [PulseUs; Axis::COUNT]) -> bool {
        let steered = pulses.iter().take_while(|pulse| **pulse != PulseUs::NONE);
        for servo in WIRING.servos.iter().take(steered.count()).skip(self.connected) {
            servo.pin.low();
            servo.pin.connect(servo.function);
            self.connected += 1;
        }
        if watchdog::has_warned() {
            force_neutral();
            return true;
        }
        let channels = SERVO_CHANNELS.iter().zip(&NEUTRAL).take(self.connected);
        channels.zip(pulses).all(|((channel, neutral), pulse)| {
            let counts = match pulse {
                PulseUs::NONE => neutral.load(Ordering::Relaxed),
                pulse => counts(pulse),
            };
            write_buffer(*channel, counts)
        })
    }

    /// Whether the timer has its ticks as they were set, and sends the pulses that it was given
    /// last. Interrupts are held off for some 3 us: they set
    /// the early ticks, and neutral pulses, between one look and the next.
    pub(crate) fn is_as_set(&self) -> bool {
        critical_section::with(|_| self.is_undisturbed_as_set())
    }

    fn is_undisturbed_as_set(&self) -> bool {
        /// STATUS.PERBV.
        const PERIOD_IS_BUFFERED: u32 = 1 << 7;
        let timer = frame_registers();
        let buffers = timer.status().read().bits();
        let is = |channel: usize, counts: u32| {
            let waits = buffers & 1 << (16 + channel) != 0;
            waits || timer.cc(channel % CHANNELS).read().bits() == counts
        };
        let is_sent = SERVO_CHANNELS.iter().take(self.connected).all(|channel| {
            let sent = SENT.get(*channel);
            sent.is_none_or(|sent| is(*channel, sent.load(Ordering::Relaxed)))
        });
        let [last, ..] = self.plan.ticks;
        let mut early = EARLY_TICKS.iter();
        let enabled = timer.intenset().read().bits();
        (buffers & PERIOD_IS_BUFFERED != 0 || timer.per().read().bits() == self.plan.period - 1)
            && is(LAST_TICK_CHANNEL, last)
            && early.any(|tick| is(EARLY_TICK_CHANNEL, tick.load(Ordering::Relaxed)))
            && enabled == wanted_interrupts(&self.plan.plan)
            && is_sent
    }

    /// Whether the timer has the pins of all servos.
    pub(crate) fn has_every_pin(&self) -> bool {
        self.connected == Axis::COUNT
    }

    /// What the ticks are made for.
    pub(crate) fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Time from tick to tick.
    pub(crate) fn tick_period_us(&self) -> u32 {
        self.plan.tick_period_us
    }

    /// Change frame rate and tick lead from the next frame on, all at once, so that no pulse is cut
    /// short. `false` if the timer did not take it.
    #[must_use]
    pub(crate) fn retime(&mut self, timing: Timing) -> bool {
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
            let [last, _, first] = plan.ticks;
            timer.ccb(LAST_TICK_CHANNEL).write(|w| w.bits(last));
            timer.ccb(EARLY_TICK_CHANNEL).write(|w| w.bits(first));
        }
        ready &= soon(|| timer.syncbusy().read().bits() == 0);
        timer.ctrlbclr().write(|w| w.lupd().set_bit());
        ready &= soon(|| timer.syncbusy().read().ctrlb().bit_is_clear());
        announce(&plan, &timing);
        if ready {
            (self.timing, self.plan) = (timing, plan);
        }
        ready
    }
}

/// Tell the interrupt which ticks to expect.
fn announce(plan: &TimerPlan, timing: &Timing) {
    let timer = frame_registers();
    FRAMES_PER_TICK.store(plan.plan.frames_per_tick, Ordering::Relaxed);
    let [whole, rates] = &BURST_LIMITS_US;
    whole.store(timing.burst_limit_us(false), Ordering::Relaxed);
    rates.store(timing.burst_limit_us(true), Ordering::Relaxed);
    IS_SPLIT.store(timing.is_split(), Ordering::Relaxed);
    let [_, middle, first] = plan.ticks;
    for (place, tick) in EARLY_TICKS.iter().zip([first, middle]) {
        place.store(tick, Ordering::Relaxed);
    }
    let all = LAST | EARLY;
    let wanted = wanted_interrupts(&plan.plan);
    // SAFETY: flags that exist, of this module's own channels.
    unsafe {
        timer.intenclr().write(|w| w.bits(all & !wanted));
        timer.intflag().write(|w| w.bits(all & !wanted));
        timer.intenset().write(|w| w.bits(wanted));
    }
}

/// Resets the timer, and has it make pulses of counts of 3 MHz once it runs.
#[inline(never)]
fn reset() -> bool {
    let timer = frame_registers();
    timer.ctrla().write(|w| w.swrst().set_bit());
    let ready = soon(|| timer.syncbusy().read().swrst().bit_is_clear());
    timer.ctrla().write(|w| w.prescaler().div16());
    timer.wave().write(|w| w.wavegen().npwm());
    ready
}

/// Last count of a frame of [`send_pulses`].
const LAST_COUNT: u32 = COUNTS_PER_US * 20_000 - 1;

/// Send these pulses, in counts, 50 times a second without a tick: for an image that is not to do
/// more. Widths that no servo answers to send no pulse. The code that sets the timer up may be
/// damaged: the pulses go out only if the timer's registers read back as meant.
pub(crate) fn send_pulses(counts: [u32; Axis::COUNT]) {
    let timer = frame_registers();
    let mut is_right = reset();
    is_right &= soon(|| timer.syncbusy().read().wave().bit_is_clear());
    // SAFETY: values that the counter's 24 bits hold.
    timer.per().write(|w| unsafe { w.bits(LAST_COUNT) });
    for (channel, counts) in SERVO_CHANNELS.into_iter().zip(counts) {
        // SAFETY: as above.
        timer.cc(channel % CHANNELS).write(|w| unsafe { w.bits(counts & 0xFFFF) });
    }
    is_right &= soon(|| timer.syncbusy().read().bits() == 0);
    timer.ctrla().modify(|_, w| w.prescaler().div16().enable().set_bit());
    is_right &= soon(|| timer.syncbusy().read().enable().bit_is_clear());
    let modes = timer.ctrla().read();
    is_right &= modes.prescaler().is_div16() && modes.enable().bit_is_set();
    is_right &= timer.wave().read().wavegen().is_npwm();
    is_right &= timer.per().read().bits() == LAST_COUNT;
    // The servos come in between two pulses, of which none is cut short. A watchdog whose time-out
    // a flipped bit has made the shortest resets before the first of them.
    time::delay_us(10_000);
    for ((servo, channel), counts) in WIRING.servos.iter().zip(SERVO_CHANNELS).zip(counts) {
        let is_pulse = PULSE_COUNTS.contains(&counts);
        if is_right && is_pulse && timer.cc(channel % CHANNELS).read().bits() == counts {
            servo.pin.low();
            servo.pin.connect(servo.function);
        }
    }
}

/// From [`begin_next`] to the frame that it begins, us.
const BEGIN_US: u32 = 1_000;
/// From [`begin_next`] to the end of the second pulse, us.
pub(super) const SECOND_PULSE_US: u32 = BEGIN_US + 20_000 + LONGEST_PULSE_US;

/// Leaves out what is left of a frame of [`send_pulses`].
pub(crate) fn begin_next() {
    let shortly_before = LAST_COUNT - COUNTS_PER_US * BEGIN_US;
    // SAFETY: as in `send_pulses`.
    frame_registers().count().write(|w| unsafe { w.bits(shortly_before) });
}

/// These pulses are going to be [sent](send_pulses): a fault from here on ends between two of them,
/// too.
pub(crate) fn will_be_sent(counts: [u32; Axis::COUNT]) {
    for (place, counts) in NEUTRAL.iter().zip(counts) {
        place.store(counts, Ordering::Relaxed);
    }
    RUNNING.store(true, Ordering::Release);
}

/// The interrupts of the ticks.
fn wanted_interrupts(plan: &TickPlan) -> u32 {
    if plan.ticks_per_frame > 1 { LAST | EARLY } else { LAST }
}

/// Timer counts of a pulse.
fn counts(pulse: PulseUs) -> u32 {
    COUNTS_PER_US * u32::from(pulse.0)
}

/// `false` for what is no pulse: whatever has made it, no servo is to get it.
fn write_buffer(channel: usize, counts: u32) -> bool {
    let timer = frame_registers();
    // SYNCBUSY.CCBx.
    let synchronises = 1 << (19 + channel);
    let ready = PULSE_COUNTS.contains(&counts)
        && soon(|| timer.syncbusy().read().bits() & synchronises == 0);
    if ready {
        // Both or neither: the watchdog's early warning may write them, too.
        critical_section::with(|_| {
            // SAFETY: a pulse is at most 65,535 us, 196,605 counts; the register has 24 bits.
            timer.ccb(channel % CHANNELS).write(|w| unsafe { w.bits(counts) });
            if let Some(sent) = SENT.get(channel) {
                sent.store(counts, Ordering::Relaxed);
            }
        });
    }
    ready
}

/// What [`force_neutral`] sends. An axis that is steered no more keeps what it had. What a start
/// with a damaged image would send is kept while the vehicle is not armed: in flight the damage may
/// be what has made other pulses of them.
pub(crate) fn set_neutral(pulses: [PulseUs; Axis::COUNT], is_armed: bool) {
    let before = NEUTRAL.each_ref().map(|place| place.load(Ordering::Relaxed));
    let mut now = before;
    for (now, pulse) in now.iter_mut().zip(pulses) {
        if pulse != PulseUs::NONE {
            *now = counts(pulse);
        }
    }
    if now != before {
        for (place, counts) in NEUTRAL.iter().zip(now) {
            place.store(counts, Ordering::Relaxed);
        }
    }
    if !is_armed && now != KEPT.each_ref().map(|place| place.load(Ordering::Relaxed)) {
        for (place, counts) in KEPT.iter().zip(now) {
            place.store(counts, Ordering::Relaxed);
        }
        crash::KeptNeutral::store(now);
    }
}

/// Send the neutral pulses, whoever calls and whatever the main loop was doing.
pub(crate) fn force_neutral() {
    if RUNNING.load(Ordering::Acquire) {
        let timer = frame_registers();
        // A change of the frame rate may have been cut short.
        timer.ctrlbclr().write(|w| w.lupd().set_bit());
        for (channel, counts) in SERVO_CHANNELS.into_iter().zip(&NEUTRAL) {
            // In vain only if the timer itself is broken, and then nothing is left to try.
            let _ = write_buffer(channel, counts.load(Ordering::Relaxed));
        }
    }
}

/// Poll `ready` for the longest frame. Counts the processor's cycles, since the clock stands still
/// where interrupts are held off.
fn within_frame(ready: impl Fn() -> bool) -> bool {
    const STEP_US: u32 = 10;
    const LIMIT_US: u32 = 20_500;
    (0..LIMIT_US / STEP_US).any(|_| {
        time::delay_us(STEP_US);
        ready()
    })
}

/// Whether a frame has begun since that was [forgotten](forget_begin).
pub(crate) fn has_begun() -> bool {
    frame_registers().intflag().read().bits() & OVERFLOW != 0
}

/// From here on [`has_begun`] tells of the next frame.
pub(crate) fn forget_begin() {
    // SAFETY: clears a flag that exists and that no interrupt uses.
    frame_registers().intflag().write(|w| unsafe { w.bits(OVERFLOW) });
}

/// Wait until all pulses of a frame are over, so that a reset cuts none: 23 ms at most.
fn wait_for_gap() {
    forget_begin();
    let _ = within_frame(has_begun);
    time::delay_us(LONGEST_PULSE_US);
}

/// Take the servos' pins from the timer, each between two pulses.
pub(crate) fn end_pulses() {
    for Output { pin, .. } in WIRING.servos {
        if pin.is_connected() {
            let _ = within_frame(|| !pin.is_high());
            pin.low();
            pin.gpio();
        }
    }
}

/// Neutral pulses to the end of this run. The timer is set up anew, since any of its registers may
/// be wrong, and has the servos' pins only between two pulses.
pub(crate) fn end_in_neutral() {
    if RUNNING.load(Ordering::Acquire) {
        end_pulses();
        clock_frame_again();
        send_pulses(NEUTRAL.each_ref().map(|place| place.load(Ordering::Relaxed)));
    }
}

/// Reset the chip, between two pulses where there are any.
pub(crate) fn reset_in_gap() -> ! {
    if RUNNING.load(Ordering::Acquire) {
        wait_for_gap();
    }
    SCB::sys_reset()
}

/// Have the first servo get `pulse`. `false` for one that no servo answers, or if the timer did not
/// take it.
#[cfg(feature = "embedded-hal")]
pub(crate) fn send(pulse: PulseUs) -> bool {
    let ([first, _], counts) = (SERVO_CHANNELS, counts(pulse));
    write_buffer(first, counts)
}

/// Time from pulse to pulse, us.
#[cfg(feature = "embedded-hal")]
pub(crate) fn length_us() -> u16 {
    ((frame_registers().per().read().bits() + 1) / COUNTS_PER_US) as u16
}

/// The newest tick, once.
pub(crate) fn take_tick() -> Option<Tick> {
    hold_ticks(|held| {
        time::seen();
        TICK.borrow(held).take()
    })
}

fn frame_registers() -> &'static pac::tcc0::RegisterBlock {
    // SAFETY: the block is always mapped; this module alone uses it.
    unsafe { &*pac::Tcc0::ptr() }
}

/// A compare channel has matched: start the burst, tell the main loop.
#[interrupt]
fn TCC0() {
    let timer = frame_registers();
    let pending = timer.intflag().read().bits() & timer.intenset().read().bits();
    // SAFETY: clears what has been seen.
    timer.intflag().write(|w| unsafe { w.bits(pending) });
    let last = pending & LAST != 0;
    // The next tick of the channel that two of them share.
    let next = EARLY_TICKS.get(usize::from(!last));
    if let Some(next) = next
        && soon(|| timer.syncbusy().read().bits() & 1 << (8 + EARLY_TICK_CHANNEL) == 0)
    {
        let tick = next.load(Ordering::Relaxed);
        // SAFETY: less than the counter's 24 bits hold.
        timer.cc(EARLY_TICK_CHANNEL).write(|w| unsafe { w.bits(tick) });
    }
    let frames = FRAMES.load(Ordering::Relaxed) + u8::from(last);
    let due = pending & EARLY != 0 || frames >= FRAMES_PER_TICK.load(Ordering::Relaxed);
    FRAMES.store(if last && due { 0 } else { frames }, Ordering::Relaxed);
    if due {
        let at = now();
        let rates_only = last && IS_SPLIT.load(Ordering::Relaxed);
        // SAFETY: this is the tick's interrupt.
        let held = unsafe { TicksHeld::new() };
        i2c::start_burst(held, at, rates_only);
        // The burst's end wakes the main loop, or its being late does.
        if let Some(limit_us) = BURST_LIMITS_US.get(usize::from(rates_only)) {
            time::wake_before(at.after(limit_us.load(Ordering::Relaxed).into()));
        }
        let tick = Tick { at, is_carried: last, rates_only };
        TICK.borrow(held).set(Some(tick));
    }
}
