//! The application: what the main loop does with each event, apart from the hardware that it does
//! it with.
//!
//! [`Application::turn`] joins the sensor's driver, [`Flight`], [`Telemetry`] and [`Recorder`]. The
//! chip's board and the tests' stand in for [`Board`].

use embedded_storage::nor_flash::NorFlash;
use tvc_imu::{Bursts, BusError, Imu, Micros, Next, Transfer};

use crate::axis::Axis;
use crate::board_status::BoardStatus;
use crate::bringup;
use crate::failsafe::{SelfCheck, State};
use crate::flight::{Flight, Reading, Snapshot};
use crate::guard::{Changed, Guard, Sum};
use crate::led;
use crate::recorder::Recorder;
use crate::sensor::{Kind, Sensor};
use crate::servo::PulseUs;
use crate::telemetry::{Reset, Telemetry};
use crate::ticks::Timing;

/// Longest packet that the host sends, bytes.
pub const PACKET_BYTES: usize = 64;

/// The loop turns this often at least while the sensor is set up, while something is to be asked of
/// it, and while its bus is late or to be repaired, us.
const BUSY_TURN_US: u64 = 1_000;
/// The loop turns this often at least, us: the host's port looks after itself now and then.
const IDLE_TURN_US: u64 = 10_000;

/// Steps from one piece of a save to the next: the processor stands still for a piece, which may
/// cost a sample.
const SAVE_STEPS: u8 = 4;

/// What the main loop wakes up for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The tick's burst is over, and its step still to come.
    Burst(Outcome),
    /// The tick has no burst, or not in time: its step goes without a sample.
    Missed,
    /// A burst is over whose step has been taken without it.
    Late(Outcome),
    /// Another transfer is over.
    Reply(Outcome),
    /// Nothing for the flight.
    Nothing,
}

/// How a transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Start of the transfer. A burst of the rates alone is dated back to when a whole burst would
    /// have started.
    pub started: Micros,
    /// Whether it went well. What was read is then the board's [`answer`](Board::answer).
    pub result: Result<(), BusError>,
}

/// What a step asks of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepEnd {
    /// The pulses of the next frame; [`PulseUs::NONE`] for an axis that is not steered.
    pub pulses: [PulseUs; Axis::COUNT],
    /// The pulses that a crash sends.
    pub neutral: [PulseUs; Axis::COUNT],
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

/// What the sensor's bus is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bus {
    /// Nothing: a transfer can be begun.
    Free,
    /// A transfer is under way, or over and still to be told by an event.
    Busy,
    /// The sensor holds up the STOP of a transfer that is over. No event tells of its end.
    Stopping,
    /// It is to be repaired. A transfer fails at once.
    Broken,
}

/// The hardware, as far as the application uses it. A call takes some microseconds; only a repair
/// of the bus, a STOP that the sensor holds up, flash and [`Board::bringup`] wait, for up to 66 ms.
pub trait Board: Sum {
    /// Where parameters are stored.
    type Flash: NorFlash;

    /// What the transfer of the newest event has read: nothing, for a write.
    fn answer(&self) -> &[u8];

    /// Have the next tick start one of these: that of the rates alone where the tick is one for
    /// them ([`Timing::is_split`]), else the whole one.
    fn arm(&mut self, bursts: &Bursts);

    /// What the sensor's bus is doing.
    fn bus(&self) -> Bus;

    /// Whether `transfer` with this sensor, begun now, is over before the next tick.
    fn has_time_for(&self, transfer: &Transfer, sensor: Kind) -> bool;

    /// Start `transfer` to a 7-bit address, on a bus that is free or broken.
    fn begin(&mut self, address: u8, transfer: Transfer);

    /// A control step begins.
    fn step_begins(&mut self);

    /// When the newest tick came whose step a pulse carries, the last one in its frame, or would
    /// have come for a whole burst.
    fn carried_tick(&self) -> Micros;

    /// A control step is over.
    fn step_ends(&mut self, end: &StepEnd);

    /// What SYS_STATUS tells of the board.
    fn status(&self) -> BoardStatus;

    /// Look after the port to the host. A vehicle that is `armed` is not reset.
    fn poll_port(&mut self, now: Micros, armed: bool) -> Port;

    /// The host's next packet, of at most [`PACKET_BYTES`]; empty if there is none.
    fn read(&mut self) -> &[u8];

    /// Hand over as much of `bytes` as there is room for; says how many.
    fn write(&mut self, bytes: &[u8]) -> usize;

    /// Where parameters are stored.
    fn flash(&mut self) -> &mut Self::Flash;

    /// Reset once the host has been answered, unless the vehicle is armed by then.
    fn reset_soon(&mut self, now: Micros, reset: Reset);

    /// Something decisive is not as it was set: send the servos to neutral and reset.
    fn stop(&mut self, check: SelfCheck);

    /// Do what `tvc bringup` orders, and give the answer's value; `None` for what there is not.
    fn bringup(&mut self, order: bringup::Order) -> Option<u32>;
}

/// All that runs on the board.
#[derive(Debug)]
pub struct Application<'a> {
    sensor: &'a mut Sensor,
    flight: &'a mut Flight,
    telemetry: &'a mut Telemetry,
    recorder: &'a mut Recorder,
    port_open: bool,
    guard: Guard,
    /// Steps until the next piece of a save, the last of them with a sample where the sensor gives
    /// any.
    steps_to_save: u8,
}

impl<'a> Application<'a> {
    /// At start-up.
    pub fn new(
        sensor: &'a mut Sensor,
        flight: &'a mut Flight,
        telemetry: &'a mut Telemetry,
        recorder: &'a mut Recorder,
    ) -> Self {
        Self {
            sensor,
            flight,
            telemetry,
            recorder,
            port_open: false,
            guard: Guard::default(),
            steps_to_save: 1,
        }
    }

    /// Once round the loop: read, step, write, send. Gives the time of the next turn, if nothing
    /// happens before.
    // A function of its own: what `main` holds for ever in registers is then not in its way. 3.4 KB
    // less flash.
    #[inline(never)]
    pub fn turn(&mut self, now: Micros, event: Event, board: &mut impl Board) -> Micros {
        let reading = self.take(now, event, board);
        if event != Event::Nothing {
            self.arm(event, board);
            // A request to the sensor goes over the wire while the step is taken.
            self.ask_sensor(now, board);
        }
        if let Some(reading) = reading {
            self.step(now, reading, board);
        }
        let mut has_heard = false;
        // The sensor's reply is nothing for the host.
        if !matches!(event, Event::Reply(_)) {
            // An order takes time: it waits for the step of a burst that is under way.
            let may_obey =
                event != Event::Nothing || !self.sensor.is_sampling() || board.bus() != Bus::Busy;
            has_heard = self.exchange(now, may_obey, board);
        }
        self.guard.close(self.flight, board);
        // A transfer that is missing may be one to give up. A save waits for the bus to be free,
        // and behind a packet there may be another.
        let is_calm = !self.ask_sensor(now, board)
            && !has_heard
            && self.sensor.is_sampling()
            && event != Event::Missed
            && !self.telemetry.has_storage_order();
        now.after(if is_calm { IDLE_TURN_US } else { BUSY_TURN_US })
    }

    /// Estimate, act, send the pulses, and look after the rest.
    #[inline(never)]
    fn step(&mut self, now: Micros, reading: Reading, board: &mut impl Board) {
        let is_lost = reading.is_err() && self.sensor.is_sampling();
        self.steps_to_save = self.steps_to_save.saturating_sub(1).max(is_lost.into());
        board.step_begins();
        self.open_state(board);
        self.flight.carried_tick(board.carried_tick());
        let estimate = self.flight.estimate(now, reading);
        // Behind a burst the sensor holds up the STOP for some time: the bus is free only now.
        self.ask_sensor(now, board);
        let snapshot = &self.flight.act(now, estimate);
        board.step_ends(&self.step_end(now, snapshot));
        self.check_settings(board);
        if self.flight.catch_up() {
            self.guard.open_settings();
        }
        let status = &board.status();
        if let Some(index) = self.flight.learn(status) {
            self.guard.open_settings();
            self.telemetry.report_param(index, self.flight.params());
        }
        self.tell(snapshot, status);
    }

    /// Tell the host and the recorder of a step.
    fn tell(&mut self, snapshot: &Snapshot, status: &BoardStatus) {
        self.telemetry.record(snapshot, self.flight, &self.sensor.status(snapshot.now), status);
        self.telemetry.tell_memory(snapshot, self.flight, self.sensor.refresh());
        self.recorder.record(snapshot, self.flight);
        self.telemetry.serve_recorder(self.recorder);
    }

    /// Stop where the state is not as it was left. From here on it may be changed.
    fn open_state(&mut self, board: &mut impl Board) {
        if self.guard.open_state(self.flight, board) == Err(Changed) {
            board.stop(SelfCheck::Memory);
        }
    }

    /// Stop where the settings are not as they were set.
    fn check_settings(&self, board: &mut impl Board) {
        if self.guard.check_settings(self.flight, board) == Err(Changed) {
            board.stop(SelfCheck::Memory);
        }
    }

    /// Before an order that may change all of the flight.
    fn open(&mut self, board: &mut impl Board) {
        self.check_settings(board);
        self.open_state(board);
        self.guard.open_settings();
    }

    /// Say what the next tick is to start. The reply to a verification changes that only where it
    /// ends the sampling.
    fn arm(&mut self, event: Event, board: &mut impl Board) {
        let sampling = self.sensor.is_sampling();
        if sampling && matches!(event, Event::Reply(_)) {
            return;
        }
        board.arm(&self.sensor.bursts());
    }

    /// What the event means to the flight: a sample or the reason why there is none, where a step
    /// is due.
    fn take(&mut self, now: Micros, event: Event, board: &impl Board) -> Option<Reading> {
        let bytes = |outcome: Outcome| outcome.result.map(|()| board.answer());
        self.sensor.hold_offsets(self.flight.state().is_armed());
        match event {
            Event::Burst(burst) => Some(self.sensor.sample(burst.started, bytes(burst))),
            Event::Missed => Some(Err(self.sensor.missed())),
            Event::Late(burst) => {
                self.sensor.overdue(burst.started, bytes(burst));
                None
            }
            Event::Reply(reply) => {
                self.sensor.complete(now, bytes(reply));
                None
            }
            Event::Nothing => None,
        }
    }

    /// Give the sensor's driver what it asks for next. While the sensor is sampled, that goes
    /// between two bursts. Says whether something waits for a moment that no event tells of.
    fn ask_sensor(&mut self, now: Micros, board: &mut impl Board) -> bool {
        let bus = board.bus();
        // A save needs the bus free, and takes its turn first.
        if bus == Bus::Busy || self.has_piece_to_save() && self.sensor.is_sampling() {
            return false;
        }
        match self.sensor.next(now) {
            Next::Transfer(_) if bus == Bus::Stopping => true,
            Next::Transfer(transfer) => {
                let asked = self.sensor.asked();
                if !self.sensor.is_sampling() || board.has_time_for(&transfer, asked) {
                    board.begin(self.sensor.address(), transfer);
                }
                false
            }
            Next::Wait(_) => true,
            Next::Sample => bus == Bus::Broken,
        }
    }

    /// Change to the sensor that `SENSOR` says. A transfer under way ends without a use.
    fn choose_sensor(&mut self, board: &mut impl Board) {
        let params = self.flight.params();
        if !self.sensor.is_as(params) && !self.flight.state().is_armed() {
            *self.sensor = Sensor::new(params);
            // Where a fault is to be acknowledged, it stays.
            let _ = self.flight.calibrate();
            board.arm(&self.sensor.bursts());
        }
    }

    /// A piece of a save is to be done, and may be done now.
    fn has_piece_to_save(&self) -> bool {
        self.steps_to_save == 0 && self.telemetry.has_storage_order()
    }

    fn step_end(&self, now: Micros, snapshot: &Snapshot) -> StepEnd {
        StepEnd {
            pulses: snapshot.pulses,
            neutral: self.flight.neutral(),
            timing: self.flight.timing(),
            state: snapshot.state,
            led: led::is_lit(snapshot.state.kind(), now),
        }
    }

    /// Take what the host has sent, and give it what it has room for. Says whether it had sent
    /// something.
    #[inline(never)]
    fn exchange(&mut self, now: Micros, may_obey: bool, board: &mut impl Board) -> bool {
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
        let mut has_heard = false;
        if open && may_obey {
            let mut packet = [0; PACKET_BYTES];
            let packet = copy(board.read(), &mut packet);
            has_heard = !packet.is_empty();
            if has_heard {
                self.open(board);
                self.telemetry.receive(now, packet, self.flight);
                self.choose_sensor(board);
            }
        }
        if !open {
            // What is answered from now on is sent: the message that shows the host is not obeyed,
            // since its answer would get lost.
            if port == Port::Silent {
                self.telemetry.listen(now, board.read());
            }
            // Its answer would get lost, and while it waits the sensor is not asked.
            self.steps_to_save = SAVE_STEPS;
            // Nobody listens: whoever comes next wants the present, not the past.
            self.telemetry.sent(self.telemetry.pending().len());
            return false;
        }
        // The processor stands still while it writes flash: a burst under way would be cut in two.
        if self.has_piece_to_save() && matches!(board.bus(), Bus::Free | Bus::Broken) {
            self.steps_to_save = SAVE_STEPS;
            // What a flipped bit has made of the parameters is not to be stored. A save only reads
            // them: their sum stays, for a bit may flip while the flash is written.
            if self.telemetry.is_saving() {
                self.check_settings(board);
            } else {
                self.open(board);
            }
            self.telemetry.serve_storage(board.flash(), self.flight);
            self.choose_sensor(board);
            self.open_state(board);
            self.flight.halted();
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
        has_heard
    }
}

/// A packet in a place of its own, so that its board can be asked for something else.
fn copy<'a>(packet: &[u8], place: &'a mut [u8; PACKET_BYTES]) -> &'a [u8] {
    let place = place.get_mut(..packet.len()).unwrap_or_default();
    place.copy_from_slice(packet);
    place
}

#[cfg(test)]
mod tests;
