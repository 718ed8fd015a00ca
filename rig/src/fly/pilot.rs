//! The hand at the clamp: it lets the drone go when the firmware says that it is in control, and takes it back to its
//! start when the firmware says that it is no longer. It reads along what the program at the port sends, too, and does with
//! sensor and drone what a calibration asks for.

use crate::bench::sensor_motion::{SensorMotion, resting};
use crate::instruction::{Instruction, Tilt};
use crate::rig::Rig;
use client::state::state_of;
use client::{StateKind, Wire, text};
use mavlink::dialects::common::MavMessage;
use nalgebra::UnitQuaternion;
use plant::Drone;
use samd21::board::Ticks;

/// How far the drone is tilted to see its rudder answer, rad.
const TILT_RAD: f64 = 0.35;
/// How long the sensor takes from one pose to the next, s.
const TURN_S: f64 = 1.5;
/// Amplitude of a hand that trembles, rad/s.
const TREMBLE_RAD_S: f64 = 0.08;

/// From the wish to tilt the drone until its rudder rests.
const GLANCE: Ticks = Ticks::from_ms(1300);

/// How well the hand does what a calibration asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Manner {
    /// As it is asked.
    #[default]
    Steady,
    /// Never lets go of the sensor where it should lie still.
    Trembling,
    /// Turns the sensor about one axis where it should turn it through all directions.
    Lazy,
}

/// Holds the clamp and reads what the image sends, as the person at the rig does.
#[derive(Clone, Debug)]
pub struct Pilot {
    link: Wire,
    station: Wire,
    manner: Manner,
    start_rad: f64,
    rate_rad_s: f64,
    state: Option<StateKind>,
    /// When to look at the rudder of the tilted drone.
    glance: Option<Ticks>,
}

impl Pilot {
    /// Lets go from the tilt `start_rad`, with a rate of `rate_rad_s`.
    pub fn new(start_rad: f64, rate_rad_s: f64) -> Self {
        Self {
            link: Wire::default(),
            station: Wire::default(),
            manner: Manner::default(),
            start_rad,
            rate_rad_s,
            state: None,
            glance: None,
        }
    }

    /// Does what a calibration asks for in this manner.
    pub fn with_manner(mut self, manner: Manner) -> Self {
        self.manner = manner;
        self
    }

    /// Takes in what the program at the port has sent, and does what it asks of a person.
    pub fn hear(&mut self, rig: &mut Rig, sent: &[u8]) {
        for message in self.station.receive(sent) {
            if let Some(instruction) = Instruction::of(&message) {
                self.obey(rig, instruction);
            }
        }
    }

    fn obey(&mut self, rig: &mut Rig, instruction: Instruction) {
        if let Instruction::Tilt(Tilt::NoseUp | Tilt::NoseDown) = instruction {
            self.glance = Some(rig.now() + GLANCE);
        }
        let environment = rig.environment_mut();
        match instruction {
            Instruction::Rest if self.manner == Manner::Trembling => {
                environment.handle(SensorMotion::Tremble(TREMBLE_RAD_S));
            }
            Instruction::Rest => environment.handle(SensorMotion::Rest),
            Instruction::Pose(face) => environment.handle(SensorMotion::To(resting(face), TURN_S)),
            Instruction::Turn if self.manner == Manner::Lazy => {
                environment.handle(SensorMotion::Spin)
            }
            Instruction::Turn => environment.handle(SensorMotion::Turn),
            Instruction::Level => {
                let (_, _, heading) = environment.mounted().euler_angles();
                let level = UnitQuaternion::from_euler_angles(0.0, 0.0, heading);
                environment.handle(SensorMotion::To(level, TURN_S));
            }
            Instruction::Tilt(tilt) => environment.tilt_clamp(match tilt {
                Tilt::NoseUp => TILT_RAD,
                Tilt::NoseDown => -TILT_RAD,
                Tilt::Upright => 0.0,
            }),
            Instruction::Done => {
                environment.put_back();
                environment.tilt_clamp(self.start_rad);
            }
        }
    }

    /// Takes in what the image has sent; does what it says; gives what is worth telling a person.
    pub fn watch(&mut self, rig: &mut Rig, sent: &[u8]) -> Vec<String> {
        let mut news = Vec::new();
        for message in self.link.receive(sent) {
            match message {
                MavMessage::HEARTBEAT(beat) => {
                    if let Some(state) = state_of(beat.custom_mode) {
                        self.follow(rig, state);
                    }
                }
                MavMessage::STATUSTEXT(said) => {
                    news.push(text(&said.text).to_owned());
                }
                _ => {}
            }
        }
        if self.glance.is_some_and(|due| rig.now() >= due) {
            self.glance = None;
            news.push(describe(rig.environment().drone()));
        }
        news
    }

    /// A failsafe does not bring the hand back: the drone falls as it would.
    fn follow(&mut self, rig: &mut Rig, state: StateKind) {
        self.state = Some(state);
        let held = rig.environment().drone().held();
        match state {
            StateKind::Active if held => rig.release(self.rate_rad_s),
            StateKind::Active | StateKind::Failsafe => {}
            _ if !held => {
                rig.environment_mut().catch();
                rig.environment_mut().tilt_clamp(self.start_rad);
            }
            _ => {}
        }
    }

    /// Where the flight stands, by the last heartbeat.
    pub fn state(&self) -> Option<StateKind> {
        self.state
    }
}

/// What the rudder does about the tilt, as a person beside the drone sees it.
fn describe(drone: &Drone) -> String {
    let nose = |up: bool| if up { "up" } else { "down" };
    let (pitch, rudder) = (drone.pitch_rad(), drone.rudder_rad());
    // A rudder at a positive angle pushes the nose down.
    let verdict = match rudder {
        _ if rudder.abs() < 0.02 => "does not answer".to_owned(),
        _ if (pitch > 0.0) == (rudder > 0.0) => {
            format!("pushes it {}, as it should", nose(pitch < 0.0))
        }
        _ => format!("pushes it further {}: the wrong way", nose(pitch > 0.0)),
    };
    format!("the nose is {}; the rudder {verdict}", nose(pitch > 0.0))
}
