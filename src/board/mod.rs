//! The board: clocks, sensor bus, servo, USB, watchdog, and what is left after a crash. The only
//! place that names a register.
//!
//! # Interrupts
//! | priority | interrupt | does |
//! |---|---|---|
//! | 0 (highest) | SysTick, 1 kHz | counts time; resets a program that hangs, between two pulses |
//! | 0 | WDT | early warning: the servo to neutral, whatever else hangs but SysTick's own handler. Looks at no clock |
//! | 1 | TCC0 | the tick: starts the armed burst, wakes the main loop |
//! | 1 | SERCOM4 | the sensor bus, a byte at a time; wakes the main loop behind the last |
//! | 3 | USB | masks itself; wakes the main loop |
//!
//! Nothing above the main loop takes more than some 10 us, so a tick's burst starts within a few
//! microseconds of its compare match. Interrupts are held off for single looks at what is shared
//! with them: some microseconds.
//!
//! # No endless waits
//! Every wait for hardware is bounded but one, at start-up before the first pulse and before the
//! watchdog runs: the HAL's for the oscillators (see [`clocks`]).
//!
//! # No panics
//! What cannot go on stops with a reason ([`crash::stop`]): the servo goes to neutral, the chip is
//! reset, and the next run tells why. No call of a panic is linked into the image, which tests hold
//! (`tests/image/symbols.rs`): what could divide by zero, index out of bounds or unwrap nothing is
//! written so that it cannot.

mod bringup;
mod clock_check;
mod clocks;
pub(crate) mod crash;
mod flash;
mod frame;
mod i2c;
mod image_check;
mod log;
mod memory_sum;
mod nano33iot;
mod pin;
mod stack;
mod time;
mod usb;
mod wake;
mod watchdog;

use atsamd_hal::pac;
use atsamd_hal::serial_number;
use cortex_m::peripheral::scb::SystemHandler;
use tvc_imu::{Bursts, Micros, Transfer};
use tvc_nano::application::{self, Event, StepEnd};
use tvc_nano::bringup::Order;
use tvc_nano::failsafe::BootReport;
use tvc_nano::guard::Sum;
use tvc_nano::params::Params;
use tvc_nano::servo::first_pulses;
use tvc_nano::sleep::Load;
use tvc_nano::store::{self, BoardId};
use tvc_nano::telemetry::Reset;
use tvc_nano::ticks::{BurstGauge, NewestTick};
use tvc_nano::{BoardStatus, SelfCheck};

use clock_check::ClockCheck;
use image_check::ImageCheck;
use nano33iot::{FRAME_INTERRUPT, I2C_INTERRUPT, LED, PROBE, RADIO_RESET};

/// Longest time that a step takes, us.
const STEP_US: u64 = 900;

/// Whole bursts that a row or page of flash may spoil, erased or written within 6 ms.
const HALTED_BURSTS: u8 = 2;

/// The running board.
pub(crate) struct Board {
    frame: frame::Frame,
    bus: i2c::Bus,
    port: usb::Port,
    flash: flash::Flash,
    guard: watchdog::WatchdogGuard,
    tick: NewestTick,
    carried_at: Micros,
    /// The state that the log has told.
    state_code: u32,
    bus_errors: u16,
    bursts: BurstGauge,
    /// Bursts that may lie in a time for which the processor stood still, to write its flash: they
    /// say nothing of the sensor.
    halted: u8,
    load: Load,
    image: ImageCheck,
    clocks: ClockCheck,
    /// Steps, modulo 256.
    steps: u8,
}

impl Board {
    /// Bring the board up, servo first; the stored parameters, and how the last run ended.
    pub(crate) fn start() -> (Self, Params, BootReport) {
        let (Some(mut chip), Some(mut core)) =
            (pac::Peripherals::take(), cortex_m::Peripherals::take())
        else {
            crash::stop(SelfCheck::TakenTwice)
        };
        crash::count_start(&chip.pm);
        let clocks = clocks::start(
            chip.gclk,
            &mut chip.pm,
            &mut chip.sysctrl,
            &mut chip.nvmctrl,
        );
        let Some(clocks) = clocks else {
            crash::stop(SelfCheck::Clock)
        };
        time::start(&mut core.SYST);
        // Before all else: start-up may hang, too.
        let guard = watchdog::WatchdogGuard::start(chip.wdt);
        let mut flash = flash::Flash::new(chip.nvmctrl);
        let (params, stored) = store::load(&mut flash, BoardId::of(&serial_number()));
        let report = BootReport {
            crash: crash::report(&chip.pm),
            stored,
        };
        nano33iot::enable_bus_clocks(&mut chip.pm);
        let Some(image) = ImageCheck::new() else {
            crash::refuse_to_start(SelfCheck::Flash)
        };
        // Behind the check: a damaged image may have read anything.
        if let Some(fine) = params.clock_fine() {
            clocks::set_fine(&chip.sysctrl, fine);
        }
        stack::paint();
        let timing = params.timing();
        let frame = frame::Frame::start(&clocks.frame, first_pulses(&params, stored), timing);
        RADIO_RESET.low();
        LED.low();
        PROBE.low();
        clocks::watch_supply(&chip.sysctrl);
        let bus = i2c::Bus::start(timing.i2c_khz);
        let port = usb::Port::start(&clocks.usb, &mut chip.pm, chip.usb);
        // SAFETY: set once, before any of them is enabled; critical sections mask all alike.
        unsafe { core.SCB.set_priority(SystemHandler::SysTick, priority(0)) };
        enable_interrupts();
        enable(pac::Interrupt::USB, 3);
        log::started(&report);
        let now = time::now();
        let board = Self {
            frame,
            bus,
            port,
            flash,
            guard,
            tick: NewestTick::new(now),
            carried_at: now,
            state_code: u32::MAX,
            bus_errors: 0,
            bursts: BurstGauge::default(),
            halted: 0,
            load: Load::new(now),
            image,
            clocks: ClockCheck::new(),
            steps: 0,
        };
        (board, params, report)
    }

    /// Sleep until there is something to do: an event, the host, or the loop's next turn, which is
    /// due at `turn` at the latest.
    // A function of its own, as the USB port's `start` is: 0.4 KB less flash.
    #[inline(never)]
    pub(crate) fn wait(&mut self, turn: Micros) -> (Micros, Event) {
        loop {
            if !self.image.look_on() {
                crash::stop(SelfCheck::Flash);
            }
            let burst_due = self.tick.burst_due().unwrap_or(Micros(u64::MAX));
            let (now, asleep) = time::sleep_until(burst_due, turn);
            self.load.slept(asleep);
            let event = self.event(now);
            if !matches!(event, Event::Nothing) || usb::needs_care() || time::is_near(turn) {
                return (now, event);
            }
        }
    }

    /// Whether `transfer`, begun at `start`, is over before the next tick.
    fn leaves_time_for(&self, start: Micros, transfer: &Transfer) -> bool {
        let (timing, period_us) = (self.frame.timing(), self.frame.tick_period_us());
        // What the 21 bytes of a burst vary by may be one byte that is stretched for long.
        let reserve_us = self.bus.stop_us() + self.bursts.times().spread_us();
        self.tick
            .leaves_time_for(start, transfer, timing, reserve_us, period_us)
    }

    /// Whether a sensor is so slow that a register can be read back only in front of the step, and
    /// not behind it.
    fn is_hurried(&self, now: Micros) -> bool {
        const ONE_REGISTER: Transfer = Transfer::Read {
            register: 0,
            len: 1,
        };
        let fits = |start| self.leaves_time_for(start, &ONE_REGISTER);
        !fits(now.after(STEP_US)) && fits(now.after(self.bus.stop_us().into()))
    }

    /// Put right what can be, of the registers that make pulses and interrupts, and stop where
    /// something else is not as it was set.
    fn check_registers(&mut self) {
        if let Err(check) = self.clocks.put_right() {
            crash::stop(check);
        }
        self.frame.connect_again();
        self.bus.connect_again();
        usb::point_at_banks();
        enable_interrupts();
        time::keep_running();
        if !self.frame.is_as_set() || !self.guard.is_as_set() {
            crash::stop(SelfCheck::Registers);
        }
    }

    fn event(&mut self, now: Micros) -> Event {
        if let Some(tick) = frame::take_tick() {
            self.guard.work.tick_seen();
            let timing = self.frame.timing();
            let is_overtaken = self.tick.came(tick.at, tick.alone, timing);
            if tick.is_carried {
                self.carried_at = before(tick.at, timing.later_us(tick.alone));
            }
            if is_overtaken {
                return Event::Missed;
            }
        }
        if let Some(completion) = self.bus.poll(now, self.tick.burst_due()) {
            // While the sensor is set up, nothing is more urgent than the STOP.
            let is_burst = completion.origin != i2c::Origin::Loop;
            if !self.bus.is_sampling() || is_burst && self.is_hurried(now) {
                self.bus.await_stop(&completion, self.tick.burst_due());
            }
            let i2c::Completion {
                origin,
                mut outcome,
                took_us,
            } = completion;
            let alone = origin == i2c::Origin::Tick { alone: true };
            let later_us = self.frame.timing().later_us(alone);
            outcome.started = before(outcome.started, later_us);
            match (origin, outcome.result) {
                (i2c::Origin::Tick { alone: false }, Ok(())) => {
                    if self.halted > 0 {
                        self.halted -= 1;
                    } else {
                        self.bursts.add(took_us);
                    }
                }
                (_, Err(_)) => self.bus_errors = self.bus_errors.saturating_add(1),
                (_, Ok(())) => {}
            }
            return match origin {
                i2c::Origin::Loop => Event::Reply(outcome),
                i2c::Origin::Tick { .. } if self.tick.burst_over() => Event::Burst(outcome),
                i2c::Origin::Tick { .. } => Event::Late(outcome),
            };
        }
        if self.tick.is_missed(now) {
            Event::Missed
        } else if self.tick.is_lost(now) {
            crash::stop(SelfCheck::Registers)
        } else {
            Event::Nothing
        }
    }
}

impl Sum for Board {
    fn sum<T>(&self, value: &T) -> u32 {
        memory_sum::of(value)
    }
}

impl application::Board for Board {
    type Flash = flash::Flash;

    fn answer(&self) -> &[u8] {
        self.bus.answer()
    }

    /// A bus that is free takes over a changed speed, too.
    fn arm(&mut self, bursts: &Bursts) {
        self.bus.arm(bursts);
        self.bus.set_speed_when_free(self.frame.timing().i2c_khz);
    }

    fn bus(&self) -> application::Bus {
        self.bus.state()
    }

    fn has_time_for(&self, transfer: &Transfer) -> bool {
        self.leaves_time_for(time::now(), transfer)
    }

    fn begin(&mut self, transfer: Transfer) {
        self.bus.begin(&transfer);
    }

    /// The probe pin is high during a step, for whoever measures it.
    fn step_begins(&mut self) {
        PROBE.high();
    }

    fn carried_tick(&self) -> Micros {
        self.carried_at
    }

    fn step_ends(&mut self, end: &StepEnd) {
        // A step that comes just before every edge would never let the loop see the buffer empty.
        self.guard.work.pulse_sent(self.frame.is_sent());
        let taken = self.frame.write(end.pulses);
        PROBE.low();
        self.check_registers();
        self.guard.work.step_done(taken);
        let now = time::now();
        self.guard.check(now);
        self.load.update(now);
        self.steps = self.steps.wrapping_add(1);
        frame::set_neutral(end.neutral, end.state.is_armed());
        // Where the timer does not take it, the next step tries again.
        let _ = self.frame.retime(end.timing);
        let code = end.state.code();
        if core::mem::replace(&mut self.state_code, code) != code {
            log::state(&end.state);
        }
        if end.led {
            LED.high();
        } else {
            LED.low();
        }
    }

    fn status(&self) -> BoardStatus {
        BoardStatus {
            load_permille: self.load.permille(),
            bus_errors: self.bus_errors,
            bus_recoveries: self.bus.recoveries(),
            bursts: self.bursts.times(),
            stop_us: self.bus.stop_us(),
            // The clock is looked at every second or two.
            clock_fine: (self.steps == 0 && self.port.port() != application::Port::Absent)
                .then(clocks::locked_fine)
                .flatten(),
        }
    }

    fn poll_port(&mut self, now: Micros, armed: bool) -> application::Port {
        self.port.poll(now, armed);
        self.port.port()
    }

    fn read(&mut self) -> &[u8] {
        self.port.read()
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        self.port.write(bytes)
    }

    fn flash(&mut self) -> &mut flash::Flash {
        self.halted = HALTED_BURSTS;
        &mut self.flash
    }

    fn reset_soon(&mut self, now: Micros, reset: Reset) {
        self.port.reset_soon(now, reset);
    }

    fn stop(&mut self, check: SelfCheck) {
        crash::stop(check)
    }

    fn bringup(&mut self, order: Order) -> Option<u32> {
        bringup::obey(order, &self.bus, self.frame.has_every_pin())
    }
}

fn before(at: Micros, us: u32) -> Micros {
    Micros(at.0.saturating_sub(us.into()))
}

/// Of four levels, in the upper two bits.
const fn priority(level: u8) -> u8 {
    level << 6
}

/// Enable the interrupts of the flight, with the priorities that the table above says; also those
/// that are enabled already. USB's is masked now and then.
fn enable_interrupts() {
    enable(FRAME_INTERRUPT, 1);
    enable(I2C_INTERRUPT, 1);
    enable(pac::Interrupt::WDT, 0);
}

fn enable(interrupt: pac::Interrupt, level: u8) {
    // SAFETY: nobody else sets priorities, and critical sections mask all interrupts alike.
    unsafe {
        let mut nvic = cortex_m::Peripherals::steal().NVIC;
        nvic.set_priority(interrupt, priority(level));
        pac::NVIC::unmask(interrupt);
    }
}
