//! The messages of a log put together to a flight, in the order in which they come.

use client::{LinkCounts, text};
use mavlink::dialects::common::{MavMessage, V2_EXTENSION_DATA};
use tvc_nano::telemetry::{CRANKS, MEMORY_TYPE, MEMORY_WORDS, PART_WORDS};
use tvc_nano::{Micros, RawSample};

use super::{Entry, Event, Flight, Step, whole_us};

/// Most events between a step and the last part of the memory after it: a slow link holds parts up.
const MEMORY_LAG: usize = 200;
/// No clock of a vehicle gets to this time, us, some nine years: it is of a damaged log.
const LATEST_CLOCK_US: u64 = 1 << 48;

/// A flight that is being put together.
#[derive(Debug, Default)]
pub struct Assembly {
    flight: Flight,
    part: Option<Part>,
    /// The vehicle's clock at the step before, us.
    clock: Option<u64>,
    /// What has come of the memory so far.
    memory: Vec<i32>,
}

/// A step of which not all messages have come.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// What has come of it, without its time.
    step: Step,
    /// The lower bits of its time, us, once its pulses have come.
    low_us: Option<u32>,
}

impl Assembly {
    /// Takes the next message of the log.
    pub fn take(&mut self, entry: &Entry) {
        self.flight.origin.take(entry);
        if !entry.from_vehicle {
            return;
        }
        if entry.lost_before > 0 {
            self.close(true);
            self.flight.events.push(Event::Gap(entry.lost_before));
        }
        self.message(&entry.message);
    }

    /// The flight, with what was counted of its log.
    pub fn end(mut self, counts: LinkCounts) -> Flight {
        self.close(true);
        self.flight.counts = counts;
        self.flight
    }

    fn message(&mut self, message: &MavMessage) {
        let event = match message {
            MavMessage::SERVO_OUTPUT_RAW(m) => {
                if let Some(part) = &mut self.part {
                    part.low_us = Some(m.time_usec);
                    part.step.pulses_us = [m.servo1_raw, m.servo2_raw];
                }
                return;
            }
            MavMessage::RAW_IMU(m) => {
                if let Some(part) = &mut self.part
                    && m.time_usec < LATEST_CLOCK_US
                {
                    part.step.sample = Some(RawSample {
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
                if let Some(part) = &mut self.part
                    && let Some(axis) = axis
                {
                    part.step.cranks_rad[axis] = Some(m.value);
                }
                return;
            }
            MavMessage::V2_EXTENSION(m) => {
                self.close(false);
                self.remember(m);
                return;
            }
            MavMessage::ATTITUDE_QUATERNION(m) => {
                self.close(false);
                let step = Step {
                    now_us: 0,
                    sample: None,
                    quaternion: [m.q1, m.q2, m.q3, m.q4],
                    rate_rad_s: [m.rollspeed, m.pitchspeed, m.yawspeed],
                    cranks_rad: [None; 2],
                    pulses_us: [0; 2],
                };
                self.part = Some(Part { step, low_us: None });
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
        self.close(false);
        self.flight.events.push(event);
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
        let mut recent = self.flight.events.iter().rev().take(MEMORY_LAG);
        if self.memory.len() == MEMORY_WORDS
            && let Some(back) = recent.position(its)
        {
            let memory = Event::Memory(words.to_vec());
            self.flight.events.insert(self.flight.events.len() - back, memory);
        }
    }

    /// A step whose messages have all come. One at a gap may have lost its sample's message, and
    /// counts only with it.
    fn close(&mut self, at_gap: bool) {
        let Some(Part { step, low_us: Some(low_us) }) = self.part.take() else {
            return;
        };
        if at_gap && step.sample.is_none() {
            return;
        }
        let sampled_us = step.sample.map(|sample| sample.time.0);
        let now_us = whole_us(low_us, sampled_us.or(self.clock).unwrap_or(0));
        self.clock = Some(now_us);
        self.flight.events.push(Event::Step(Step { now_us, ..step }));
    }
}
