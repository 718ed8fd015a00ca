//! The control steps of a log, and what happened between them, in the vehicle's own order.
//!
//! Every step sends ATTITUDE_QUATERNION, SERVO_OUTPUT_RAW, RAW_IMU if it had a sample, and
//! NAMED_VALUE_FLOAT with the command, one behind the other; answers and events lie between two
//! steps in the firmware's order. Once a second V2_EXTENSION tells in parts what the flight
//! remembers after a step. A step without RAW_IMU missed its sample, unless frames are missing
//! there.

use client::status::angles;
use client::{LinkCounts, text};
use mavlink::dialects::common::{
    ATTITUDE_QUATERNION_DATA, COMMAND_ACK_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage,
    MavParamType, MavResult, MavSeverity, MavType, NAMED_VALUE_FLOAT_DATA, PARAM_VALUE_DATA,
    SERVO_OUTPUT_RAW_DATA, STATUSTEXT_DATA, SYS_STATUS_DATA, V2_EXTENSION_DATA,
};

use tvc_nano::telemetry::{CRANKS, MEMORY_TYPE, MEMORY_WORDS, PART_WORDS, raw_imu};
use tvc_nano::{Axis, Micros, Params, RawSample};

use super::{Entry, Log, Origin, whole_us};

/// Most events between a step and the last part of the memory after it: a slow link holds parts up.
const MEMORY_LAG: usize = 200;
/// No clock of a vehicle gets to this time, us, some nine years: it is of a damaged log.
const LATEST_US: u64 = 1 << 48;

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
    #[cfg(test)]
    pub fn level(now_us: u64) -> Self {
        Self {
            now_us,
            sample: Some(RawSample {
                time: Micros(now_us),
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
    /// What has come of the memory so far.
    pub(in crate::logs) memory: Vec<i32>,
}

/// The messages of a step that have come so far.
#[derive(Clone, Copy, Debug)]
struct Part {
    quaternion: [f32; 4],
    rate_rad_s: [f32; 3],
    servo: Option<(u32, [u16; Axis::COUNT])>,
    sample: Option<RawSample>,
    cranks_rad: [Option<f32>; Axis::COUNT],
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
        let mut flight = Self {
            counts: log.counts,
            origin: Origin::of(&log.entries),
            ..Self::default()
        };
        let mut part = None;
        let mut clock = None;
        for entry in log.entries.iter().filter(|entry| entry.from_vehicle) {
            if entry.lost_before > 0 {
                flight.close(part.take(), &mut clock, true);
                flight.events.push(Event::Gap(entry.lost_before));
            }
            flight.take(entry, &mut part, &mut clock);
        }
        flight.close(part, &mut clock, true);
        flight
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

    fn take(&mut self, entry: &Entry, part: &mut Option<Part>, clock: &mut Option<u64>) {
        let event = match &entry.message {
            MavMessage::SERVO_OUTPUT_RAW(m) => {
                if let Some(part) = part {
                    part.servo = Some((m.time_usec, [m.servo1_raw, m.servo2_raw]));
                }
                return;
            }
            MavMessage::RAW_IMU(m) => {
                if let Some(part) = part
                    && m.time_usec < LATEST_US
                {
                    part.sample = Some(RawSample {
                        time: Micros(m.time_usec),
                        acc: [m.xacc, m.yacc, m.zacc],
                        gyr: [m.xgyro, m.ygyro, m.zgyro],
                        mag: [m.xmag, m.ymag, m.zmag],
                    });
                }
                return;
            }
            MavMessage::NAMED_VALUE_FLOAT(m) => {
                let axis = CRANKS.iter().position(|name| text(&m.name) == *name);
                if let Some(part) = part
                    && let Some(axis) = axis
                {
                    part.cranks_rad[axis] = Some(m.value);
                }
                return;
            }
            MavMessage::V2_EXTENSION(m) => {
                self.close(part.take(), clock, false);
                self.remember(m);
                return;
            }
            MavMessage::ATTITUDE_QUATERNION(m) => {
                self.close(part.take(), clock, false);
                *part = Some(Part {
                    quaternion: [m.q1, m.q2, m.q3, m.q4],
                    rate_rad_s: [m.rollspeed, m.pitchspeed, m.yawspeed],
                    servo: None,
                    sample: None,
                    cranks_rad: [None; 2],
                });
                return;
            }
            MavMessage::HEARTBEAT(m) => Event::State(m.custom_mode),
            MavMessage::STATUSTEXT(m) => Event::Said(m.severity, text(&m.text).to_owned()),
            MavMessage::PARAM_VALUE(m) => {
                Event::Parameter(text(&m.param_id).to_owned(), m.param_value)
            }
            MavMessage::SYS_STATUS(m) => Event::Status(m.clone()),
            MavMessage::COMMAND_ACK(m) => Event::Answer(m.command, m.result),
            _ => return,
        };
        self.close(part.take(), clock, false);
        self.events.push(event);
    }

    /// A part of the memory. What is whole belongs behind its step, a few steps back.
    fn remember(&mut self, told: &V2_EXTENSION_DATA) {
        let part = usize::from(told.message_type.wrapping_sub(MEMORY_TYPE));
        if part == 0 {
            self.memory.clear();
        }
        if self.memory.len() != part * PART_WORDS {
            return;
        }
        let words = told.payload.chunks_exact(4).take(PART_WORDS);
        let words = words.filter_map(|word| Some(i32::from_le_bytes(word.try_into().ok()?)));
        let missing = MEMORY_WORDS.saturating_sub(self.memory.len());
        self.memory.extend(words.take(missing));
        let [time_us, words @ ..] = &self.memory[..] else {
            return;
        };
        let its = |event: &Event| match event {
            Event::Step(step) => step.sample.is_some() && step.now_us as u32 == *time_us as u32,
            _ => false,
        };
        let mut recent = self.events.iter().rev().take(MEMORY_LAG);
        if self.memory.len() == MEMORY_WORDS
            && let Some(back) = recent.position(its)
        {
            let memory = Event::Memory(words.to_vec());
            self.events.insert(self.events.len() - back, memory);
        }
    }

    /// A step whose messages have all come. One at a gap may have lost its sample's message, and
    /// counts only with it.
    fn close(&mut self, part: Option<Part>, clock: &mut Option<u64>, at_gap: bool) {
        let Some(part) = part else { return };
        let Some((time_us, pulses_us)) = part.servo else {
            return;
        };
        if at_gap && part.sample.is_none() {
            return;
        }
        let sampled_us = part.sample.map(|sample| sample.time.0);
        let now_us = whole_us(time_us, sampled_us.or(*clock).unwrap_or(0));
        *clock = Some(now_us);
        self.events.push(Event::Step(Step {
            now_us,
            sample: part.sample,
            quaternion: part.quaternion,
            rate_rad_s: part.rate_rad_s,
            cranks_rad: part.cranks_rad,
            pulses_us,
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
        MavMessage::RAW_IMU(RAW_IMU_DATA {
            time_usec,
            zacc: -981,
            ..RAW_IMU_DATA::default()
        })
    }

    fn flight(messages: Vec<(MavMessage, u64)>) -> Flight {
        let entry = |(message, lost_before)| Entry {
            time_us: 0,
            from_vehicle: true,
            message,
            lost_before,
        };
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
            let step = Step {
                quaternion: q.map(|part| part as f32),
                ..Step::level(0)
            };
            let roll = step.tilt_rad(Axis::Roll) - tilt * 0.75_f64.sqrt();
            let pitch = step.tilt_rad(Axis::Pitch) - tilt * 0.5;
            assert!(
                roll.abs() < 1e-6 && pitch.abs() < 1e-6,
                "{heading}: {roll} {pitch}"
            );
        }
        assert_eq!(Step::level(0).tilt_rad(Axis::Roll), 0.0);
    }

    #[test]
    fn a_step_without_counts_missed_its_sample_unless_frames_are_missing() {
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 3,
            ..HEARTBEAT_DATA::default()
        });
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
        let steps: Vec<_> = flight
            .steps()
            .map(|step| (step.now_us, step.sample.is_some()))
            .collect();
        assert_eq!(steps, [(5_000, true), (15_000, false), (55_000, true)]);
        assert_eq!((flight.missed(), flight.lost()), (1, 4));
        assert_eq!(flight.events[2], Event::State(3));
    }

    #[test]
    fn a_flight_told_in_messages_is_the_same_flight() {
        let step = Step {
            now_us: 9_500,
            sample: Some(RawSample {
                time: Micros(5_000),
                acc: [1, 2, -981],
                gyr: [4, 5, 6],
                mag: [7, 8, -9],
            }),
            quaternion: [0.5, -0.5, 0.5, 0.5],
            rate_rad_s: [0.1, 0.2, 0.3],
            cranks_rad: [Some(0.25), None],
            pulses_us: [1_600, 0],
        };
        let missed = Step {
            now_us: 16_167,
            sample: None,
            ..step
        };
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
