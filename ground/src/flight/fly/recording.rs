//! A real recording played through the emulated BNO055, and the errors of the attitude that the
//! image estimates from it.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use client::LinkCounts;
use recordings::Recording;
use rig::replay::{ReplayRecord, replay};

use super::figures::{Emulation, Measured};
use super::live::Live;
use super::{Flying, report};
use ::report::exit::BadInput;
use ::report::measure::{Figure, Figures, Limit::Within, figure};
use flights::requirements;

/// How much of the recording runs without wait states, which only gives cycles, s.
const CYCLES_S: f64 = 5.0;

/// The gyroscope's range of 1000 deg/s, counts: rates beyond it were not measured, and no filter
/// without them keeps the inclination.
const RANGE_COUNTS: u16 = 16_000;

/// Opens a recording; whatever is wrong with the file is bad input.
pub fn open(path: &Path) -> Result<Arc<Recording>> {
    Ok(Arc::new(Recording::open(path).map_err(BadInput::new)?))
}

impl Flying<'_> {
    /// Plays all of `recording` at the chip's own wait state, and its beginning without.
    pub(super) fn play(&self, recording: &Arc<Recording>) -> Result<(Figures, String)> {
        let begun = Instant::now();
        let mut emulation = Emulation::default();
        let length = recording.duration_s();
        let name = recording.name();
        let mut pass = |what: String, wait_states: u8, seconds: f64| -> Result<ReplayRecord> {
            let live = Live::begin(what);
            let config = self.with_wait_states(wait_states).rig;
            let record = replay(self.image, recording, &config, seconds, &mut |played| {
                live.played(played, seconds.min(length));
            })
            .with_context(|| format!("playing {name}"))?;
            live.end();
            emulation.add(record.simulated_s, record.cpu_load * record.simulated_s);
            Ok(record)
        };
        let record = pass(format!("playing {name}"), 1, length)?;
        let unhindered = pass("cycles without wait states".into(), 0, CYCLES_S)?;
        let measured = Measured {
            image: self.image.sizes(),
            stack_bytes: record.stack_high_water,
            unhindered: unhindered.timing,
            timing: record.timing,
            cpu_load: record.cpu_load,
            link: LinkCounts { lost: record.link.lost.max(record.unmatched as u64), ..record.link },
            runs: Vec::new(),
            faults: Vec::new(),
            disturbances: None,
            emulation: Emulation { wall_s: begun.elapsed().as_secs_f64(), ..emulation },
            replay: Some(score(&record, name)?),
        };
        let figures = measured.figures(self.options.servo);
        Ok(report::told(&format!("Replay of {name}"), figures, &[report::played(&record)?]))
    }
}

/// What a replay adds to the figures of a flight.
fn score(record: &ReplayRecord, name: &str) -> Result<Figure> {
    let score = record.score;
    let score = score.ok_or_else(|| BadInput::new(format!("{name} has no movement to score")))?;
    let degrees = |key, deg: f64, label| figure(key, deg).shown(label, "deg", 2);
    let clips = |rates: &[i16; 3]| rates.iter().any(|rate| rate.unsigned_abs() >= RANGE_COUNTS);
    let samples = &record.received.samples;
    let clipped = samples.iter().filter(|sample| clips(&sample.gyr)).count();
    let limit = (clipped == 0).then_some(requirements::INCLINATION_DEG);
    let parity = record.parity;
    let label = "samples beyond the gyroscope's range (the inclination is not judged)";
    Ok(figure(
        "replay",
        [
            degrees("total_deg", score.total_deg, "total RMSE"),
            degrees("heading_deg", score.heading_deg, "heading RMSE"),
            degrees("inclination_deg", score.inclination_deg, "inclination RMSE").limit(limit),
            figure("rates_clipped", clipped).shown(label, "", 0),
            figure("steps_equal", parity.equal)
                .shown("quaternions equal to the host library's", "", 0)
                .limit(Within(parity.compared as f64, parity.compared as f64)),
            figure("steps_compared", parity.compared).shown("quaternions compared", "", 0),
        ],
    ))
}
