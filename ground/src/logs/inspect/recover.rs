//! `tvc log recover`: the frames of a broken log whose checksums are right, wherever they stand.

use std::path::Path;

use anyhow::{Result, bail};
use client::Wire;

use super::cut;
use flights::log::{self, Frames};
use report::exit::{BadInput, Verdict};
use report::input;

/// Time between neighbours in a log from which one of them must be wrong, us: a day.
const JUMP_US: u64 = 86_400_000_000;

/// Writes what can be read.
///
/// # Errors
/// [`BadInput`] if that is nothing, or the files are unusable.
pub fn run(path: &Path, file: &Path, json: bool) -> Result<Verdict> {
    let bytes = input::bytes(path, input::LOG)
        .map_err(|error| BadInput::new(format!("cannot read {}: {error}", path.display())))?;
    let found = log::salvaged(&bytes);
    let frames = frames(&found);
    if !frames.iter().any(|frame| log::is_from_vehicle(frame.1)) {
        bail!(BadInput::new(format!(
            "nothing of {} can be read as messages of a vehicle",
            path.display()
        )));
    }
    cut::write(file, &[], &frames, json)
}

/// The whole frames among what was found, with times that may be right.
pub fn frames(found: &[u8]) -> Vec<(u64, &[u8])> {
    let frames = Frames::of(found).filter(|frame| Wire::is_whole(frame.1));
    let mut frames: Vec<_> = frames.collect();
    mend_times(&mut frames);
    frames
}

/// A time that is far from most others becomes that of the frame before, or of the first good one.
fn mend_times(frames: &mut [(u64, &[u8])]) {
    let mut times: Vec<u64> = frames.iter().map(|frame| frame.0).collect();
    times.sort_unstable();
    let Some(middle) = times.get(times.len() / 2).copied() else {
        return;
    };
    let is_good = |time: u64| time.abs_diff(middle) < JUMP_US;
    let first = frames.iter().map(|frame| frame.0).find(|time| is_good(*time));
    let mut last = first.unwrap_or(middle);
    for (time, _) in frames {
        if is_good(*time) {
            last = *time;
        }
        *time = last;
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{flight, write};
    use super::*;
    use flights::log::Log;

    #[test]
    fn what_is_whole_comes_back_from_both_forms() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let whole = flight();
        for form in ["tlog", "mcap"] {
            let (source, broken) = (path(&format!("a.{form}")), path(&format!("b.{form}")));
            write(&whole, &source);
            let mut bytes = std::fs::read(&source).unwrap();
            // One byte of a frame's payload, the beginning, and the end.
            let at = bytes.windows(2).position(|pair| pair == [0xFD, 9]).unwrap();
            bytes[at + 12] ^= 0xFF;
            bytes[..8].fill(0xAA);
            bytes.truncate(bytes.len() - 5);
            std::fs::write(&broken, &bytes).unwrap();
            run(&broken, &path(&format!("{form}.tlog")), false).unwrap();
            let back = Log::read(&path(&format!("{form}.tlog"))).unwrap();
            let missing = whole.entries.len() - back.entries.len();
            assert!((1..=2).contains(&missing), "{form}: {missing}");
            assert!((back.length_s() - whole.length_s()).abs() < 1.1);
        }
        std::fs::write(path("no.tlog"), [0xFD; 4000]).unwrap();
        assert!(run(&path("no.tlog"), &path("n.tlog"), false).is_err());
        assert!(!path("n.tlog").exists());
    }

    #[test]
    fn a_time_that_cannot_be_right_is_that_of_the_frame_before() {
        let year = 1_764_000_000_000_000;
        let mut frames = [year | 1 << 60, year, year + 5, 3, year + 9].map(|time| (time, &[][..]));
        mend_times(&mut frames);
        let times: Vec<u64> = frames.iter().map(|frame| frame.0 - year).collect();
        assert_eq!(times, [0, 0, 5, 5, 9]);
        mend_times(&mut []);
    }
}
