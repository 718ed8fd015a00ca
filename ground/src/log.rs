//! Telemetry logs (`.tlog`): eight bytes of time (microseconds since 1970, big endian) before every MAVLink frame, as
//! pymavlink, MAVProxy and QGroundControl write and read them.

mod steps;
mod table;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use mavlink::dialects::common::MavMessage;
use rig::link::{Link, LinkCounts};
use tvc_nano::config::SYSTEM_ID;

use crate::failure::BadInput;

pub use steps::{Event, Flight, Step};
pub use table::write_csv;

/// Bytes of time before a frame.
const STAMP: usize = 8;
/// Where a frame has the number of the system that sent it.
const SYSTEM_AT: usize = 5;

/// A log that is being written.
pub struct Writer {
    file: BufWriter<File>,
    path: PathBuf,
}

impl Writer {
    /// Begins a new log; an old one is not overwritten.
    ///
    /// # Errors
    /// [`BadInput`] if the file is there already or cannot be made.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create_new(path).map_err(|error| {
            BadInput::new(match error.kind() {
                std::io::ErrorKind::AlreadyExists => {
                    format!(
                        "{} is there already: give the log another name",
                        path.display()
                    )
                }
                _ => format!("cannot write {}: {error}", path.display()),
            })
        })?;
        Ok(Self {
            file: BufWriter::new(file),
            path: path.to_owned(),
        })
    }

    /// Keeps a frame with the present time.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, frame: &[u8]) -> Result<()> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let now_us = now.map_or(0, |since| since.as_micros() as u64);
        self.write_at(now_us, frame)
    }

    /// Keeps a frame with a time, us since 1970.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_at(&mut self, time_us: u64, frame: &[u8]) -> Result<()> {
        self.file
            .write_all(&time_us.to_be_bytes())
            .and_then(|()| self.file.write_all(frame))
            .with_context(|| format!("writing {}", self.path.display()))
    }

    /// Hands what was kept so far to the system, so that it outlives whatever ends this program.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.file
            .flush()
            .with_context(|| format!("writing {}", self.path.display()))
    }

    /// Ends the log.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn end(mut self) -> Result<()> {
        self.flush()
    }
}

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
        let bytes = std::fs::read(path)
            .map_err(|error| BadInput::new(format!("cannot read {}: {error}", path.display())))?;
        let log = Self::parse(&bytes);
        if log.counts.messages == 0 {
            return Err(BadInput::new(format!(
                "{} is no telemetry log (.tlog) of this firmware",
                path.display()
            ))
            .into());
        }
        Ok(log)
    }

    /// The messages in the bytes of a log. A frame that is cut short or damaged is counted and passed over.
    pub fn parse(mut bytes: &[u8]) -> Self {
        let mut log = Self::default();
        // Every system counts its own frames.
        let mut links: BTreeMap<u8, Link> = BTreeMap::new();
        while let Some((stamp, rest)) = bytes.split_first_chunk::<STAMP>() {
            let Some(length) = Link::frame_length(rest) else {
                // Not at a frame: look for the next one.
                bytes = &bytes[1..];
                log.counts.stray_bytes += u64::from(!rest.is_empty());
                continue;
            };
            let (frame, rest) = rest.split_at(length);
            let link = links.entry(frame[SYSTEM_AT]).or_default();
            let lost = link.counts().lost;
            for received in link.receive_frames(frame) {
                log.entries.push(Entry {
                    time_us: u64::from_be_bytes(*stamp),
                    from_vehicle: frame[SYSTEM_AT] == SYSTEM_ID,
                    message: received.message,
                    lost_before: link.counts().lost - lost,
                });
            }
            bytes = rest;
        }
        let stray_bytes = log.counts.stray_bytes;
        log.counts = links.get(&SYSTEM_ID).map(Link::counts).unwrap_or_default();
        log.counts.stray_bytes += stray_bytes;
        log
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::request;

    #[test]
    fn what_is_written_is_read_and_a_cut_end_is_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.tlog");
        let mut writer = Writer::create(&path).unwrap();
        let mut station = Link::default();
        for time in [5, 1_000_000] {
            writer
                .write_at(time, &station.frame(&request::heartbeat()))
                .unwrap();
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
        assert!(Writer::create(&path).is_err(), "not overwritten");
    }
}
