//! The board as the application uses it: the chip's parts joined, on the wiring of the board that
//! the image is for.

#[cfg(feature = "embedded-hal")]
mod foreign;
mod memory_sum;

use atsamd_hal::pac;
use atsamd_hal::serial_number;
use tvc_imu::{Bursts, Micros, Transfer};
use tvc_nano::application::{self, Event, StepEnd};
use tvc_nano::bringup::Order;
use tvc_nano::bus::Origin;
use tvc_nano::failsafe::BootReport;
use tvc_nano::guard::Sum;
use tvc_nano::params::Params;
use tvc_nano::sampling::Sampling;
use tvc_nano::sensor::Kind;
use tvc_nano::servo::first_pulses;
use tvc_nano::sleep::Load;
use tvc_nano::store::{self, BoardId};
use tvc_nano::telemetry::Reset;
use tvc_nano::{BoardStatus, SelfCheck};

use crate::boards::WIRING;
use crate::samd21::dfll::DfllCheck;
use crate::samd21::engine::Engine;
use crate::samd21::image_check::ImageCheck;
use crate::samd21::registers::Registers;
use crate::samd21::{
    bringup, clocks, crash, flash, frame, i2c, interrupts, log, stack, time, usb, watchdog,
};

/// The running board.
pub(crate) struct Board {
    frame: frame::Frame,
    bus: i2c::Bus,
    port: usb::Port,
    flash: flash::Flash,
    guard: watchdog::WatchdogGuard,
    sampling: Sampling,
    /// The state that the log has told.
    state_code: u32,
    load: Load,
    image: ImageCheck,
    dfll: DfllCheck,
    registers: Registers,
    /// Steps, modulo 256.
    steps: u8,
}

impl Board {
    /// Bring the board up, servo first; the stored parameters, and how the last run ended.
    pub(crate) fn start() -> (Self, Params, BootReport) {
        // A wrong jump may have led here, while the timer runs.
        frame::end_pulses();
        let (Some(mut chip), Some(mut core)) =
            (pac::Peripherals::take(), cortex_m::Peripherals::take())
        else {
            crash::stop(SelfCheck::TakenTwice)
        };
        let starts = crash::count_start(&chip.pm);
        let clocks = clocks::start(chip.gclk, &mut chip.pm, &mut chip.sysctrl, &mut chip.nvmctrl);
        let Some(clocks) = clocks else { crash::stop(SelfCheck::Clock) };
        time::start(&mut core.SYST);
        // Before all else: start-up may hang, too.
        let guard = watchdog::WatchdogGuard::start(chip.wdt);
        clocks::enable_buses(&chip.pm);
        crash::behind_lock_up(&chip.pm, starts);
        let mut flash = flash::Flash::new(chip.nvmctrl);
        let (params, stored) = store::load(&mut flash, BoardId::of(&serial_number()));
        let report = BootReport { crash: crash::report(&chip.pm), stored };
        let engine = Engine::new(chip.dsu, chip.pac1);
        let Some(image) = ImageCheck::new(engine) else { crash::refuse_to_start(SelfCheck::Flash) };
        // Behind the check: a damaged image may have read anything.
        if let Some(fine) = params.clock_fine() {
            clocks::set_fine(fine);
        }
        stack::paint();
        let timing = params.timing();
        let frame = frame::Frame::start(&clocks.frame, first_pulses(&params, stored), timing);
        for pin in WIRING.held_low {
            pin.low();
        }
        light(false);
        WIRING.probe.low();
        clocks::watch_supply(&chip.sysctrl);
        let bus = i2c::Bus::start(timing.i2c_khz);
        let port = usb::Port::start(&clocks.usb, &mut chip.pm, chip.usb);
        interrupts::start(&mut core.SCB);
        guard.settle();
        #[cfg(feature = "embedded-hal")]
        let bus = foreign::show(bus);
        log::started(&report);
        let now = time::now();
        let board = Self {
            frame,
            bus,
            port,
            flash,
            guard,
            sampling: Sampling::new(now),
            state_code: u32::MAX,
            load: Load::new(now),
            image,
            dfll: DfllCheck::new(),
            registers: Registers::new(),
            steps: 0,
        };
        (board, params, report)
    }

    /// Sleep until there is something to do: an event, the host, or the loop's next turn, which is
    /// due at `turn` at the latest.
    pub(crate) fn wait(&mut self, turn: Micros) -> (Micros, Event) {
        loop {
            let burst_due = self.sampling.burst_due().unwrap_or(Micros(u64::MAX));
            let (now, asleep) = time::sleep_until(burst_due, turn);
            self.load.slept(asleep);
            let event = self.event(now);
            if !matches!(event, Event::Nothing) || usb::needs_care() || time::is_near(turn) {
                return (now, event);
            }
        }
    }

    /// Put right what can be, of the registers that make pulses and interrupts, and stop where
    /// something else is not as it was set.
    fn check_registers(&mut self) {
        if let Err(check) = self.dfll.look() {
            crash::stop(check);
        }
        if !self.registers.look() || !self.frame.is_as_set() {
            crash::stop(SelfCheck::Registers);
        }
    }

    fn event(&mut self, now: Micros) -> Event {
        if let Some(tick) = frame::take_tick() {
            self.guard.work.tick_seen();
            if let Some(overtaken) = self.sampling.tick(tick, self.frame.timing()) {
                return overtaken;
            }
        }
        let due = self.sampling.burst_due();
        if let Some(completion) = self.bus.poll(now, due) {
            // While the sensor is set up, nothing is more urgent than the STOP.
            if !self.bus.is_sampling() || completion.origin != Origin::Loop && self.is_hurried(now)
            {
                self.bus.await_stop(&completion, due);
            }
            return self.sampling.over(completion, self.frame.timing());
        }
        self.sampling.none_over(now).unwrap_or_else(|check| crash::stop(check))
    }

    fn is_hurried(&self, now: Micros) -> bool {
        let (timing, period_us) = (self.frame.timing(), self.frame.tick_period_us());
        self.sampling.is_hurried(now, self.bus.stop_us(), timing, period_us)
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

    fn has_time_for(&self, transfer: &Transfer, sensor: Kind) -> bool {
        let (timing, period_us) = (self.frame.timing(), self.frame.tick_period_us());
        let stop_us = self.bus.stop_us();
        self.sampling.leaves_time_for(
            time::now(),
            transfer,
            stop_us,
            &timing.with(sensor),
            period_us,
        )
    }

    fn begin(&mut self, address: u8, transfer: Transfer) {
        self.bus.begin(address, &transfer);
    }

    /// The probe pin is high during a step, for whoever measures it.
    fn step_begins(&mut self) {
        WIRING.probe.high();
    }

    fn carried_tick(&self) -> Micros {
        self.sampling.carried_at()
    }

    fn step_ends(&mut self, end: &StepEnd) {
        self.guard.work.frame_begun(frame::has_begun());
        let every_pin = self.frame.has_every_pin();
        let taken = self.frame.write(end.pulses);
        if self.frame.has_every_pin() != every_pin {
            self.registers.renew_servos();
        }
        WIRING.probe.low();
        self.check_registers();
        if !self.image.go_on() {
            crash::stop(SelfCheck::Flash);
        }
        self.guard.work.step_done(taken);
        let now = time::now();
        self.guard.check(now);
        self.load.update(now);
        self.steps = self.steps.wrapping_add(1);
        let is_armed = end.state.is_armed();
        flash::hold(is_armed);
        frame::set_neutral(end.neutral, is_armed);
        if end.timing.i2c_khz != self.frame.timing().i2c_khz {
            self.sampling.speed_changes();
        }
        // Where the timer does not take it, the next step tries again.
        let _ = self.frame.retime(end.timing);
        let code = end.state.code();
        if core::mem::replace(&mut self.state_code, code) != code {
            log::state(&end.state);
        }
        light(end.led);
    }

    fn status(&self) -> BoardStatus {
        BoardStatus {
            load_permille: self.load.permille(),
            bus_errors: self.sampling.errors(),
            bus_recoveries: self.bus.recoveries(),
            bursts: self.sampling.times(),
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
        self.sampling.halted();
        &mut self.flash
    }

    fn reset_soon(&mut self, now: Micros, reset: Reset) {
        self.port.reset_soon(now, reset);
    }

    fn stop(&mut self, check: SelfCheck) {
        crash::stop(check)
    }

    fn bringup(&mut self, order: Order) -> Option<u32> {
        bringup::obey(order, &self.bus, self.image.engine_us(), self.frame.has_every_pin())
    }
}

fn light(lit: bool) {
    if let Some(led) = WIRING.led {
        led.set(lit);
    }
}
