//! Logs read from their beginning to their end, of which no more than a piece is in memory.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use anyhow::Result;
use client::{LinkCounts, Wire};

use super::{Entry, Frames, MCAP_MAGIC, is_from_vehicle, tlog_of, unreadable};
use report::exit::BadInput;
use report::input;

/// Bytes that are read at a time.
const PIECE: usize = 64 << 10;
/// Bytes by which a frame is judged: its own and those of a frame that begins inside of it.
const ENOUGH: usize = 1024;

/// Calls `each` with every message of a log, in order; what was counted on the vehicle's side.
///
/// # Errors
/// [`BadInput`] if the file cannot be read or holds no messages of a vehicle.
pub fn each_message(path: &Path, mut each: impl FnMut(Entry)) -> Result<LinkCounts> {
    let mut decoder = Decoder::default();
    each_frame(path, |time_us, frame| {
        decoder.take(time_us, frame, &mut each);
        Ok(())
    })
    .and_then(|stray_bytes| checked(decoder.counts(stray_bytes), path))
}

/// Calls `each` with the time, us since 1970, and the bytes of every frame of a log, in order;
/// the number of bytes that belong to none. A `.tlog` is read piece by piece, an `.mcap` whole.
///
/// # Errors
/// [`BadInput`] if the file cannot be read, or those of `each`.
pub fn each_frame(path: &Path, each: impl FnMut(u64, &[u8]) -> Result<()>) -> Result<u64> {
    let refuse = |error| unreadable(path, &error);
    let mut file = input::open(path, input::LOG).map_err(refuse)?;
    let mut head = Vec::new();
    file.by_ref().take(MCAP_MAGIC.len() as u64).read_to_end(&mut head).map_err(refuse)?;
    if head != MCAP_MAGIC {
        return pieces(head.as_slice().chain(file), PIECE, path, each);
    }
    file.read_to_end(&mut head).map_err(refuse)?;
    pieces(tlog_of(head, path)?.as_slice(), PIECE, path, each)
}

/// The frames of a `.tlog`, `piece` bytes at a time.
fn pieces(
    mut source: impl Read,
    piece: usize,
    path: &Path,
    mut each: impl FnMut(u64, &[u8]) -> Result<()>,
) -> Result<u64> {
    let (mut held, mut stray_bytes) = (Vec::new(), 0);
    loop {
        let read = source.by_ref().take(piece as u64).read_to_end(&mut held);
        let is_last = read.map_err(|error| unreadable(path, &error))? < piece;
        let mut frames = Frames::of(&held);
        if !is_last {
            frames.enough = ENOUGH;
        }
        for (time_us, frame) in &mut frames {
            each(time_us, frame)?;
        }
        stray_bytes += frames.stray_bytes;
        let rest = frames.bytes.len();
        if is_last {
            return Ok(stray_bytes);
        }
        held.drain(..held.len() - rest);
    }
}

/// Makes messages of frames, and counts what is missing.
#[derive(Default)]
pub struct Decoder {
    /// Every system counts its own frames.
    wires: BTreeMap<u8, Wire>,
    vehicle: Option<u8>,
    crc_errors: u64,
    stray_bytes: u64,
}

impl Decoder {
    /// Calls `each` with the messages in a frame of a log. One that is cut short or damaged is
    /// counted and ignored.
    pub fn take(&mut self, time_us: u64, frame: &[u8], each: &mut impl FnMut(Entry)) {
        // The head of a broken frame says nothing: it is counted and left out.
        let mut inside = Wire::default();
        for whole in inside.receive_frames(frame) {
            let from_vehicle = is_from_vehicle(&whole.bytes);
            if from_vehicle {
                self.vehicle = Some(whole.system());
            }
            let wire = self.wires.entry(whole.system()).or_default();
            let lost = wire.counts().lost;
            wire.receive(&whole.bytes);
            each(Entry {
                time_us,
                from_vehicle,
                message: whole.message,
                lost_before: wire.counts().lost - lost,
            });
        }
        self.crc_errors += inside.counts().crc_errors;
        self.stray_bytes += inside.counts().stray_bytes;
    }

    /// What was counted on the vehicle's side, in a log with this number of bytes outside of its
    /// frames.
    pub fn counts(&self, stray_bytes: u64) -> LinkCounts {
        let wire = self.vehicle.and_then(|vehicle| self.wires.get(&vehicle));
        let mut counts = wire.map(Wire::counts).unwrap_or_default();
        counts.crc_errors += self.crc_errors;
        counts.stray_bytes += self.stray_bytes + stray_bytes;
        counts
    }
}

/// The counts of a log that holds messages of a vehicle.
///
/// # Errors
/// [`BadInput`] if it holds none.
pub fn checked(counts: LinkCounts, path: &Path) -> Result<LinkCounts> {
    if counts.messages > 0 {
        return Ok(counts);
    }
    Err(BadInput::new(format!(
        "{} is no telemetry log (.tlog, .mcap) of this firmware",
        path.display()
    ))
    .into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::tests::{TOOL, flight};
    use crate::log::{Log, write_flight};

    /// Whatever stands between the frames, and wherever a piece ends.
    #[test]
    fn a_log_in_pieces_is_the_same_log() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tlog");
        write_flight(&flight(), &path, TOOL).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes.splice(600..600, [0xFD; 40]);
        bytes.splice(300..300, [0; 2_000]);
        bytes.splice(100..100, *b"stray");
        bytes.truncate(bytes.len() - 3);
        let whole = Log::parse(&bytes);
        for piece in [1, 7, 300, 1000, bytes.len(), PIECE] {
            let (mut decoder, mut entries) = (Decoder::default(), Vec::new());
            let stray_bytes = pieces(bytes.as_slice(), piece, &path, |time_us, frame| {
                decoder.take(time_us, frame, &mut |entry| entries.push(entry));
                Ok(())
            });
            assert_eq!(entries, whole.entries, "{piece}");
            assert_eq!(decoder.counts(stray_bytes.unwrap()), whole.counts, "{piece}");
        }
    }
}
