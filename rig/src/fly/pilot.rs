//! The pilot stands for the person at the rig: it opens the clamp when the firmware reports that it
//! is in control, and takes the drone back to its start when that ends. It also reads what the
//! program at the port sends, and moves sensor and drone as a calibration asks for. What other
//! programs do to the rig by hand ([`Action`]) is done by the pilot, too.

use crate::bench::Vehicle;
use crate::bench::sensor_motion::{SensorMotion, resting};
use crate::bno055::{Fault, FaultKind};
use crate::disturbance::Disturbances;
use crate::fly::action::Action;
use crate::rig::Rig;
use calibration::prompt::{Prompt, Tilt};
use client::state::state_of;
use client::{StateKind, Wire, request, text};
use mavlink::dialects::common::MavMessage;
use nalgebra::UnitQuaternion;
use samd21::board::Ticks;
use serde::Serialize;
use tvc_nano::Axis;

/// How far the drone is tilted to see its rudder react, rad.
const TILT_RAD: f64 = 0.35;
/// How long the sensor takes from one pose to the next, s.
const TURN_S: f64 = 1.5;
/// Time from the request to tilt the drone until its rudder rests.
const RUDDER_RESTS: Ticks = Ticks::from_ms(1300);

/// How well the pilot does what a calibration asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Manner {
    /// Does what it is asked.
    #[default]
    Steady,
    /// Holds the sensor unsteadily where it should lie still.
    Trembling,
    /// Turns the sensor about one axis alone.
    Lazy,
}

/// Moves the clamp, and reads what the image and its ground station send.
#[derive(Clone, Debug, Default)]
pub struct Pilot {
    link: Wire,
    station: Wire,
    manner: Manner,
    /// Pitch and roll at which the clamp holds the drone before a release.
    start_rad: [f64; Axis::COUNT],
    rate_rad_s: f64,
    state: Option<StateKind>,
    /// When to look at the rudder of the tilted drone, and at which.
    check_rudder_at: Option<(Ticks, Axis)>,
    /// Whether the clamp was opened (`true`) or closed by hand; `None` while it follows the
    /// firmware's state.
    clamp: Option<bool>,
    /// Faults that end by themselves, with the time at which they do.
    ending: Vec<(Ticks, Fault)>,
}

/// The state of the rig, as a program that acts on it gets it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Look {
    /// Time since power-on, s.
    pub time_s: f64,
    /// The drone's true pitch, rad.
    pub pitch_rad: f64,
    /// Its true roll, rad; 0 where it only pitches.
    pub roll_rad: f64,
    /// The clamp holds the drone.
    pub held: bool,
    /// Who moves the clamp: `open` and `closed` by hand, `auto` by the firmware's state.
    pub clamp: &'static str,
    /// Tilt at which it holds the drone before a release, rad.
    pub start_rad: f64,
    /// The same in roll, rad.
    pub start_roll_rad: f64,
    /// Faults that are on.
    pub faults: Vec<&'static str>,
    /// Disturbances that are on, with their values.
    pub disturbances: Vec<(&'static str, String)>,
    /// The cable is in.
    pub usb: bool,
    /// The bootloader runs.
    pub bootloader: bool,
    /// Resets so far.
    pub resets: usize,
}

impl Pilot {
    /// Releases the drone from the tilt `start_rad`, pitch and roll, rad, with a rate of
    /// `rate_rad_s`, rad/s. Does what a calibration asks for in this manner.
    pub fn new(start_rad: [f64; Axis::COUNT], rate_rad_s: f64, manner: Manner) -> Self {
        Self { start_rad, rate_rad_s, manner, ..Self::default() }
    }

    /// Reads what the program at the port has sent, and follows its prompts.
    pub fn on_station_bytes(&mut self, rig: &mut Rig, sent: &[u8]) {
        for message in self.station.receive(sent) {
            if let Some(prompt) = request::text_of(&message).and_then(Prompt::from_text) {
                self.follow_prompt(rig, prompt);
            }
        }
    }

    fn follow_prompt(&mut self, rig: &mut Rig, prompt: Prompt) {
        let axis = match prompt {
            Prompt::Tilt(Tilt::NoseUp | Tilt::NoseDown) => Some(Axis::Pitch),
            Prompt::Tilt(Tilt::RightDown | Tilt::LeftDown) => Some(Axis::Roll),
            _ => None,
        };
        if let Some(axis) = axis {
            self.check_rudder_at = Some((rig.now() + RUDDER_RESTS, axis));
        }
        let environment = &mut rig.environment;
        match prompt {
            Prompt::Rest if self.manner == Manner::Trembling => {
                environment.move_sensor(SensorMotion::TREMBLE);
            }
            Prompt::Rest => environment.move_sensor(SensorMotion::Rest),
            Prompt::Pose(face) => environment.move_sensor(SensorMotion::To(resting(face), TURN_S)),
            Prompt::Turn if self.manner == Manner::Lazy => {
                environment.move_sensor(SensorMotion::Spin)
            }
            Prompt::Turn => environment.move_sensor(SensorMotion::Turn),
            Prompt::Level => {
                let (_, _, heading) = environment.mounted().euler_angles();
                let level = UnitQuaternion::from_euler_angles(0.0, 0.0, heading);
                environment.move_sensor(SensorMotion::To(level, TURN_S));
            }
            Prompt::Tilt(tilt) => environment.tilt_clamp_to(match tilt {
                Tilt::NoseUp => [TILT_RAD, 0.0],
                Tilt::NoseDown => [-TILT_RAD, 0.0],
                Tilt::RightDown => [0.0, TILT_RAD],
                Tilt::LeftDown => [0.0, -TILT_RAD],
                Tilt::Upright => [0.0; Axis::COUNT],
            }),
            Prompt::Done => {
                environment.put_back();
                environment.tilt_clamp_to(self.start_rad);
            }
        }
    }

    /// Reads what the image has sent and acts on its state; returns the lines to show to a person.
    pub fn on_image_bytes(&mut self, rig: &mut Rig, sent: &[u8]) -> Vec<String> {
        let mut lines = Vec::new();
        for message in self.link.receive(sent) {
            match message {
                MavMessage::HEARTBEAT(beat) => {
                    if let Some(state) = state_of(beat.custom_mode) {
                        self.follow_state(rig, state);
                    }
                }
                MavMessage::STATUSTEXT(said) => {
                    lines.push(text(&said.text).to_owned());
                }
                _ => {}
            }
        }
        let now = rig.now();
        for (_, fault) in self.ending.extract_if(.., |(due, _)| now >= *due) {
            rig.clear(fault);
        }
        if let Some((_, axis)) = self.check_rudder_at.take_if(|(due, _)| rig.now() >= *due) {
            lines.push(describe(rig.environment.vehicle(), axis));
        }
        lines
    }

    /// In a failsafe the drone is not caught: it moves freely until the firmware leaves that state.
    fn follow_state(&mut self, rig: &mut Rig, state: StateKind) {
        self.state = Some(state);
        if self.clamp.is_some() {
            return;
        }
        match state {
            StateKind::Active => self.move_clamp(rig, true),
            // The drone swings on until it is stood up again.
            StateKind::Failsafe => {}
            _ => self.move_clamp(rig, false),
        }
    }

    /// Does what a person does by hand.
    ///
    /// # Errors
    /// It cannot be done to this rig.
    pub fn act(&mut self, rig: &mut Rig, action: &Action) -> Result<(), String> {
        let disturb = |rig: &mut Rig, change: &dyn Fn(&mut Disturbances)| {
            let mut disturbances = rig.environment.disturbances();
            change(&mut disturbances);
            rig.environment.set_disturbances(disturbances);
        };
        match action {
            Action::Look => {}
            Action::Tilt(Axis::Roll, _)
                if matches!(rig.environment.vehicle(), Vehicle::Pivot(_)) =>
            {
                return Err("this drone only pitches: tvc rig --vehicle drone2".into());
            }
            Action::Push(_)
            | Action::Gust(..)
            | Action::ServoSupply(Some(_))
            | Action::ThrustRamp(Some(_))
                if matches!(rig.environment.vehicle(), Vehicle::Rocket(_)) =>
            {
                return Err("that disturbs a drone; what a rocket meets is in its file".into());
            }
            Action::Tilt(axis, rad) => {
                self.start_rad[axis.index()] = *rad;
                rig.environment.tilt_clamp_to(self.start_rad);
            }
            Action::Clamp(by_hand) => {
                self.clamp = *by_hand;
                if let Some(opens) = by_hand {
                    self.move_clamp(rig, *opens);
                }
            }
            Action::Push(impulse) => rig.environment.push(*impulse),
            Action::Gust(torque, seconds) => rig.environment.gust(*torque, *seconds),
            Action::Sensor(Some(motion)) => rig.environment.move_sensor(*motion),
            Action::Sensor(None) => rig.environment.put_back(),
            Action::Fault(fault, length) => {
                self.forget(FaultKind::of(fault));
                rig.inject(*fault);
                self.ending.extend(length.map(|length| (rig.now() + length, *fault)));
            }
            Action::Clear(kind) => {
                for kind in kind.map_or(FaultKind::ALL.to_vec(), |kind| vec![kind]) {
                    self.forget(kind);
                    rig.clear(kind.hardest());
                }
            }
            Action::Vibration(value) => disturb(rig, &|all| all.vibration = *value),
            Action::ServoSupply(value) => disturb(rig, &|all| all.servo_supply = *value),
            Action::ThrustRamp(value) => disturb(rig, &|all| all.thrust_ramp = *value),
            Action::Temperature(value) => disturb(rig, &|all| all.temperature = *value),
            Action::Hardware(setting) => rig.set_hardware(setting)?,
            Action::Reset => rig.press_reset(),
            Action::PowerCycle => rig.power_cycle(),
            Action::BrownOut => rig.brown_out(),
            Action::Supply(volts) => rig.set_supply(*volts),
            Action::Program(_) if rig.in_bootloader() => {
                return Err("the bootloader runs, not the firmware".into());
            }
            Action::Program(end) => {
                rig.end_program(*end).ok_or("this image does not say where its stack ends")?;
            }
            Action::Store(false) => rig.spoil_store(),
            Action::Store(true) => rig.erase_store(),
            Action::Usb(true) => rig.chip.usb_host.attach(),
            Action::Usb(false) => rig.chip.usb_host.detach(),
        }
        Ok(())
    }

    /// A fault of this kind does not end by itself any more.
    fn forget(&mut self, kind: FaultKind) {
        self.ending.retain(|(_, fault)| FaultKind::of(fault) != kind);
    }

    /// Opens or closes the clamp, if it is not so already.
    fn move_clamp(&self, rig: &mut Rig, opens: bool) {
        match (opens, rig.environment.vehicle().held()) {
            (true, true) => rig.release(self.rate_rad_s),
            (false, false) => {
                rig.environment.catch();
                rig.environment.tilt_clamp_to(self.start_rad);
            }
            _ => {}
        }
    }

    /// The state of the rig.
    pub fn look(&self, rig: &Rig) -> Look {
        let environment = &rig.environment;
        let faults = environment.sensor.faults();
        Look {
            time_s: rig.now().as_secs_f64(),
            pitch_rad: environment.vehicle().tilt_rad()[0],
            roll_rad: environment.vehicle().tilt_rad()[1],
            held: environment.vehicle().held(),
            clamp: match self.clamp {
                Some(true) => "open",
                Some(false) => "closed",
                None => "auto",
            },
            start_rad: self.start_rad[0],
            start_roll_rad: self.start_rad[1],
            faults: faults.map(|fault| FaultKind::of(fault).name()).collect(),
            disturbances: environment.disturbances().rows(),
            usb: rig.chip.usb_host.is_attached(),
            bootloader: rig.in_bootloader(),
            resets: rig.resets().len(),
        }
    }

    /// The firmware's state, by the last heartbeat.
    pub fn state(&self) -> Option<StateKind> {
        self.state
    }
}

/// How the rudder answers the tilt, as a person beside the drone sees it.
fn describe(drone: &Vehicle, axis: Axis) -> String {
    let up = |up: bool| if up { "up" } else { "down" };
    let (tilt, rudder) = (drone.tilt_rad()[axis.index()], drone.rudders_rad()[axis.index()]);
    // A rudder at a positive angle pushes the nose down, or the right side up.
    let (side, is_up) = match axis {
        Axis::Pitch => ("nose", tilt > 0.0),
        Axis::Roll => ("right side", tilt < 0.0),
    };
    let verdict = match rudder {
        _ if rudder.abs() < 0.02 => "does not answer".to_owned(),
        _ if (tilt > 0.0) == (rudder > 0.0) => {
            format!("pushes it {}, as it should", up(!is_up))
        }
        _ => format!("pushes it further {}: the wrong way", up(is_up)),
    };
    format!("the {side} is {}; the rudder {verdict}", up(is_up))
}
