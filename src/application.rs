//! The application: what the main loop does with each event, apart from the hardware that it does
//! it with.
//!
//! [`Application::turn`] joins the sensor's driver, [`Flight`], [`Telemetry`] and [`Recorder`]. The
//! chip's board and the tests' stand in for [`Board`].

use core::ops::Deref;

use bno055_driver::{BusError, Driver, Micros, Next, RawSample, SensorFault, Transfer};
use embedded_storage::nor_flash::NorFlash;

use crate::board_status::BoardStatus;
use crate::bringup;
use crate::failsafe::State;
use crate::flight::{Flight, Snapshot};
use crate::led;
use crate::recorder::Recorder;
use crate::servo::PulseUs;
use crate::telemetry::{Reset, Telemetry};
use crate::ticks::Timing;

/// Longest packet that the host sends, bytes.
pub const PACKET_BYTES: usize = 64;

/// What the main loop wakes up for. `A` holds the bytes of a transfer's answer.
#[derive(Clone, Copy, Debug)]
pub enum Event<A> {
    /// The tick's burst is over, and its step still to come.
    Burst(Outcome<A>),
    /// The tick has no burst, or not in time: its step goes without a sample.
    Missed,
    /// A burst is over whose step has been taken without it.
    Late(Outcome<A>),
    /// Another transfer is over.
    Reply(Outcome<A>),
    /// Nothing for the flight.
    Nothing,
}

/// How a transfer ended.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<A> {
    /// When it was started.
    pub started: Micros,
    /// What was read: nothing, for a write.
    pub answer: Result<A, BusError>,
}

impl<A: Deref<Target = [u8]>> Outcome<A> {
    fn bytes(&self) -> Result<&[u8], BusError> {
        self.answer.as_deref().map_err(|error| *error)
    }
}

/// What a step asks of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepEnd {
    /// The pulse of the next frame.
    pub pulse: PulseUs,
    /// The pulse that a crash sends.
    pub neutral: PulseUs,
    /// Servo frame and sensor bus. The flight changes them only while disarmed.
    pub timing: Timing,
    /// Where the flight stands.
    pub state: State,
    /// Whether the LED is lit.
    pub led: bool,
}

/// What the host says of its port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// There is no host.
    Absent,
    /// There is one, which does not say that a program has opened the port (DTR is low). Some
    /// programs, on Windows above all, never say it: their frames show it.
    Silent,
    /// A program has opened the port.
    Open,
}

/// The hardware, as far as the application uses it. Nothing here waits.
pub trait Board {
    /// Where parameters are stored.
    type Flash: NorFlash;

    /// Have every tick start `burst`, to the 7-bit address; `None` has them start nothing.
    fn arm(&mut self, address: u8, burst: Option<Transfer>);

    /// Whether a transfer can be begun: none is under way, on its way to its STOP, or waits to be
    /// collected.
    fn bus_is_free(&self) -> bool;

    /// Whether `transfer`, begun now, is over before the next tick.
    fn has_time_for(&self, transfer: &Transfer) -> bool;

    /// Start `transfer` on the free bus, to the address that was armed last.
    fn begin(&mut self, transfer: Transfer);

    /// A control step begins.
    fn step_begins(&mut self);

    /// When the newest tick came whose step a pulse carries: the last one in its frame.
    fn carried_tick(&self) -> Micros;

    /// A control step is over.
    fn step_ends(&mut self, end: &StepEnd);

    /// What SYS_STATUS tells of the board.
    fn status(&self) -> BoardStatus;

    /// Look after the port to the host. A vehicle that is `armed` is not reset.
    fn poll_port(&mut self, now: Micros, armed: bool) -> Port;

    /// The host's next packet, empty if there is none.
    fn read<'a>(&mut self, packet: &'a mut [u8; PACKET_BYTES]) -> &'a [u8];

    /// Hand over as much of `bytes` as there is room for; says how many.
    fn write(&mut self, bytes: &[u8]) -> usize;

    /// Where parameters are stored.
    fn flash(&mut self) -> &mut Self::Flash;

    /// Reset once the host has been answered, unless the vehicle is armed by then.
    fn reset_soon(&mut self, now: Micros, reset: Reset);

    /// Do what `tvc bringup` orders, and give the answer's value; `None` for what there is not.
    fn bringup(&mut self, order: bringup::Order) -> Option<u32>;
}

/// All that runs on the board.
#[derive(Debug)]
pub struct Application<'a> {
    driver: &'a mut Driver,
    flight: &'a mut Flight,
    telemetry: &'a mut Telemetry,
    recorder: &'a mut Recorder,
    port_open: bool,
}

impl<'a> Application<'a> {
    /// At start-up.
    pub fn new(
        driver: &'a mut Driver,
        flight: &'a mut Flight,
        telemetry: &'a mut Telemetry,
        recorder: &'a mut Recorder,
    ) -> Self {
        Self {
            driver,
            flight,
            telemetry,
            recorder,
            port_open: false,
        }
    }

    /// Once round the loop: read, step, write, send.
    // A function of its own: what `main` holds for ever in registers is then not in its way. 3.4 KB
    // less flash.
    #[inline(never)]
    pub fn turn<A: Deref<Target = [u8]>>(
        &mut self,
        now: Micros,
        event: &Event<A>,
        board: &mut impl Board,
    ) {
        let reading = self.take(now, event);
        // First and in the midst of the step, so that what the sensor is asked between two bursts
        // goes over the wire meanwhile.
        self.serve_sensor(now, board);
        if let Some(reading) = reading {
            board.step_begins();
            self.flight.carried_tick(board.carried_tick());
            let estimate = self.flight.estimate(now, reading);
            // Behind a burst the sensor holds up the STOP for some time: the bus is free only now,
            // or after the step.
            self.serve_sensor(now, board);
            let snapshot = &self.flight.act(now, estimate);
            board.step_ends(&self.step_end(now, snapshot));
            self.serve_sensor(now, board);
            let status = &board.status();
            if let Some(index) = self.flight.learn(status) {
                self.telemetry.report_param(index, self.flight.params());
            }
            self.telemetry
                .record(snapshot, self.flight, self.driver.health(), status);
            self.telemetry.tell_memory(snapshot, self.flight);
            self.recorder.record(snapshot, self.flight);
            self.telemetry.serve_recorder(self.recorder);
        }
        self.exchange(now, board);
    }

    /// What the event means to the flight: a sample or the reason why there is none, where a step
    /// is due.
    fn take<A: Deref<Target = [u8]>>(
        &mut self,
        now: Micros,
        event: &Event<A>,
    ) -> Option<Result<RawSample, SensorFault>> {
        match event {
            Event::Burst(burst) => Some(self.driver.sample(burst.started, burst.bytes())),
            Event::Missed => Some(Err(self.driver.missed())),
            Event::Late(burst) => {
                // Too late to fly by; what it says of the sensor's health counts all the same.
                let _ = self.driver.sample(burst.started, burst.bytes());
                None
            }
            Event::Reply(reply) => {
                self.driver.complete(now, reply.bytes());
                None
            }
            Event::Nothing => None,
        }
    }

    /// Give the sensor's driver what it asks for next. While the sensor is sampled, that goes
    /// between two bursts.
    #[inline(never)]
    fn serve_sensor(&mut self, now: Micros, board: &mut impl Board) {
        let sampling = self.driver.is_sampling();
        let address = self.driver.config().address.value();
        board.arm(address, sampling.then(|| self.driver.burst()));
        if board.bus_is_free()
            && let Next::Transfer(transfer) = self.driver.next(now)
            && (!sampling || board.has_time_for(&transfer))
        {
            board.begin(transfer);
        }
    }

    fn step_end(&self, now: Micros, snapshot: &Snapshot) -> StepEnd {
        StepEnd {
            pulse: snapshot.pulse,
            neutral: self.flight.neutral(),
            timing: self.flight.timing(),
            state: snapshot.state,
            led: led::is_lit(snapshot.state.kind(), now),
        }
    }

    /// Take what the host has sent, and give it what it has room for.
    #[inline(never)]
    fn exchange(&mut self, now: Micros, board: &mut impl Board) {
        let port = board.poll_port(now, self.flight.state().is_armed());
        let open = match port {
            Port::Absent => false,
            Port::Silent => self.telemetry.has_heard(now),
            Port::Open => true,
        };
        let was_open = core::mem::replace(&mut self.port_open, open);
        if open && !was_open {
            // A new listener hears the state again.
            self.telemetry.restart();
        }
        if port != Port::Absent {
            let mut packet = [0; PACKET_BYTES];
            self.telemetry
                .receive(now, board.read(&mut packet), self.flight);
        }
        if !open {
            // Nobody listens: whoever comes next wants the present, not the past.
            self.telemetry.sent(self.telemetry.pending().len());
            return;
        }
        // The processor stands still while it writes flash: a burst under way would be cut in two.
        if board.bus_is_free() {
            self.telemetry.serve_storage(board.flash(), self.flight);
        }
        if let Some(reset) = self.telemetry.take_reset() {
            board.reset_soon(now, reset);
        }
        if let Some(order) = self.telemetry.take_bringup() {
            let value = board.bringup(order);
            self.telemetry.answer_bringup(now, order, value);
        }
        let count = board.write(self.telemetry.pending());
        self.telemetry.sent(count);
    }
}

#[cfg(test)]
mod tests;
