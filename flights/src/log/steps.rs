//! The control steps of a log, and what happened between them, in the vehicle's own order.
//!
//! Every step sends ATTITUDE_QUATERNION, SERVO_OUTPUT_RAW, RAW_IMU if it had a sample, and
//! NAMED_VALUE_FLOAT with the command, one behind the other; answers and events lie between two
//! steps in the firmware's order. Once a second V2_EXTENSION tells in parts what the flight
//! remembers after a step. A step without RAW_IMU missed its sample, unless frames are missing
//! there.

use std::path::Path;

use anyhow::Result;
use client::LinkCounts;
use client::status::angles;
use mavlink::dialects::common::{
    ATTITUDE_QUATERNION_DATA, COMMAND_ACK_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage,
    MavParamType, MavResult, MavSeverity, MavType, NAMED_VALUE_FLOAT_DATA, PARAM_VALUE_DATA,
    SERVO_OUTPUT_RAW_DATA, STATUSTEXT_DATA, SYS_STATUS_DATA,
};
use tvc_nano::telemetry::{CRANKS, raw_imu};
use tvc_nano::{Axis, Params, RawSample};

use super::assembly::Assembly;
use super::{Log, Origin, each_message};

/// One control step as telemetry tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The vehicle's clock at the step, us.
    pub now_us: u64,
    /// The untouched counts with their own time, if there was a usable sample.
    pub sample: Option<RawSample>,
    /// Attitude `[w, x, y, z]`, body to north-east-down.
    pub quaternion: [f32; 4],
    /// Rates about the body's axes, rad/s.
    pub rate_rad_s: [f32; 3],
    /// Crank angles that control asked for, before limits, by axis, rad, where they were told.
    pub cranks_rad: [Option<f32>; Axis::COUNT],
    /// Pulses commanded, by axis, us; 0 for an axis that is not steered.
    pub pulses_us: [u16; Axis::COUNT],
}

impl Step {
    /// Level and at rest, with a sample of the same time: what tests begin with.
    pub fn level(now_us: u64) -> Self {
        Self {
            now_us,
            sample: Some(RawSample {
                time: tvc_nano::Micros(now_us),
                acc: [0, 0, -981],
                gyr: [0; 3],
                mag: [200, 0, 400],
            }),
            quaternion: [1.0, 0.0, 0.0, 0.0],
            rate_rad_s: [0.0; 3],
            cranks_rad: [None; 2],
            pulses_us: [1524, 0],
        }
    }

    /// The vehicle's clock, s.
    pub fn time_s(&self) -> f64 {
        self.now_us as f64 * 1e-6
    }

    /// Pitch, nose up, rad.
    pub fn pitch_rad(&self) -> f64 {
        let [w, x, y, z] = self.quaternion.map(f64::from);
        (2.0 * (w * y - x * z)).clamp(-1.0, 1.0).asin()
    }

    /// The tilt as a vector in the body's axes, as a vehicle with two axes controls it: its part
    /// about an axis, rad.
    pub fn tilt_rad(&self, axis: Axis) -> f64 {
        let [w, x, y, z] = self.quaternion.map(f64::from);
        let angle = 2.0 * x.hypot(y).atan2(w.hypot(z));
        // What is left of the attitude without its turn about the vertical.
        let (about_x, about_y) = (w * x + z * y, w * y - z * x);
        let size = about_x.hypot(about_y);
        let part = match axis {
            Axis::Pitch => about_y,
            Axis::Roll => about_x,
        };
        if size > 0.0 { angle * part / size } else { 0.0 }
    }

    /// Roll, right side down, rad.
    pub fn roll_rad(&self) -> f64 {
        angles(self.quaternion.map(f64::from))[0]
    }

    /// The messages of the step, in the vehicle's order.
    fn messages(&self) -> Vec<MavMessage> {
        let [q1, q2, q3, q4] = self.quaternion;
        let [rollspeed, pitchspeed, yawspeed] = self.rate_rad_s;
        let time_us = self.sample.map_or(self.now_us, |sample| sample.time.0);
        let time_boot_ms = (time_us / 1000) as u32;
        let mut messages = vec![
            MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                time_boot_ms,
                q1,
                q2,
                q3,
                q4,
                rollspeed,
                pitchspeed,
                yawspeed,
            }),
            MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
                time_usec: self.now_us as u32,
                servo1_raw: self.pulses_us[0],
                servo2_raw: self.pulses_us[1],
                ..SERVO_OUTPUT_RAW_DATA::default()
            }),
        ];
        if let Some(sample) = &self.sample {
            messages.push(MavMessage::RAW_IMU(raw_imu(sample)));
        }
        for (crank, name) in self.cranks_rad.into_iter().zip(CRANKS) {
            messages.extend(crank.map(|value| {
                MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
                    time_boot_ms,
                    value,
                    name: name.into(),
                })
            }));
        }
        messages
    }
}

/// An event of a log.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A control step.
    Step(Step),
    /// What the flight remembers after the step before.
    Memory(Vec<i32>),
    /// Frames are missing here: their number.
    Gap(u64),
    /// The state, as HEARTBEAT's `custom_mode` has it, each time it is told.
    State(u32),
    /// A text for people.
    Said(MavSeverity, String),
    /// A parameter's value, as the vehicle tells it.
    Parameter(String, f32),
    /// Load and health.
    Status(SYS_STATUS_DATA),
    /// An answer to a command.
    Answer(MavCmd, MavResult),
}

impl Event {
    /// The messages that the vehicle sends for it; none for a gap, and none for the memory.
    pub fn messages(&self) -> Vec<MavMessage> {
        match self {
            Self::Step(step) => step.messages(),
            Self::Gap(_) | Self::Memory(_) => Vec::new(),
            Self::State(custom_mode) => vec![MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                custom_mode: *custom_mode,
                mavtype: MavType::MAV_TYPE_ROCKET,
                autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
                mavlink_version: 3,
                ..HEARTBEAT_DATA::default()
            })],
            Self::Said(severity, text) => vec![MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity: *severity,
                text: text.as_str().into(),
            })],
            Self::Parameter(name, value) => vec![MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                param_id: name.as_str().into(),
                param_value: *value,
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
                ..PARAM_VALUE_DATA::default()
            })],
            Self::Status(status) => vec![MavMessage::SYS_STATUS(status.clone())],
            Self::Answer(command, result) => vec![MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command: *command,
                result: *result,
            })],
        }
    }
}

/// A log as a flight.
#[derive(Clone, Debug, Default)]
pub struct Flight {
    /// What happened.
    pub events: Vec<Event>,
    /// Counts of the link.
    pub counts: LinkCounts,
    /// Where the log comes from.
    pub origin: Origin,
}

impl Flight {
    /// The parameters that the flight began with: the first value that is reported of each.
    pub fn parameters(&self) -> Params {
        let mut params = Params::default();
        // A vehicle that knew nothing of this check was armed without it.
        let _ = params.set("SRV_POLARITY", 1.0);
        for event in self.events.iter().rev() {
            if let Event::Parameter(name, value) = event {
                // One that this version does not know, or not with that value, stays at its
                // default.
                let _ = params.set(name, *value);
            }
        }
        params
    }

    /// Puts the messages of a log together.
    pub fn of(log: &Log) -> Self {
        let mut assembly = Assembly::default();
        for entry in &log.entries {
            assembly.take(entry);
        }
        assembly.end(log.counts)
    }

    /// Puts the messages of a log together as they are read.
    ///
    /// # Errors
    /// As [`Log::read`].
    pub fn read(path: &Path) -> Result<Self> {
        let mut assembly = Assembly::default();
        let counts = each_message(path, |entry| assembly.take(&entry))?;
        Ok(assembly.end(counts))
    }

    /// The steps.
    pub fn steps(&self) -> impl Iterator<Item = &Step> {
        self.events.iter().filter_map(|event| match event {
            Event::Step(step) => Some(step),
            _ => None,
        })
    }

    /// Frames that are missing.
    pub fn lost(&self) -> u64 {
        let gaps = self.events.iter().map(|event| match event {
            Event::Gap(lost) => *lost,
            _ => 0,
        });
        gaps.sum()
    }

    /// Steps without a usable sample.
    pub fn missed(&self) -> usize {
        self.steps().filter(|step| step.sample.is_none()).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Entry;
    use mavlink::dialects::common::RAW_IMU_DATA;

    fn attitude() -> MavMessage {
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            q1: 1.0,
            ..ATTITUDE_QUATERNION_DATA::default()
        })
    }

    fn servo(time_usec: u32) -> MavMessage {
        MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
            time_usec,
            servo1_raw: 1524,
            ..SERVO_OUTPUT_RAW_DATA::default()
        })
    }

    fn raw(time_usec: u64) -> MavMessage {
        MavMessage::RAW_IMU(RAW_IMU_DATA { time_usec, zacc: -981, ..RAW_IMU_DATA::default() })
    }

    fn flight(messages: Vec<(MavMessage, u64)>) -> Flight {
        let entry =
            |(message, lost_before)| Entry { time_us: 0, from_vehicle: true, message, lost_before };
        Flight::of(&Log {
            entries: messages.into_iter().map(entry).collect(),
            counts: LinkCounts::default(),
        })
    }

    /// Turned by a heading and then tilted by 0.4 rad about an axis 30 deg from the body's x
    /// towards its y, whatever the heading is, beyond 90 deg too.
    #[test]
    fn the_tilt_is_a_vector_in_the_bodys_axes() {
        for (heading, tilt) in [(0.0_f64, 0.4_f64), (2.0, 0.4), (-1.0, 2.0)] {
            let ((sin, cos), (z, w)) = ((0.5 * tilt).sin_cos(), (0.5 * heading).sin_cos());
            let (x, y) = (sin * 0.75_f64.sqrt(), sin * 0.5);
            let q = [w * cos, w * x - z * y, w * y + z * x, z * cos];
            let step = Step { quaternion: q.map(|part| part as f32), ..Step::level(0) };
            let roll = step.tilt_rad(Axis::Roll) - tilt * 0.75_f64.sqrt();
            let pitch = step.tilt_rad(Axis::Pitch) - tilt * 0.5;
            assert!(roll.abs() < 1e-6 && pitch.abs() < 1e-6, "{heading}: {roll} {pitch}");
        }
        assert_eq!(Step::level(0).tilt_rad(Axis::Roll), 0.0);
    }

    #[test]
    fn a_step_without_counts_missed_its_sample_unless_frames_are_missing() {
        let beat =
            MavMessage::HEARTBEAT(HEARTBEAT_DATA { custom_mode: 3, ..HEARTBEAT_DATA::default() });
        let flight = flight(vec![
            (attitude(), 0),
            (servo(5_000), 0),
            (raw(1_000), 0),
            (attitude(), 0),
            (servo(15_000), 0),
            (beat, 0),
            (attitude(), 0),
            (servo(25_000), 0),
            (attitude(), 4),
            (servo(55_000), 0),
            (raw(51_000), 0),
        ]);
        let steps: Vec<_> =
            flight.steps().map(|step| (step.now_us, step.sample.is_some())).collect();
        assert_eq!(steps, [(5_000, true), (15_000, false), (55_000, true)]);
        assert_eq!((flight.missed(), flight.lost()), (1, 4));
        assert_eq!(flight.events[2], Event::State(3));
    }

    #[test]
    fn a_flight_told_in_messages_is_the_same_flight() {
        let step = Step {
            now_us: 9_500,
            sample: Some(RawSample {
                time: tvc_nano::Micros(5_000),
                acc: [1, 2, -981],
                gyr: [4, 5, 6],
                mag: [7, 8, -9],
            }),
            quaternion: [0.5, -0.5, 0.5, 0.5],
            rate_rad_s: [0.1, 0.2, 0.3],
            cranks_rad: [Some(0.25), None],
            pulses_us: [1_600, 0],
        };
        let missed = Step { now_us: 16_167, sample: None, ..step };
        let events = vec![
            Event::Parameter("PID_KP".into(), 1.5),
            Event::State(4),
            Event::Step(step),
            Event::Step(missed),
            Event::Said(MavSeverity::MAV_SEVERITY_INFO, "active".into()),
            Event::Answer(MavCmd::MAV_CMD_DO_GRIPPER, MavResult::MAV_RESULT_ACCEPTED),
            Event::Status(SYS_STATUS_DATA::default()),
        ];
        let messages = events.iter().flat_map(Event::messages);
        let told = flight(messages.map(|message| (message, 0)).collect());
        assert_eq!(told.events, events);
        assert!(Event::Gap(3).messages().is_empty());
    }
}
