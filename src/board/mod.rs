//! The board: clocks, sensor bus, servo, USB, watchdog, and what is left after a crash. The only place that names a
//! register.
//!
//! # Interrupts
//! | priority | interrupt | does |
//! |---|---|---|
//! | 0 (highest) | SysTick, 1 kHz | counts time; wakes the main loop |
//! | 1 | TCC0 | the tick: starts the armed burst |
//! | 1 | SERCOM4 | the sensor bus, a byte at a time |
//! | 1 | WDT | early warning: the servo to neutral |
//! | 3 | USB | masks itself; wakes the main loop |
//!
//! Nothing above the main loop takes more than some 10 us, so a tick's burst starts within a few microseconds of its
//! compare match. The longest that interrupts are held off is a call into the USB controller's driver, about 50 us.
//!
//! # No endless waits
//! Every wait for hardware is bounded but two, both at start-up before the first pulse and before the watchdog runs: the
//! HAL's for the oscillators (see [`clocks`]) and for the USB controller's reset, which the same clocks drive.

mod clocks;
mod crash;
mod flash;
mod i2c;
mod log;
mod nano33iot;
mod pin;
mod servo;
mod stack;
mod time;
mod usb;
mod watchdog;

use atsamd_hal::gpio::Pins;
use atsamd_hal::pac;
use bno055_driver::{BusError, Driver, Micros, Next, Transfer};
use cortex_m::peripheral::scb::SystemHandler;
use tvc_nano::failsafe::{BootReport, State};
use tvc_nano::flight::Flight;
use tvc_nano::params::Params;
use tvc_nano::servo::PulseUs;
use tvc_nano::store;
use tvc_nano::telemetry::{BoardStatus, Telemetry};

use nano33iot::{FRAME_INTERRUPT, I2C_INTERRUPT, LED, PROBE, RADIO_RESET};

/// Between the last moment at which a burst may come home and the edge of its pulse: the step, with a reserve.
const STEP_BUDGET_US: u32 = 1_200;

/// Clock stretching of a byte that is allowed for when a short transfer is put between two bursts. A chip in health
/// needs 180 us; should it take longer for once, the next tick goes without its burst.
const STRETCH_US: u64 = 250;

/// Longest time between two looks at the deadlines; SysTick wakes the processor often enough.
const NAP_US: u64 = 1_000;

/// Load is measured over this long.
const LOAD_PERIOD_US: u64 = 1_000_000;

/// What the board wakes up for.
pub(crate) enum Event {
    /// The tick's burst is over, before the tick was given up: its step has not been taken yet.
    Burst(Outcome),
    /// The tick has no burst, or not in time: the step goes without a sample.
    Missed,
    /// A burst whose step has gone by is over.
    Late(Outcome),
    /// Another transfer is over.
    Reply(Outcome),
    /// Nothing for the flight.
    Nothing,
}

/// How a transfer ended.
pub(crate) struct Outcome(i2c::Completion);

impl Outcome {
    /// When it started.
    pub(crate) fn started(&self) -> Micros {
        self.0.started
    }

    /// What was read: nothing, for a write.
    pub(crate) fn bytes(&self) -> Result<&[u8], BusError> {
        match &self.0.outcome {
            Ok(answer) => Ok(answer),
            Err(error) => Err(*error),
        }
    }
}

/// The running board.
pub(crate) struct Board {
    servo: servo::Servo,
    bus: i2c::Bus,
    port: usb::Port,
    port_open: bool,
    flash: flash::Flash,
    supervisor: watchdog::Supervisor,
    /// When the newest tick came.
    ticked: Micros,
    /// When the tick's burst, begun or not, is too late for its step.
    burst_due: Option<Micros>,
    /// The state that the log has told.
    state_code: u32,
    bus_errors: u16,
    load: Load,
}

impl Board {
    /// Bring the board up, servo first; the stored parameters, and how the last run ended. `address` is the sensor's.
    pub(crate) fn start(address: u8) -> (Self, Params, BootReport) {
        let mut chip = pac::Peripherals::take().expect("started once");
        let mut core = cortex_m::Peripherals::take().expect("started once");
        let clocks = clocks::start(
            chip.gclk,
            &mut chip.pm,
            &mut chip.sysctrl,
            &mut chip.nvmctrl,
        );
        let mut flash = flash::Flash::new(chip.nvmctrl);
        let (params, stored) = store::load(&mut flash);
        let report = BootReport {
            crash: crash::report(&chip.pm),
            stored,
        };
        stack::paint();
        time::start(&mut core.SYST);
        nano33iot::enable_bus_clocks(&mut chip.pm);
        let (frame_hz, i2c_khz) = params.rates();
        let servo = servo::Servo::start(
            &clocks.servo,
            tvc_nano::servo::neutral(&params),
            frame_hz,
            i2c_khz,
        );
        RADIO_RESET.low();
        LED.low();
        PROBE.low();
        clocks::watch_supply(&chip.sysctrl);
        let bus = i2c::Bus::start(address, i2c_khz);
        let pins = Pins::new(chip.port);
        let port = usb::Port::start(&clocks.usb, &mut chip.pm, pins.pa24, pins.pa25, chip.usb);
        let supervisor = watchdog::Supervisor::start(chip.wdt);
        enable_interrupts(&mut core.SCB, &mut core.NVIC);
        log::started(&report);
        let now = time::now();
        let board = Self {
            servo,
            bus,
            port,
            port_open: false,
            flash,
            supervisor,
            ticked: now,
            burst_due: None,
            state_code: u32::MAX,
            bus_errors: 0,
            load: Load {
                since: now,
                asleep_us: 0,
                permille: 0,
            },
        };
        (board, params, report)
    }

    /// Sleep until there is something to do, or [`NAP_US`] have passed: deadlines want to be looked at.
    // A function of its own, as `exchange` and the USB port's `start` are: 0.4 KB less flash.
    #[inline(never)]
    pub(crate) fn wait(&mut self) -> (Micros, Event) {
        let until = time::now().after(NAP_US);
        while self.nap() < until {}
        let now = time::now();
        self.load.update(now);
        self.supervisor.pulse_sent(self.servo.is_sent());
        self.supervisor.check(now);
        (now, self.event(now))
    }

    /// Sleep until the next interrupt, unless there is something to do: then it is late.
    fn nap(&mut self) -> Micros {
        critical_section::with(|cs| {
            if servo::tick_waits(cs) || i2c::outcome_waits() || usb::is_pending() {
                return Micros(u64::MAX);
            }
            let began = time::now();
            // Wakes at any interrupt, which runs when this section ends: none can slip in before the sleep.
            cortex_m::asm::wfi();
            let woke = time::now();
            self.load.asleep_us += woke.since(began);
            woke
        })
    }

    fn event(&mut self, now: Micros) -> Event {
        if let Some(tick) = servo::take_tick() {
            self.supervisor.tick_seen();
            self.ticked = tick;
            self.burst_due = Some(tick.after(self.servo.burst_limit_us()));
        }
        if let Some(completion) = self.bus.poll(now) {
            self.bus_errors = self
                .bus_errors
                .saturating_add(u16::from(completion.outcome.is_err()));
            let origin = completion.origin;
            let outcome = Outcome(completion);
            return match origin {
                i2c::Origin::Loop => Event::Reply(outcome),
                i2c::Origin::Tick if self.burst_due.take().is_some() => Event::Burst(outcome),
                i2c::Origin::Tick => Event::Late(outcome),
            };
        }
        if self.burst_due.is_some_and(|due| now >= due) {
            self.burst_due = None;
            return Event::Missed;
        }
        Event::Nothing
    }

    /// Mark the start of a step for whoever watches the probe pin.
    pub(crate) fn step_begins(&self) {
        PROBE.high();
    }

    /// Send the step's pulse with the next frame, and take over what else it may have changed.
    pub(crate) fn step_ends(&mut self, pulse: PulseUs, flight: &Flight) {
        // A step that comes just before every edge would never let the loop see the buffer empty.
        self.supervisor.pulse_sent(self.servo.is_sent());
        let taken = self.servo.write(pulse);
        PROBE.low();
        self.supervisor.step_done(taken);
        self.configure(flight);
        let state = flight.state();
        if core::mem::replace(&mut self.state_code, state.code()) != state.code() {
            log::state(&state);
        }
        if lit(&state, self.ticked) {
            LED.high();
        } else {
            LED.low();
        }
    }

    /// Take over the neutral pulse and the timing. The flight changes the rates only while disarmed.
    fn configure(&mut self, flight: &Flight) {
        servo::set_neutral(flight.neutral());
        let (frame_hz, i2c_khz) = flight.params().rates();
        // Where the timer does not take it, the next step tries again.
        let _ = self.servo.retime(frame_hz, i2c_khz);
    }

    /// Give the sensor's driver what it asks for next, between bursts.
    pub(crate) fn serve_sensor(&mut self, now: Micros, driver: &mut Driver) {
        let sampling = driver.is_sampling();
        self.bus.arm(sampling.then(|| driver.burst()));
        if !self.bus.is_free() {
            return;
        }
        self.bus.set_speed(self.servo.i2c_khz());
        if let Next::Transfer(transfer) = driver.next(now)
            && (!sampling
                || now.after(duration_us(&transfer, self.servo.i2c_khz())) < self.next_tick())
        {
            self.bus.begin(transfer);
        }
    }

    fn next_tick(&self) -> Micros {
        self.ticked.after(self.servo.tick_period_us())
    }

    /// Hand over what the host sent and what it has room for.
    #[inline(never)]
    pub(crate) fn exchange(&mut self, now: Micros, telemetry: &mut Telemetry, flight: &mut Flight) {
        self.port.poll(now, flight.state().is_armed());
        let was_open = core::mem::replace(&mut self.port_open, self.port.is_open());
        if !self.port_open {
            // Nobody listens: whoever comes next wants the present, not the past.
            telemetry.sent(telemetry.pending().len());
            return;
        }
        if !was_open {
            // A new listener hears the state again.
            telemetry.restart();
        }
        let mut packet = [0; usb::PACKET_BYTES as usize];
        telemetry.receive(now, self.port.read(&mut packet), flight);
        // A burst under way would be cut in two.
        if self.bus.is_free() {
            telemetry.serve_storage(&mut self.flash, flight);
        }
        if let Some(reset) = telemetry.take_reset() {
            self.port.reset_soon(now, reset);
        }
        let count = self.port.write(telemetry.pending());
        telemetry.sent(count);
    }

    /// What SYS_STATUS tells of the board.
    pub(crate) fn status(&self) -> BoardStatus {
        BoardStatus {
            load_permille: self.load.permille,
            bus_errors: self.bus_errors,
            bus_recoveries: self.bus.recoveries(),
        }
    }
}

/// How busy the processor is.
struct Load {
    since: Micros,
    asleep_us: u64,
    permille: u16,
}

impl Load {
    fn update(&mut self, now: Micros) {
        let elapsed_us = now.since(self.since);
        if elapsed_us >= LOAD_PERIOD_US {
            let awake_us = elapsed_us.saturating_sub(self.asleep_us);
            self.permille = (awake_us as u32 / (elapsed_us as u32 / 1_000)) as u16;
            (self.since, self.asleep_us) = (now, 0);
        }
    }
}

/// So long may `transfer` take.
fn duration_us(transfer: &Transfer, i2c_khz: u32) -> u64 {
    let payload = match transfer {
        Transfer::Read { len, .. } => usize::from(*len),
        Transfer::Write { bytes, .. } => bytes.len(),
    };
    // Two addresses and the register's number.
    let bits_us = if i2c_khz < 400 { 90 } else { 23 };
    (payload as u64 + 3) * (bits_us + STRETCH_US)
}

/// The LED: lit while armed or active, slow while all is well, fast in a fault, short flashes while starting.
fn lit(state: &State, now: Micros) -> bool {
    // Units of 8 ms.
    let phase = (now.0 >> 13) as u32 % 128;
    match state {
        State::Armed | State::Active { .. } => true,
        State::Standby => phase < 64,
        State::Failsafe(_) | State::Latched(_) => phase % 16 < 8,
        State::Boot | State::SelfTest(_) => phase < 8,
    }
}

fn enable_interrupts(scb: &mut pac::SCB, nvic: &mut pac::NVIC) {
    /// Four levels, in the upper two bits.
    const fn priority(level: u8) -> u8 {
        level << 6
    }
    // SAFETY: set once, before any of them is enabled; critical sections mask all alike.
    unsafe {
        scb.set_priority(SystemHandler::SysTick, priority(0));
        for (interrupt, level) in [
            (FRAME_INTERRUPT, 1),
            (I2C_INTERRUPT, 1),
            (pac::Interrupt::WDT, 1),
            (pac::Interrupt::USB, 3),
        ] {
            nvic.set_priority(interrupt, priority(level));
            pac::NVIC::unmask(interrupt);
        }
    }
}
