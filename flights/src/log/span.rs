//! When a log begins and ends, from the ends of its file.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::{Frames, has_extension};

/// Bytes at either end: many frames, each at most 288 long.
const END: u64 = 8192;

/// The year 2100, us since 1970: a later time is of a damaged log.
const LATEST_US: u64 = 4_102_444_800_000_000;

/// Times of the first and the last frame of a `.tlog`, us since 1970; nothing of another file, or
/// where they cannot be right.
pub fn span_us(path: &Path) -> Option<(u64, u64)> {
    if !has_extension(path, "tlog") {
        return None;
    }
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let first = *times(&mut file, 0)?.first()?;
    let last = *times(&mut file, length.saturating_sub(END))?.last()?;
    (first.max(last) < LATEST_US).then_some((first, last))
}

fn times(file: &mut File, from: u64) -> Option<Vec<u64>> {
    file.seek(SeekFrom::Start(from)).ok()?;
    let mut bytes = Vec::new();
    file.take(END).read_to_end(&mut bytes).ok()?;
    Some(Frames::of(&bytes).map(|(time_us, _)| time_us).collect())
}

#[cfg(test)]
mod tests {
    use super::super::Writer;
    use super::super::tests::TOOL;
    use super::*;
    use client::{Wire, request};

    #[test]
    fn the_ends_of_a_long_log_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.tlog");
        let mut writer = Writer::create(&path, TOOL).unwrap();
        let mut station = Wire::default();
        for count in 0..2000 {
            let frame = station.frame(&request::heartbeat());
            writer.write_at(5_000_000 + 1000 * count, &frame).unwrap();
        }
        writer.end().unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() > 4 * END);
        assert_eq!(span_us(&path), Some((5_000_000, 6_999_000)));
        std::fs::write(&path, "no log").unwrap();
        assert_eq!(span_us(&path), None);
        assert_eq!(span_us(&folder.path().join("none.tlog")), None);
        let mut writer = Writer::create(&folder.path().join("late.tlog"), TOOL).unwrap();
        let frame = station.frame(&request::heartbeat());
        writer.write_at(5_000_000, &frame).unwrap();
        writer.write_at(2_409_919_804_339_800_000, &frame).unwrap();
        writer.end().unwrap();
        assert_eq!(span_us(&folder.path().join("late.tlog")), None);
    }
}
