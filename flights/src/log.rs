//! Telemetry logs: every MAVLink frame, both ways, with its time. A file's name says its form.
//! `.tlog` has eight bytes of time (microseconds since 1970, big endian) before every frame, as
//! pymavlink, MAVProxy and QGroundControl write and read them. `.mcap`, for Foxglove and
//! PlotJuggler, holds the same frames and what they say.

mod assembly;
mod mcap;
mod origin;
mod reading;
mod release;
mod span;
mod steps;
mod table;
mod writer;

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Result;
use client::{LinkCounts, Wire};
use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use serde::Serialize;
use tvc_nano::config::{COMPONENT_ID, SYSTEM_ID};

use report::exit::BadInput;
use report::input;

pub use mcap::MAGIC as MCAP_MAGIC;
pub use origin::{Origin, vehicle_build};
pub use reading::each_message;
use reading::{Decoder, checked, each_frame};
pub use release::Release;
pub use span::span_us;
pub use steps::{Event, Flight, Step};
pub use table::write_csv;
pub use writer::Writer;

/// Bytes of time before a frame.
const STAMP: usize = 8;

/// A message of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// When it was written, us since 1970.
    pub time_us: u64,
    /// Whether the vehicle sent it; else a ground station did.
    pub from_vehicle: bool,
    /// What it says.
    pub message: MavMessage,
    /// Frames of the vehicle that are missing before this one.
    pub lost_before: u64,
}

/// A whole log.
#[derive(Clone, Debug, Default)]
pub struct Log {
    /// Its messages, in order.
    pub entries: Vec<Entry>,
    /// What was counted on the vehicle's side.
    pub counts: LinkCounts,
}

impl Log {
    /// Reads a log.
    ///
    /// # Errors
    /// [`BadInput`] if the file cannot be read or holds no messages of a vehicle.
    pub fn read(path: &Path) -> Result<Self> {
        let mut entries = Vec::new();
        let counts = each_message(path, |entry| entries.push(entry))?;
        Ok(Self { entries, counts })
    }

    /// As [`read`](Self::read), of the bytes that a `.tlog` at this path would have.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn of(bytes: &[u8], path: &Path) -> Result<Self> {
        let log = Self::parse(bytes);
        checked(log.counts, path)?;
        Ok(log)
    }

    /// A time of its clock, s since its first message; 0 for an earlier one.
    pub fn time_s(&self, time_us: u64) -> f64 {
        let begun_us = self.entries.first().map_or(0, |entry| entry.time_us);
        time_us.saturating_sub(begun_us) as f64 * 1e-6
    }

    /// From the first message to the last, s.
    pub fn length_s(&self) -> f64 {
        self.entries.last().map_or(0.0, |entry| self.time_s(entry.time_us))
    }

    /// The messages in the bytes of a log.
    pub fn parse(bytes: &[u8]) -> Self {
        let mut log = Self::default();
        let mut decoder = Decoder::default();
        let mut frames = Frames::of(bytes);
        for (time_us, frame) in &mut frames {
            decoder.take(time_us, frame, &mut |entry| log.entries.push(entry));
        }
        log.counts = decoder.counts(frames.stray_bytes);
        log
    }
}

/// Writes a log in another form, or its control steps as a table, as the new file's name says.
///
/// # Errors
/// [`BadInput`] if `from` is no log, or `to` is there already as a log or has no such form.
pub fn convert(from: &Path, to: &Path, tool: &str) -> Result<Content> {
    if is_table(to)? {
        let flight = Flight::read(from)?;
        write_csv(&flight, to)?;
        return Ok(Content::Steps(flight.steps().count()));
    }
    let mut writer = Writer::whole(to, tool)?;
    let (mut decoder, mut messages) = (Decoder::default(), 0);
    let stray_bytes = each_frame(from, |time_us, frame| {
        decoder.take(time_us, frame, &mut |_| messages += 1);
        writer.write_at(time_us, frame)
    })?;
    checked(decoder.counts(stray_bytes), from)?;
    writer.end()?;
    Ok(Content::Messages(messages))
}

/// How much has been written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Content {
    /// Messages of a log.
    Messages(usize),
    /// Rows of a table.
    Steps(usize),
}

/// Writes a flight that did not come over the link: as a log whose last step is now, or as a table.
///
/// # Errors
/// As [`convert`].
pub fn write_flight(flight: &Flight, to: &Path, tool: &str) -> Result<()> {
    if is_table(to)? {
        return write_csv(flight, to);
    }
    let header = MavHeader { system_id: SYSTEM_ID.into(), component_id: COMPONENT_ID, sequence: 0 };
    let time_us = |step: Option<&Step>| step.map_or(0, |step| step.now_us);
    let begin_us = now_us().saturating_sub(time_us(flight.steps().last()));
    let mut writer = Writer::whole(to, tool)?;
    // Events before the first step get the first step's time.
    let mut at_us = time_us(flight.steps().next());
    let mut sequence = 0;
    for event in &flight.events {
        if let Event::Step(step) = event {
            at_us = step.now_us;
        }
        for message in event.messages() {
            let mut raw = MAVLinkV2MessageRaw::new();
            raw.serialize_message(MavHeader { sequence, ..header }, &message);
            sequence = sequence.wrapping_add(1);
            writer.write_at(begin_us + at_us, raw.raw_bytes())?;
        }
    }
    writer.end()
}

/// Whether a file's name asks for a table, else for a log.
fn is_table(path: &Path) -> Result<bool> {
    let is_table = has_extension(path, "csv");
    if is_table || has_extension(path, "tlog") || has_extension(path, "mcap") {
        return Ok(is_table);
    }
    Err(BadInput::of(path, "the file's name must end in .tlog, .mcap or .csv").into())
}

/// Us since 1970.
fn now_us() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0, |since| since.as_micros() as u64)
}

/// The bytes of a log as a `.tlog` has them.
///
/// # Errors
/// [`BadInput`] if the file cannot be read.
pub fn tlog(path: &Path) -> Result<Vec<u8>> {
    let bytes = input::bytes(path, input::LOG).map_err(|error| unreadable(path, &error))?;
    tlog_of(bytes, path)
}

/// As [`tlog`], of a file's content. Standard error says why it could not be read to its end.
fn tlog_of(bytes: Vec<u8>, path: &Path) -> Result<Vec<u8>> {
    let (bytes, cut) = unpacked(bytes, path)?;
    if let Some(why) = cut {
        eprintln!("{} is read as far as it goes: {why}", path.display());
    }
    Ok(bytes)
}

/// As [`tlog`], of a file's content; also why it could not be read to its end.
///
/// # Errors
/// As [`tlog`].
pub fn unpacked(bytes: Vec<u8>, path: &Path) -> Result<(Vec<u8>, Option<String>)> {
    if !bytes.starts_with(MCAP_MAGIC) {
        return Ok((bytes, None));
    }
    let (bytes, cut) =
        mcap::frames(&bytes).map_err(|error| unreadable(path, &format!("{error:#}")))?;
    Ok((bytes, cut.map(|why| brief(&why))))
}

fn unreadable(path: &Path, why: &impl std::fmt::Display) -> BadInput {
    let why = brief(&why.to_string());
    BadInput::new(format!("cannot read {}: {why}", path.display()))
}

/// What looks like frames in a broken log, as a `.tlog` has them.
pub fn salvaged(bytes: &[u8]) -> Vec<u8> {
    let messages = mcap::salvaged(bytes);
    match messages.is_empty() {
        true => bytes.to_vec(),
        false => messages,
    }
}

/// The beginning of a parser's complaint, which may hold all that it did not understand.
fn brief(why: &str) -> String {
    const LONGEST: usize = 100;
    match why.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &why[..end]),
        None => why.to_owned(),
    }
}

/// Times, us since 1970, and frames in the bytes of a `.tlog`.
pub struct Frames<'a> {
    bytes: &'a [u8],
    /// With fewer bytes left the next frame is not looked for.
    enough: usize,
    /// Bytes that belong to no frame.
    stray_bytes: u64,
}

impl<'a> Frames<'a> {
    /// Of the bytes of a `.tlog`.
    pub fn of(bytes: &'a [u8]) -> Self {
        Self { bytes, enough: STAMP, stray_bytes: 0 }
    }
}

impl<'a> Iterator for Frames<'a> {
    type Item = (u64, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        while self.bytes.len() >= self.enough
            && let Some((stamp, rest)) = self.bytes.split_first_chunk::<STAMP>()
        {
            let length = Wire::frame_length(rest);
            let whole_at = length.and_then(|length| whole_inside(self.bytes, length));
            if let (Some(length), None) = (length, whole_at) {
                let (frame, rest) = rest.split_at(length);
                self.bytes = rest;
                return Some((u64::from_be_bytes(*stamp), frame));
            }
            // Not at a frame: look for the next one.
            let strays = whole_at.unwrap_or(1);
            self.bytes = &self.bytes[strays..];
            self.stray_bytes += if rest.is_empty() { 0 } else { strays as u64 };
        }
        None
    }
}

/// Where a whole frame with its time begins inside of a broken frame of `length` bytes, whose
/// time `bytes` begin with: the end of the broken frame is missing.
fn whole_inside(bytes: &[u8], length: usize) -> Option<usize> {
    let frame_at = |at: usize| {
        let rest = bytes.get(at + STAMP..)?;
        Wire::frame_length(rest).map(|length| &rest[..length])
    };
    let is_whole = |at: &usize| frame_at(*at).is_some_and(Wire::is_whole);
    if is_whole(&0) { None } else { (1..STAMP + length).find(is_whole) }
}

/// The time, us, whose lower 32 bits are `low_us`: at or after `near_us` by less than 71 minutes.
pub fn whole_us(low_us: u32, near_us: u64) -> u64 {
    // A damaged log may hold any time.
    near_us.saturating_add(u64::from(low_us.wrapping_sub(near_us as u32)))
}

/// Whether an autopilot sent it, whatever its system's number is: stations are other components.
pub fn is_from_vehicle(frame: &[u8]) -> bool {
    frame.get(client::wire::SYSTEM_AT + 1) == Some(&COMPONENT_ID)
}

/// Whether the file's name has this extension, in small letters or large.
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

#[cfg(test)]
mod tests {
    use super::*;
    use client::request;

    /// What writes the logs of the tests.
    pub const TOOL: &str = "tvc 0.1.0 01234567";

    /// A second between two steps: standby at 0 s, active from 3 to 6 s and again from 8 s on.
    pub fn flight() -> Flight {
        let events = (0..10).flat_map(|second| {
            let state = match second {
                0 | 6 => Some(2),
                3 | 8 => Some(4),
                _ => None,
            };
            let step = Event::Step(Step::level(second * 1_000_000));
            state.map(Event::State).into_iter().chain([step])
        });
        Flight { events: events.collect(), ..Flight::default() }
    }

    /// Wherever a piece is missing, its frames are lost, and no other: what is left of a cut frame
    /// may look like the beginning of a long one.
    #[test]
    fn a_log_without_its_middle_says_how_much_is_missing() {
        use mavlink::dialects::common::{MavMessage, RAW_IMU_DATA};
        const FRAMES: usize = 40;
        const PIECE: usize = 300;
        let mut bytes = Vec::new();
        for sequence in 0..FRAMES as u8 {
            let header = mavlink::MavHeader { system_id: 1, component_id: COMPONENT_ID, sequence };
            let message = MavMessage::RAW_IMU(RAW_IMU_DATA {
                time_usec: 6_667 * u64::from(sequence),
                zacc: -981,
                xmag: i16::from_le_bytes([0xFD, 200]),
                ygyro: i16::from(sequence),
                ..RAW_IMU_DATA::default()
            });
            bytes.extend(u64::from(sequence).to_be_bytes());
            mavlink::write_v2_msg(&mut bytes, header, &message).unwrap();
        }
        let length = bytes.len() / FRAMES;
        // The piece is neither at the beginning nor at the end, where nothing tells of it.
        for begin in 100..bytes.len() - PIECE - 400 {
            let cut = Log::parse(&[&bytes[..begin], &bytes[begin + PIECE..]].concat());
            let lost = cut.entries.iter().map(|entry| entry.lost_before);
            let lost: Vec<u64> = lost.filter(|lost| *lost > 0).collect();
            let [lost] = lost[..] else { panic!("{lost:?} after {begin}") };
            assert_eq!(cut.entries.len() as u64 + lost, FRAMES as u64, "{begin}");
            let reached = (begin + PIECE).div_ceil(length) - begin / length;
            // Two cut frames may make a whole one.
            assert!(lost == reached as u64 || lost + 1 == reached as u64, "{begin}");
        }
    }

    #[test]
    fn what_is_written_is_read_and_a_cut_end_is_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.tlog");
        let mut writer = Writer::create(&path, TOOL).unwrap();
        let mut station = Wire::default();
        for time in [5, 1_000_000] {
            writer.write_at(time, &station.frame(&request::heartbeat())).unwrap();
        }
        writer.end().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes[..8], [0, 0, 0, 0, 0, 0, 0, 5]);
        let log = Log::parse(&bytes);
        let times: Vec<u64> = log.entries.iter().map(|entry| entry.time_us).collect();
        assert_eq!(times, [5, 1_000_000]);
        assert!(log.entries.iter().all(|entry| !entry.from_vehicle));
        assert_eq!(Log::parse(&bytes[..bytes.len() - 3]).entries.len(), 1);
        assert!(Log::read(&path).is_err(), "no vehicle in it");
        assert!(Writer::create(&path, TOOL).is_err(), "not overwritten");
    }

    #[test]
    fn a_vehicle_may_have_any_number() {
        let mut bytes = vec![0; STAMP];
        let mut beat = MAVLinkV2MessageRaw::new();
        let header = MavHeader { system_id: 7, component_id: COMPONENT_ID, sequence: 0 };
        beat.serialize_message(header, &request::heartbeat());
        bytes.extend(beat.raw_bytes());
        let log = Log::parse(&bytes);
        assert!(log.entries[0].from_vehicle);
        assert_eq!(log.counts.messages, 1);
    }

    #[test]
    fn a_short_clock_is_made_whole() {
        let hour = 3 << 32;
        assert_eq!(whole_us(7_000, hour + 2_000), hour + 7_000);
        assert_eq!(whole_us(17_000, hour + 7_000), hour + 17_000);
        assert_eq!(whole_us(3_000, (4 << 32) - 1_000), (4 << 32) + 3_000);
    }

    #[test]
    fn a_log_is_the_same_in_both_forms() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        let mut writer = Writer::create(&path("a.tlog"), TOOL).unwrap();
        let header = mavlink::MavHeader {
            system_id: SYSTEM_ID.into(),
            component_id: COMPONENT_ID,
            sequence: 0,
        };
        let mut beat = mavlink::MAVLinkV2MessageRaw::new();
        beat.serialize_message(header, &request::heartbeat());
        let mut station = Wire::default();
        for time in [5, 1_000_000] {
            writer.write_at(time, beat.raw_bytes()).unwrap();
            let order = station.frame(&request::ARM.message());
            writer.write_at(time + 1, &order).unwrap();
        }
        writer.end().unwrap();
        convert(&path("a.tlog"), &path("b.MCAP"), TOOL).unwrap();
        convert(&path("b.MCAP"), &path("c.tlog"), TOOL).unwrap();
        let read = |name| std::fs::read(path(name)).unwrap();
        assert!(read("b.MCAP").starts_with(mcap::MAGIC));
        assert_eq!(read("a.tlog"), read("c.tlog"));
        assert_eq!(Log::read(&path("b.MCAP")).unwrap().entries.len(), 4);
        assert!(convert(&path("a.tlog"), &path("c.tlog"), TOOL).is_err());
        assert!(convert(&path("a.tlog"), &path("d.txt"), TOOL).is_err());
        convert(&path("a.tlog"), &path("d.csv"), TOOL).unwrap();
        assert!(read("d.csv").starts_with(b"time_us,"));
    }
}
