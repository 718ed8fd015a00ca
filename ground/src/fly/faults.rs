//! The faults of a flight from a file.
//!
//! ```toml
//! [[fault]]
//! kind = "frozen"   # as in `tvc faults`
//! at_s = 0.30       # after the release
//! for_s = 0.05
//! ```

use std::path::Path;

use rig::Ticks;
use rig::faults::Kind;
use rig::flight::TimedFault;
use rig::random::{Stream, generator};
use serde::{Deserialize, Serialize};

use super::flights::FLIGHT_S;
use crate::failure::BadInput;

/// One entry of the file; also what the figures tell.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FaultEntry {
    /// Name of its kind.
    pub kind: String,
    /// When it begins, s after the release.
    pub at_s: f64,
    /// How long it lasts, s.
    pub for_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    fault: Vec<FaultEntry>,
}

/// Reads the file and draws from `seed` how hard each fault strikes.
///
/// # Errors
/// The file cannot be read, is not of this form, or names an unknown kind or a time outside the
/// flight.
pub fn read(path: &Path, seed: u64) -> Result<Vec<(FaultEntry, TimedFault)>, BadInput> {
    let refuse = |why: String| BadInput::new(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| refuse(error.to_string()))?;
    let file: File = toml::from_str(&text).map_err(|error| refuse(error.to_string()))?;
    let mut dice = generator(seed, Stream::Campaign);
    let timed = file.fault.into_iter().map(|entry| {
        let kind: Kind = entry.kind.parse().map_err(refuse)?;
        if !(0.0..FLIGHT_S).contains(&entry.at_s) {
            return Err(refuse(format!("at_s must be 0 to below {FLIGHT_S}")));
        }
        if !(entry.for_s > 0.0 && entry.for_s <= 3600.0) {
            return Err(refuse("for_s must be above 0 and at most 3600".into()));
        }
        let fault = TimedFault {
            fault: kind.draw(&mut dice),
            at: Ticks::from_secs_f64(entry.at_s),
            until: Ticks::from_secs_f64(entry.at_s + entry.for_s),
        };
        Ok((entry, fault))
    });
    timed.collect()
}
