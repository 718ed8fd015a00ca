//! Logs as MCAP, which Foxglove and PlotJuggler open: the untouched frames on one topic, so that
//! nothing is lost, and the content of the vehicle's frames as JSON on others.
//!
//! Messages that carry the vehicle's clock are stamped by it, offset to the host's clock at the
//! first of them; so plots do not show the jitter of the host's reading. Frames are stamped with
//! the time at which they came, as in a `.tlog`.

use std::collections::BTreeMap;
use std::fs::File;

use anyhow::{Result, bail};
use client::state::state_name;
use client::status::angles;
use client::{Wire, text};
use mavlink::dialects::common::{ATTITUDE_QUATERNION_DATA, MavMessage, MavSeverity};
use mcap::records::{MessageHeader, Metadata, Record, op};
use mcap::{McapError, McapResult, WriteOptions, parse_record};
use nalgebra::{Quaternion, UnitQuaternion};
use serde_json::{Value, json};
use tvc_nano::telemetry::CRANKS;

use super::origin::vehicle_build;
use super::{STAMP, is_from_vehicle, whole_us};

/// How such a file begins.
pub const MAGIC: &[u8] = mcap::MAGIC;

/// Topic of the untouched frames, both ways.
const FRAMES: &str = "/mavlink";
/// Their encoding; MCAP has no registered name for it.
const FRAME_ENCODING: &str = "x-mavlink2";
/// Size of a chunk, bytes: at most this is lost if the program is killed, a fifth of a second.
const CHUNK_BYTES: u64 = 32 * 1024;
/// Time between two transforms for three-dimensional views, us; plots have the attitude of every
/// step.
const TRANSFORM_US: u64 = 30_000;
/// Difference of the clocks from which the vehicle counts as restarted, us.
const CLOCK_STEP_US: u64 = 1_000_000;

/// A file that is being written.
pub struct Writer {
    file: mcap::Writer<File>,
    frames: u16,
    /// The channels of the topics that have a message.
    topics: BTreeMap<&'static str, u16>,
    vehicle: Wire,
    clock: Clock,
    transform_due_us: u64,
    /// What keeps it.
    tool: String,
    /// What the vehicle said of its build and its parameters, for the metadata at the end.
    build: Option<String>,
    parameters: BTreeMap<String, String>,
}

impl Writer {
    /// Begins to write a file, kept by `tool`.
    pub fn new(file: File, tool: &str) -> Result<Self, McapError> {
        let options = WriteOptions::new()
            .library(concat!("tvc ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let mut file = options.create(file)?;
        let frames = file.add_channel(0, FRAMES, FRAME_ENCODING, &BTreeMap::new())?;
        Ok(Self {
            file,
            frames,
            topics: BTreeMap::new(),
            vehicle: Wire::default(),
            clock: Clock::default(),
            transform_due_us: 0,
            tool: tool.to_owned(),
            build: None,
            parameters: BTreeMap::new(),
        })
    }

    /// Writes a frame that came at `time_us` since 1970, and its content.
    pub fn write(&mut self, time_us: u64, frame: &[u8]) -> Result<(), McapError> {
        self.put(self.frames, time_us, frame)?;
        if !is_from_vehicle(frame) {
            return Ok(());
        }
        let lost = self.vehicle.counts().lost;
        let received = self.vehicle.receive_frames(frame);
        let lost = self.vehicle.counts().lost - lost;
        if lost > 0 {
            let text = format!("{lost} frames are missing");
            self.say(time_us, MavSeverity::MAV_SEVERITY_WARNING, &text)?;
        }
        for frame in received {
            self.tell(time_us, &frame.message)?;
        }
        Ok(())
    }

    /// Ends the file with its metadata and its index.
    pub fn end(mut self) -> Result<(), McapError> {
        let mut origin = BTreeMap::from([("written by".to_owned(), self.tool)]);
        origin.extend(self.build.map(|build| ("vehicle".to_owned(), build)));
        for (name, metadata) in [("origin", origin), ("parameters", self.parameters)] {
            let name = name.to_owned();
            self.file.write_metadata(&Metadata { name, metadata })?;
        }
        self.file.finish().map(drop)
    }

    fn tell(&mut self, received_us: u64, message: &MavMessage) -> Result<(), McapError> {
        let time_us = self.clock.time_us(received_us, message);
        let (topic, value) = match message {
            MavMessage::ATTITUDE_QUATERNION(m) => {
                let [roll, pitch, yaw] =
                    angles([m.q1, m.q2, m.q3, m.q4].map(f64::from)).map(f64::to_degrees);
                let rate = [m.rollspeed, m.pitchspeed, m.yawspeed].map(f32::to_degrees);
                if time_us >= self.transform_due_us {
                    self.transform_due_us = time_us.saturating_add(TRANSFORM_US);
                    self.json(("/tf", "foxglove.FrameTransform"), time_us, &transform(time_us, m))?;
                }
                let value = json!({
                    "q_w": m.q1, "q_x": m.q2, "q_y": m.q3, "q_z": m.q4,
                    "roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw,
                    "roll_rate_deg_s": rate[0], "pitch_rate_deg_s": rate[1], "yaw_rate_deg_s": rate[2],
                });
                (("/attitude", "tvc.Attitude"), value)
            }
            MavMessage::SERVO_OUTPUT_RAW(m) => (
                ("/servo", "tvc.Servo"),
                json!({ "pulse_us": m.servo1_raw, "pulse2_us": m.servo2_raw }),
            ),
            MavMessage::RAW_IMU(m) => {
                let value = json!({
                    "acc_x": m.xacc, "acc_y": m.yacc, "acc_z": m.zacc,
                    "gyr_x": m.xgyro, "gyr_y": m.ygyro, "gyr_z": m.zgyro,
                    "mag_x": m.xmag, "mag_y": m.ymag, "mag_z": m.zmag,
                });
                (("/counts", "tvc.Counts"), value)
            }
            MavMessage::NAMED_VALUE_FLOAT(m) if text(&m.name) == CRANKS[0] => {
                (("/command", "tvc.Command"), json!({ "crank_deg": m.value.to_degrees() }))
            }
            MavMessage::HEARTBEAT(m) => {
                let state = state_name(m.custom_mode);
                (("/state", "tvc.State"), json!({ "state": state, "code": m.custom_mode }))
            }
            MavMessage::SYS_STATUS(m) => {
                let value = json!({
                    "load": f64::from(m.load) / 1000.0,
                    "dropped": m.errors_count1, "missed": m.errors_count2,
                    "bus_errors": m.errors_count3, "bus_recoveries": m.errors_count4,
                });
                (("/health", "tvc.Health"), value)
            }
            MavMessage::PARAM_VALUE(m) => {
                let name = text(&m.param_id);
                self.parameters.insert(name.to_owned(), m.param_value.to_string());
                (("/parameter", "tvc.Parameter"), json!({ "name": name, "value": m.param_value }))
            }
            MavMessage::AUTOPILOT_VERSION(m) => {
                self.build = Some(vehicle_build(m));
                return Ok(());
            }
            MavMessage::STATUSTEXT(m) => return self.say(time_us, m.severity, text(&m.text)),
            _ => return Ok(()),
        };
        self.json(topic, time_us, &value)
    }

    fn say(&mut self, time_us: u64, severity: MavSeverity, text: &str) -> Result<(), McapError> {
        // Foxglove's levels: 2 information, 3 warning, 4 error, 5 fatal.
        let level = match severity {
            MavSeverity::MAV_SEVERITY_EMERGENCY | MavSeverity::MAV_SEVERITY_ALERT => 5,
            MavSeverity::MAV_SEVERITY_CRITICAL | MavSeverity::MAV_SEVERITY_ERROR => 4,
            MavSeverity::MAV_SEVERITY_WARNING => 3,
            _ => 2,
        };
        let value = json!({
            "timestamp": timestamp(time_us), "level": level, "message": text,
            "name": "vehicle", "file": "", "line": 0,
        });
        self.json(("/log", "foxglove.Log"), time_us, &value)
    }

    /// Writes a message of a topic, whose first one gives the schema.
    fn json(
        &mut self,
        (topic, schema): (&'static str, &str),
        time_us: u64,
        value: &Value,
    ) -> Result<(), McapError> {
        let channel = match self.topics.get(topic) {
            Some(channel) => *channel,
            None => {
                let fields = schema_of(value).to_string();
                let schema = self.file.add_schema(schema, "jsonschema", fields.as_bytes())?;
                let channel = self.file.add_channel(schema, topic, "json", &BTreeMap::new())?;
                *self.topics.entry(topic).or_insert(channel)
            }
        };
        self.put(channel, time_us, value.to_string().as_bytes())
    }

    fn put(&mut self, channel_id: u16, time_us: u64, data: &[u8]) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time: time_us.saturating_mul(1000),
            publish_time: time_us.saturating_mul(1000),
        };
        self.file.write_to_known_channel(&header, data)
    }
}

/// The frames of a file as a `.tlog` has them, and why it could not be read to its end.
///
/// # Errors
/// Nothing of it can be read.
pub fn frames(bytes: &[u8]) -> Result<(Vec<u8>, Option<String>)> {
    let mut found = Found::default();
    match found.read(bytes).map_err(|error| words(&error)) {
        Err(why) if found.log.is_empty() => bail!("as MCAP: {why}"),
        read => Ok((found.log, read.err())),
    }
}

/// What is wrong, without the coloured trace of the parser that found it.
fn words(error: &McapError) -> String {
    match error {
        McapError::Parse(error) => format!("a record is damaged: {}", error.root_cause()),
        error => error.to_string(),
    }
}

/// What has been read of a file.
#[derive(Default)]
struct Found {
    /// The frames, as a `.tlog` has them.
    log: Vec<u8>,
    /// The channel that they are on.
    channel_id: Option<u16>,
}

impl Found {
    fn read(&mut self, bytes: &[u8]) -> McapResult<()> {
        let records = bytes.strip_prefix(MAGIC).ok_or(McapError::BadMagic)?;
        self.read_records(records, false)
    }

    /// The records of a file or of a chunk in it, up to the end of the data. The crate's own
    /// readers count beyond the end of a damaged chunk, and parse what is not needed here.
    fn read_records(&mut self, data: &[u8], in_chunk: bool) -> McapResult<()> {
        let mut rest = data;
        while let Some((opcode, behind)) = rest.split_first() {
            let (length, behind) = behind.split_first_chunk().ok_or(McapError::UnexpectedEof)?;
            let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
            let (body, behind) = behind.split_at_checked(length).ok_or(McapError::UnexpectedEof)?;
            match *opcode {
                op::DATA_END if !in_chunk => break,
                op::CHUNK if !in_chunk => self.read_chunk(body)?,
                op::CHANNEL | op::MESSAGE if are_texts_whole(*opcode, body) => {
                    self.take(parse_record(*opcode, body)?);
                }
                op::CHANNEL => return Err(McapError::UnexpectedEof),
                _ => {}
            }
            rest = behind;
        }
        Ok(())
    }

    fn read_chunk(&mut self, body: &[u8]) -> McapResult<()> {
        if !are_texts_whole(op::CHUNK, body) {
            return Err(McapError::UnexpectedEof);
        }
        match parse_record(op::CHUNK, body)? {
            Record::Chunk { header, data } if header.compression.is_empty() => {
                self.read_records(&data, true)
            }
            Record::Chunk { header, .. } => {
                Err(McapError::UnsupportedCompression(header.compression))
            }
            _ => Ok(()),
        }
    }

    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Channel(channel)
                if channel.topic == FRAMES && channel.message_encoding == FRAME_ENCODING =>
            {
                self.channel_id = Some(channel.id);
            }
            Record::Message { header, data } if Some(header.channel_id) == self.channel_id => {
                let stamp: [u8; STAMP] = (header.log_time / 1000).to_be_bytes();
                self.log.extend_from_slice(&stamp);
                self.log.extend_from_slice(&data);
            }
            _ => {}
        }
    }
}

/// Whether the texts of a record end in it. The crate makes room for as many bytes as a text says
/// that it has, up to 4 GiB, before it finds that they are not there.
fn are_texts_whole(opcode: u8, body: &[u8]) -> bool {
    /// Bytes of a channel before its texts: its number and that of its schema.
    const CHANNEL_HEAD: usize = 4;
    /// Bytes of a chunk before its text: two times, its size and its checksum.
    const CHUNK_HEAD: usize = 28;
    let whole = || match opcode {
        op::CHANNEL => {
            // Topic, encoding, and pairs of further texts.
            let rest = behind_text(body.get(CHANNEL_HEAD..)?)?;
            let (length, pairs) = behind_text(rest)?.split_first_chunk()?;
            let mut pairs = pairs.get(..u32::from_le_bytes(*length) as usize)?;
            while !pairs.is_empty() {
                pairs = behind_text(pairs)?;
            }
            Some(())
        }
        op::CHUNK => behind_text(body.get(CHUNK_HEAD..)?).map(drop),
        _ => Some(()),
    };
    whole().is_some()
}

/// What stands behind a text that `bytes` begin with: its length, then its bytes.
fn behind_text(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.get(u32::from_le_bytes(*length) as usize..)
}

/// The frames in the bytes of a broken file, as a `.tlog` has them: every record that looks like a
/// message with a frame in it, whatever stands before and behind.
pub fn salvaged(bytes: &[u8]) -> Vec<u8> {
    let mut log = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        rest = match message(rest) {
            Some((stamp, frame, behind)) => {
                log.extend_from_slice(&stamp);
                log.extend_from_slice(frame);
                behind
            }
            None => &rest[1..],
        };
    }
    log
}

/// Stamp and frame of the message record that `bytes` begin with, and what stands behind: opcode,
/// length of what follows, channel, sequence, two times in ns, the frame.
fn message(bytes: &[u8]) -> Option<([u8; STAMP], &[u8], &[u8])> {
    const HEADER: usize = 22;
    let (&opcode, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk()?;
    let (header, rest) = rest.split_first_chunk::<HEADER>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (frame, behind) = rest.split_at_checked(length.checked_sub(HEADER)?)?;
    if opcode != op::MESSAGE || Wire::frame_length(frame) != Some(frame.len()) {
        return None;
    }
    let time_ns = header.get(6..14)?.try_into().ok()?;
    Some(((u64::from_le_bytes(time_ns) / 1000).to_be_bytes(), frame, behind))
}

/// The vehicle's clock, offset to the host's.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    /// The same instant by the vehicle's clock and by the host's, us.
    set: Option<(u64, u64)>,
    /// The newest time of the vehicle.
    newest_us: u64,
}

impl Clock {
    /// The time of a message, us since 1970: by the vehicle's clock where it carries that, else
    /// when it came.
    fn time_us(&mut self, received_us: u64, message: &MavMessage) -> u64 {
        let vehicle_us = match message {
            MavMessage::ATTITUDE_QUATERNION(m) => u64::from(m.time_boot_ms) * 1000,
            MavMessage::NAMED_VALUE_FLOAT(m) => u64::from(m.time_boot_ms) * 1000,
            MavMessage::RAW_IMU(m) => m.time_usec,
            MavMessage::SERVO_OUTPUT_RAW(m) => whole_us(m.time_usec, self.newest_us),
            _ => return received_us,
        };
        self.newest_us = vehicle_us;
        if let Some((vehicle, host)) = self.set {
            let time_us = host.wrapping_add(vehicle_us).wrapping_sub(vehicle);
            if time_us.abs_diff(received_us) < CLOCK_STEP_US {
                return time_us;
            }
        }
        self.set = Some((vehicle_us, received_us));
        received_us
    }
}

/// The JSON schema of an object like this one. Of numbers, `null` stands for what is not finite.
fn schema_of(value: &Value) -> Value {
    let kind = |value: &Value| match value {
        Value::Object(_) => "object",
        Value::String(_) => "string",
        Value::Number(number) if !number.is_f64() => "integer",
        _ => "number",
    };
    let fields = value.as_object().into_iter().flatten();
    let properties: serde_json::Map<_, _> =
        fields.map(|(name, value)| (name.clone(), json!({ "type": kind(value) }))).collect();
    json!({ "type": "object", "properties": properties })
}

fn timestamp(time_us: u64) -> Value {
    json!({ "sec": time_us / 1_000_000, "nsec": time_us % 1_000_000 * 1000 })
}

/// The body's orientation for viewers, whose axes are east-north-up on the earth and
/// forward-left-up on the body (ROS REP 103).
fn transform(time_us: u64, attitude: &ATTITUDE_QUATERNION_DATA) -> Value {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let east_north_up = UnitQuaternion::new_unchecked(Quaternion::new(0.0, half, half, 0.0));
    let forward_left_up = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    let [w, x, y, z] = [attitude.q1, attitude.q2, attitude.q3, attitude.q4].map(f64::from);
    let body = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let shown = east_north_up * body * forward_left_up;
    json!({
        "timestamp": timestamp(time_us),
        "parent_frame_id": "earth",
        "child_frame_id": "body",
        "translation": { "x": 0.0, "y": 0.0, "z": 0.0 },
        "rotation": { "x": shown.i, "y": shown.j, "z": shown.k, "w": shown.w },
    })
}

#[cfg(test)]
mod tests;
