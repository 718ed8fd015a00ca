//! The vehicle as a host and a bystander see it.

use std::boxed::Box;
use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};
use std::string::{String, ToString};
use std::vec::Vec;

use mavlink::dialects::common::MavResult;

use super::events::{Event, Ordered};
use super::world::{Trouble, World};
use super::*;
use crate::failsafe::Refusal;
use crate::params::Polarity;
use crate::store::{self, Loaded, STORE_BYTES};

pub(super) const TICK_US: u64 = 10_000;

/// What the vehicle has told.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Said {
    /// COMMAND_ACK: the command, its result, and the number of the refusal.
    Ack(u16, u8, u8),
    /// PARAM_VALUE.
    Value(String, f32),
    /// PARAM_ERROR.
    Error,
}

/// What the bystander knows without asking the vehicle.
#[derive(Clone)]
pub(super) struct Truth {
    /// Steps with a good sample in a row.
    pub(super) good_run: u32,
    /// Longest rest without a break since the vehicle was started or calibrated, in steps.
    pub(super) rest: u32,
    resting: u32,
    pub(super) heard: Option<Micros>,
    /// Until when a test pulse may last.
    pub(super) tested_until: Micros,
}

std::thread_local! {
    /// What is loaded from a flash, which takes long to find out without optimisation.
    static LOADED: RefCell<HashMap<[u8; STORE_BYTES], (Params, Loaded)>> = RefCell::default();
}

#[derive(Clone)]
pub(super) struct Vehicle {
    pub(super) driver: Sensor,
    pub(super) flight: Flight,
    telemetry: Telemetry,
    recorder: Box<Recorder>,
    pub(super) world: World,
    pub(super) now: Micros,
    port_open: bool,
    steps_to_save: u8,
    pub(super) said: Vec<Said>,
    pub(super) truth: Truth,
    /// Commands that are noted and not answered yet.
    pub(super) owed: BTreeSet<u16>,
    /// The order about stored parameters that waits.
    pub(super) storing: Option<Ordered>,
    /// Operations of the flash before it.
    written_before: usize,
    /// What a start would find in the flash, and after how many of its operations.
    stored: (usize, Params, Loaded),
}

/// What a step came from.
pub(super) struct Past {
    pub(super) state: State,
    /// The order about stored parameters that waited, and what was stored.
    pub(super) storing: Option<(Ordered, Params)>,
    /// How much had been said.
    pub(super) said: usize,
}

/// The parameters that events change, by which states differ.
pub(super) const WATCHED: [&str; 10] = [
    "PID_KP",
    "PID_LAW",
    "SRV_DIR",
    "SRV_POLARITY",
    "FS_HOST",
    "CAL_GYR_OY",
    "I2C_STRETCH_US",
    "GS_ROWS",
    "GS2_S",
    "LAUNCH_ACC",
];

/// All by which two vehicles are told apart.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key {
    pub(super) state: u32,
    /// How an order to arm, to release, to disarm and to try a pulse would be answered.
    may: [u8; 4],
    sensor: (bool, bool),
    rudder: Rudder,
    heard: bool,
    watched: Vec<u32>,
    stored: (u8, bool),
    owed: BTreeSet<u16>,
    storing: Option<(Ordered, usize, u8)>,
    reset: bool,
    port: u8,
    tilt: i32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Rudder {
    Neutral,
    Tested,
    Moved,
}

pub(super) const TEST_PULSE: PulseUs = PulseUs(1700);

impl Vehicle {
    /// Powered on, with what is in `flash`, at the end of the first step.
    pub(super) fn start(flash: Mock, crash: Option<Crash>) -> Self {
        let mut world = World::new(flash);
        let (params, stored) = store::load(&mut world.flash, crate::store::BoardId::default());
        let mut vehicle = Self {
            driver: Sensor::new(&Params::default()),
            flight: Flight::new(params, BootReport { crash, stored }).unwrap(),
            telemetry: Telemetry::default(),
            recorder: Box::new(Recorder::new()),
            world,
            // Not at zero, which the flight's memory takes for never.
            now: Micros(1_000_000),
            port_open: false,
            steps_to_save: 1,
            said: Vec::new(),
            truth: Truth { good_run: 0, rest: 0, resting: 0, heard: None, tested_until: Micros(0) },
            owed: BTreeSet::new(),
            storing: None,
            written_before: 0,
            stored: (0, Params::default(), Loaded::Nothing),
        };
        vehicle.look_at_flash();
        vehicle.step();
        vehicle
    }

    /// Out of its box and set up: parameters are stored, the rudder's answer has been seen.
    pub(super) fn set_up() -> Mock {
        Self::set_up_with(&[])
    }

    /// The same with other values.
    pub(super) fn set_up_with(values: &[(&str, f32)]) -> Mock {
        let mut params = Params::default();
        for (name, value) in values {
            params.set(name, *value).unwrap();
        }
        params.set("I2C_KHZ", 100.0).unwrap();
        params.set("SRV_POLARITY", 1.0).unwrap();
        let mut flash = Mock::new();
        store::save(&mut flash, &params, crate::store::BoardId::default()).unwrap();
        flash
    }

    pub(super) fn state(&self) -> State {
        self.flight.state()
    }

    fn refusal(answer: Result<(), Refusal>) -> u8 {
        answer.map_or_else(|refusal| refusal.kind().code(), |()| 0)
    }

    pub(super) fn rudder(&self) -> Rudder {
        let end = self.world.end.unwrap();
        match end.pulses[0] {
            pulse if pulse == end.neutral[0] => Rudder::Neutral,
            TEST_PULSE => Rudder::Tested,
            _ => Rudder::Moved,
        }
    }

    /// What a start would find in the flash.
    pub(super) fn stored(&self) -> (&Params, Loaded) {
        let (_, params, loaded) = &self.stored;
        (params, *loaded)
    }

    fn look_at_flash(&mut self) {
        let bytes = self.world.flash.bytes();
        let (params, loaded) = LOADED.with_borrow_mut(|known| {
            let load = || store::load_bytes(bytes);
            known.entry(*bytes).or_insert_with(load).clone()
        });
        self.stored = (self.world.flash.operations(), params, loaded);
    }

    pub(super) fn is_heard(&self) -> bool {
        let heard = self.truth.heard;
        heard.is_some_and(|heard| self.now.since(heard) <= crate::config::HOST_SILENCE_US)
    }

    pub(super) fn key(&self) -> Key {
        let params = self.flight.params();
        let (stored, loaded) = self.stored();
        let commands = [
            Command::Arm,
            Command::Release,
            Command::Disarm,
            Command::TestPulse(Axis::Pitch, TEST_PULSE),
        ];
        Key {
            state: self.state().code(),
            may: commands.map(|command| Self::refusal(self.flight.may(self.now, command))),
            sensor: (self.truth.good_run >= 5, self.driver.is_sampling()),
            rudder: self.rudder(),
            heard: self.is_heard(),
            watched: WATCHED.iter().map(|name| params.value(name).unwrap().to_bits()).collect(),
            stored: (
                match loaded {
                    Loaded::Nothing => 0,
                    Loaded::Set { .. } => 1 + u8::from(!loaded.is_as_saved()),
                    Loaded::Corrupt => 3,
                },
                stored == params,
            ),
            owed: self.owed.clone(),
            storing: self.storing.map(|order| (order, self.written(), self.steps_to_save)),
            reset: self.world.reset_at.is_some(),
            port: match self.world.port {
                Port::Absent => 0,
                Port::Silent => 1 + u8::from(self.telemetry.has_heard(self.now)),
                Port::Open => 3,
            },
            tilt: (self.world.chip.pitch_rad * 10.0).round() as i32,
        }
    }

    /// Once round the loop.
    pub(super) fn turn(&mut self, event: application::Event) {
        let was_open = self.port_open;
        let mut application = Application::new(
            &mut self.driver,
            &mut self.flight,
            &mut self.telemetry,
            &mut self.recorder,
        );
        (application.port_open, application.steps_to_save) = (self.port_open, self.steps_to_save);
        application.turn(self.now, event, &mut self.world);
        (self.port_open, self.steps_to_save) = (application.port_open, application.steps_to_save);
        if was_open != self.port_open {
            // A new listener is owed nothing.
            self.owed.clear();
        }
        if self.stored.0 != self.world.flash.operations() {
            self.look_at_flash();
        }
        if !self.telemetry.has_storage_order() {
            (self.storing, self.written_before) = (None, self.world.flash.operations());
        }
        self.listen();
    }

    /// Reads what has come from the vehicle.
    fn listen(&mut self) {
        let sent = core::mem::take(&mut self.world.sent);
        let mut rest = &sent[..];
        while let [_, len, _, _, _, _, _, id @ ..] = rest {
            let len = usize::from(*len);
            let id = u32::from_le_bytes([id[0], id[1], id[2], 0]);
            // What the protocol leaves out at the end is zero.
            let byte = |at: usize| if at < len { rest[10 + at] } else { 0 };
            match id {
                77 => {
                    let command = u16::from_le_bytes([byte(0), byte(1)]);
                    let said = Said::Ack(command, byte(2), byte(3));
                    if byte(2) != MavResult::MAV_RESULT_IN_PROGRESS as u8 {
                        self.owed.remove(&command);
                    }
                    self.said.push(said);
                }
                22 => {
                    let value = f32::from_le_bytes([0, 1, 2, 3].map(byte));
                    let name: Vec<u8> = (8..24).map(byte).take_while(|byte| *byte != 0).collect();
                    let name = String::from_utf8_lossy(&name).to_string();
                    self.said.push(Said::Value(name, value));
                }
                345 => self.said.push(Said::Error),
                _ => {}
            }
            rest = &rest[12 + len..];
        }
    }

    /// A control step, and what the sensor is asked behind it.
    pub(super) fn step(&mut self) {
        self.now = self.now.after(TICK_US);
        self.world.tick = self.now;
        let chip = &mut self.world.chip;
        chip.pitch_rad += chip.rate_rad_s * TICK_US as f64 * 1e-6;
        let is_still = chip.rate_rad_s == 0.0 && chip.thrust == 0;
        let is_sampling = self.driver.is_sampling();
        let event = if is_sampling && chip.trouble != Trouble::Late {
            let result = chip.perform(&self.driver.bursts().whole.unwrap());
            let outcome = Outcome {
                started: self.now,
                result: result.as_ref().map(|_| ()).map_err(|error| *error),
            };
            self.world.answer = result.unwrap_or_default();
            application::Event::Burst(outcome)
        } else {
            application::Event::Missed
        };
        let is_good = is_sampling && chip.trouble == Trouble::None;
        self.truth.good_run = if is_good { self.truth.good_run + 1 } else { 0 };
        self.truth.resting = match is_good && is_still {
            true => self.truth.resting + 1,
            false => 0,
        };
        self.truth.rest = self.truth.rest.max(self.truth.resting);
        self.turn(event);
        for _ in 0..3 {
            let Some(transfer) = self.world.transfer.take() else {
                break;
            };
            let result = self.world.chip.perform(&transfer);
            let outcome = Outcome {
                started: self.now,
                result: result.as_ref().map(|_| ()).map_err(|error| *error),
            };
            self.world.answer = result.unwrap_or_default();
            self.turn(application::Event::Reply(outcome));
        }
        // The loop turns without an event, too: by then the bus is free.
        self.turn(application::Event::Nothing);
    }

    /// The host's packet arrives between two steps.
    pub(super) fn receive(&mut self, packet: Vec<u8>) {
        self.world.packet = packet;
        self.turn(application::Event::Nothing);
    }

    pub(super) fn is_storing(&self) -> bool {
        self.telemetry.has_storage_order()
    }

    /// How far a save is.
    fn written(&self) -> usize {
        self.world.flash.operations() - self.written_before
    }

    /// The host orders something about stored parameters, where nothing of the kind waits.
    pub(super) fn note(&mut self, ordered: Ordered) {
        // What still waits when the port is opened is dropped.
        let is_free = self.storing.is_none() || !self.port_open;
        if ordered.is_of_storage() && is_free {
            self.storing = Some(ordered);
        }
    }

    /// What an answer to the host's packet means to a bystander.
    pub(super) fn take_note(&mut self, event: &Event) {
        if *event == Event::Heartbeat && self.world.port != Port::Absent {
            self.truth.heard = Some(self.now);
        }
        let Event::Order(ordered) = event else {
            return;
        };
        let number = ordered.number();
        if ordered.is_of_storage() && self.is_storing() {
            self.owed.insert(number);
        }
        let acks = Self::acks(&self.said, number);
        let result = acks.last().map(|(result, _)| *result);
        if result == Some(MavResult::MAV_RESULT_IN_PROGRESS as u8) {
            self.owed.insert(number);
            // Nothing of a former rest counts.
            (self.truth.rest, self.truth.resting) = (0, 0);
        }
        if result == Some(MavResult::MAV_RESULT_ACCEPTED as u8) && *ordered == Ordered::Pulse {
            self.truth.tested_until = self.now.after(crate::config::TEST_PULSE_US);
        }
    }

    /// Whether anything but control may have moved the rudder: somebody looks at its polarity, or
    /// tries a pulse.
    pub(super) fn is_set_up(&self) -> bool {
        let watched = self.flight.params().polarity(Axis::Pitch) == Polarity::Watched;
        let state = self.state();
        watched && state == State::Standby && self.is_heard()
            || state.is_idle() && self.now <= self.truth.tested_until
    }
}
