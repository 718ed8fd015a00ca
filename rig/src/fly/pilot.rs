//! The person at the rig, who opens the clamp when the firmware reports that it is in control and
//! takes the drone back to its start when that ends. The pilot also reads what the program at the
//! port sends, and moves sensor and drone as a calibration asks for.

use crate::bench::sensor_motion::{SensorMotion, resting};
use crate::rig::Rig;
use calibration::prompt::{Prompt, Tilt};
use client::state::state_of;
use client::{StateKind, Wire, request, text};
use mavlink::dialects::common::MavMessage;
use nalgebra::UnitQuaternion;
use plant::Drone;
use samd21::board::Ticks;

/// How far the drone is tilted to see its rudder react, rad.
const TILT_RAD: f64 = 0.35;
/// How long the sensor takes from one pose to the next, s.
const TURN_S: f64 = 1.5;
/// Amplitude of the rate of a sensor that is held unsteadily, rad/s.
const TREMBLE_RAD_S: f64 = 0.08;
/// From the request to tilt the drone until its rudder rests.
const RUDDER_RESTS: Ticks = Ticks::from_ms(1300);

/// How well the pilot does what a calibration asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Manner {
    /// Does what it is asked.
    #[default]
    Steady,
    /// Never lets go of the sensor.
    Trembling,
    /// Turns the sensor about one axis alone.
    Lazy,
}

/// The person who holds the clamp and reads what the image and its ground station send.
#[derive(Clone, Debug)]
pub struct Pilot {
    link: Wire,
    station: Wire,
    manner: Manner,
    start_rad: f64,
    rate_rad_s: f64,
    state: Option<StateKind>,
    /// When to look at the rudder of the tilted drone.
    check_rudder_at: Option<Ticks>,
}

impl Pilot {
    /// Releases the drone from the tilt `start_rad`, rad, with a rate of `rate_rad_s`, rad/s.
    pub fn new(start_rad: f64, rate_rad_s: f64) -> Self {
        Self {
            link: Wire::default(),
            station: Wire::default(),
            manner: Manner::default(),
            start_rad,
            rate_rad_s,
            state: None,
            check_rudder_at: None,
        }
    }

    /// Does what a calibration asks for in this manner.
    pub fn with_manner(mut self, manner: Manner) -> Self {
        self.manner = manner;
        self
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
        if let Prompt::Tilt(Tilt::NoseUp | Tilt::NoseDown) = prompt {
            self.check_rudder_at = Some(rig.now() + RUDDER_RESTS);
        }
        let environment = rig.environment_mut();
        match prompt {
            Prompt::Rest if self.manner == Manner::Trembling => {
                environment.move_sensor(SensorMotion::Tremble(TREMBLE_RAD_S));
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
            Prompt::Tilt(tilt) => environment.tilt_clamp(match tilt {
                Tilt::NoseUp => TILT_RAD,
                Tilt::NoseDown => -TILT_RAD,
                Tilt::Upright => 0.0,
            }),
            Prompt::Done => {
                environment.put_back();
                environment.tilt_clamp(self.start_rad);
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
        if self.check_rudder_at.is_some_and(|due| rig.now() >= due) {
            self.check_rudder_at = None;
            lines.push(describe(rig.environment().drone()));
        }
        lines
    }

    /// After a failsafe the drone is not caught: it falls as it would.
    fn follow_state(&mut self, rig: &mut Rig, state: StateKind) {
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

    /// The firmware's state, by the last heartbeat.
    pub fn state(&self) -> Option<StateKind> {
        self.state
    }
}

/// How the rudder answers the tilt, as a person beside the drone sees it.
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
