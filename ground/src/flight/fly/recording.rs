//! A real recording played through the emulated BNO055, and the errors of the attitude that the
//! image estimates from it.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use client::LinkCounts;
use recordings::Recording;
use rig::Image;
use rig::flight::Setup;
use rig::replay::{ReplayRecord, replay};
use samd21::WaitStates;

use super::Stopwatch;
use super::figures::Measured;
use super::live::Live;
use super::report::Page;
use crate::flight::requirements;
use report::exit::BadInput;
use report::measure::{Limit::Within, figure};

/// How much of the recording runs without wait states, which only gives cycles, s.
const CYCLES_S: f64 = 5.0;

/// The gyroscope's range of 1000 deg/s, counts: rates beyond it were not measured, and no filter
/// without them keeps the inclination.
const RANGE_COUNTS: u16 = 16_000;

/// Opens a recording; whatever is wrong with the file is bad input.
pub fn open(path: &Path) -> Result<Arc<Recording>> {
    Ok(Arc::new(Recording::open(path).map_err(BadInput::new)?))
}

/// Plays all of `recording` at the chip's own wait state, and its beginning without.
pub fn play(image: &Image, recording: &Arc<Recording>, setup: &Setup) -> Result<(Measured, Page)> {
    let mut watch = Stopwatch::start();
    let length = recording.duration_s();
    let mut pass = |what: String, wait_states: u8, seconds: f64| -> Result<ReplayRecord> {
        let live = Live::begin(what);
        let config = rig::RigConfig {
            wait_states: WaitStates::Forced(wait_states),
            ..setup.rig.clone()
        };
        let record = replay(image, recording, &config, seconds, &mut |played| {
            live.played(played, seconds.min(length));
        })
        .with_context(|| format!("playing {}", recording.name()))?;
        live.end();
        watch.add(record.simulated_s, record.busy_s);
        Ok(record)
    };
    let record = pass(format!("playing {}", recording.name()), 1, length)?;
    let unhindered = pass("cycles without wait states".into(), 0, CYCLES_S)?;
    let score = record
        .score
        .ok_or_else(|| BadInput::new(format!("{} has no movement to score", recording.name())))?;
    let degrees = |key, deg: f64, label| figure(key, deg).shown(label, "deg", 2);
    let clips = |rates: &[i16; 3]| rates.iter().any(|rate| rate.unsigned_abs() >= RANGE_COUNTS);
    let samples = &record.received.samples;
    let clipped = samples.iter().filter(|sample| clips(&sample.gyr)).count();
    let inclination = degrees("inclination_deg", score.inclination_deg, "inclination RMSE");
    let inclination = if clipped == 0 {
        inclination.limit(requirements::INCLINATION_DEG)
    } else {
        inclination
    };
    let parity = record.parity;
    let measured = Measured {
        image: image.sizes(),
        stack_bytes: record.stack_high_water,
        unhindered: unhindered.timing,
        timing: record.timing,
        cpu_load: record.cpu_load,
        link: LinkCounts {
            lost: record.link.lost.max(record.unmatched as u64),
            ..record.link
        },
        runs: Vec::new(),
        faults: Vec::new(),
        disturbances: None,
        emulation: watch.stop(),
        replay: Some(figure(
            "replay",
            [
                degrees("total_deg", score.total_deg, "total RMSE"),
                degrees("heading_deg", score.heading_deg, "heading RMSE"),
                inclination,
                figure("rates_clipped", clipped).shown(
                    "samples beyond the gyroscope's range (the inclination is not judged)",
                    "",
                    0,
                ),
                figure("steps_equal", parity.equal)
                    .shown("quaternions equal to the host library's", "", 0)
                    .limit(Within(parity.compared as f64, parity.compared as f64)),
                figure("steps_compared", parity.compared).shown("quaternions compared", "", 0),
            ],
        )),
    };
    Ok((measured, Page::recording(recording.clone(), record)))
}
