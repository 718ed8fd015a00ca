//! A real recording through the emulated BNO055: how well the image estimates attitude from it.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use recordings::Recording;
use rig::Image;
use rig::flight::Setup;
use rig::replay::{ReplayRecord, replay};
use samd21::WaitStates;

use super::figures::{Figures, ReplayFigures, TelemetryFigures};
use super::live::Live;
use super::report::Page;
use super::{Stopwatch, image_figures, loop_figures};
use crate::out::exit::BadInput;

/// How much of the recording runs without wait states, which only gives cycles, s.
const CYCLES_S: f64 = 5.0;

/// Opens a recording; whatever is wrong with the file is bad input.
pub fn open(path: &Path) -> Result<Arc<Recording>> {
    Ok(Arc::new(Recording::open(path).map_err(BadInput::new)?))
}

/// Plays all of `recording` at the chip's own wait state, and its beginning without.
pub fn play(image: &Image, recording: &Arc<Recording>, setup: &Setup) -> Result<(Figures, Page)> {
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
    let figures = Figures {
        image: image_figures(image, record.stack_high_water),
        control: loop_figures(&unhindered.timing, &record.timing, record.cpu_load),
        latency_us: record.timing.latency_us.into(),
        sample_age_us: record.timing.sample_age_us.into(),
        telemetry: TelemetryFigures {
            messages: record.link.messages,
            lost: record.link.lost.max(record.unmatched as u64),
            crc_errors: record.link.crc_errors,
        },
        runs: Vec::new(),
        faults: Vec::new(),
        disturbances: None,
        emulation: watch.figures(),
        replay: Some(ReplayFigures {
            total_deg: score.total_deg,
            heading_deg: score.heading_deg,
            inclination_deg: score.inclination_deg,
            steps_equal: record.parity.equal as u64,
            steps_compared: record.parity.compared as u64,
        }),
    };
    Ok((figures, Page::recording(recording.clone(), record)))
}
