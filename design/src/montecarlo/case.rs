//! One run as a file from which it can be flown again.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use plant::Setup;
use plant::dispersion::{Campaign, Draw, Ranges};
use plant::pitch_loop::Sample;
use plant::response::StepResponse;
use serde::{Deserialize, Serialize};
use tvc_nano::Params;

use super::table::Row;
use crate::control_law::Law;
use crate::montecarlo::Rerun;
use crate::vehicle::store;
use report::campaign::read_run;
use report::exit::{BadInput, Verdict};
use report::file::write_whole;
use report::kind;
use report::measure::{Figures, figure};

/// Most steps of a run: eight minutes of them as the model has them.
const MOST_STEPS: f64 = 1e6;

/// All that is needed to fly a run again.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Length, s.
    pub seconds: f64,
    /// What was drawn.
    draw: Draw,
    /// The ranges that it was drawn from, and the noise.
    ranges: Ranges,
    /// The image's parameters, by name.
    parameters: BTreeMap<String, f32>,
    /// The nominal drone, servo and timing.
    #[serde(flatten)]
    setup: Setup,
}

impl Case {
    /// Run `index` of a campaign.
    pub fn new(campaign: &Campaign, index: u64, setup: &Setup, params: &Params) -> Self {
        let parameters = params.iter().map(|(info, value)| (info.name.into(), value)).collect();
        Self {
            seconds: campaign.seconds,
            draw: campaign.draw(index),
            ranges: campaign.ranges,
            parameters,
            setup: *setup,
        }
    }

    /// Writes the file, with the result of the run as a comment.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, row: &Row) -> Result<()> {
        let settled =
            row.settling_5pct_s.map_or("never settled".into(), |s| format!("settled in {s:.3} s"));
        let text = format!(
            "# Run {} of seed {}: overshoot {:.2} %, {settled}.\n\
             # Fly it again: tvc montecarlo rerun FILE\n\n{}",
            row.run,
            row.seed,
            row.overshoot_pct,
            toml::to_string(self)?
        );
        write_whole(path, text.as_bytes())
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let case: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        case.setup.validate().map_err(|error| error.to_string())?;
        let steps = case.seconds / case.setup.timing.step_s;
        if !(0.0..=MOST_STEPS).contains(&steps) {
            return Err(format!(
                "seconds = {} in steps of step_s = {} is not between none and {MOST_STEPS} steps",
                case.seconds, case.setup.timing.step_s
            ));
        }
        Ok(case)
    }

    /// Flies the run.
    ///
    /// # Errors
    /// A parameter that is not there, or a value out of its range.
    pub fn fly(&self) -> Result<Vec<Sample>, String> {
        let mut params = Params::default();
        store(&mut params, self.parameters.iter().map(|(name, value)| (name, *value)))
            .map_err(|error| error.to_string())?;
        let setup = &self.setup;
        let mut law = Law::new(&params, &setup.drone, &self.draw.setup(setup).timing);
        let mut motion = Vec::new();
        let flown = self.draw.fly(
            setup,
            &self.ranges,
            self.seconds,
            |measurement| law.update(measurement),
            |sample| motion.push(*sample),
        );
        flown.map_err(|error| error.to_string())?;
        Ok(motion)
    }
}

/// Flies a run again.
pub fn rerun(options: &Rerun) -> Result<Verdict> {
    let path = &options.file;
    if let Some(out) = &options.out {
        kind::keep_apart(out, [path.as_path()])?;
    }
    let case = read_run(path, Case::parse)?;
    let motion = case.fly().map_err(|error| BadInput::of(path, error))?;
    let written = options.out.as_ref().map_or(Ok(()), |out| {
        let mut text =
            String::from("time_s,pitch_rad,rate_rad_s,crank_rad,rudder_rad,command_rad\n");
        let linkage = case.setup.drone.linkage();
        for s in &motion {
            let (crank_rad, command_rad) = (s.crank.angle_rad, s.command_rad);
            let rudder_rad = linkage.at(crank_rad).rudder_rad();
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "{},{},{},{crank_rad},{rudder_rad},{command_rad}",
                s.time_s, s.pitch_rad, s.rate_rad_s
            );
        }
        write_whole(out, text.as_bytes())
    });
    let response = StepResponse::new(motion.iter().map(|s| (s.time_s, s.pitch_rad)), 0.0)
        .map_err(|error| BadInput::of(path, error))?;
    let settling = figure("settling_5pct_s", response.settling_s(0.05));
    let verdict = Figures::from([
        figure("run", case.draw.index).shown("run", "", 0),
        figure("start_rad", case.draw.start_rad).shown("start", "rad", 1),
        figure("overshoot_pct", response.overshoot_pct()).shown("overshoot", "%", 2),
        figure("rise_s", response.rise_s()).shown("rise", "s", 3).or("never"),
        settling.shown("5 % settling", "s", 3).or("never"),
        figure("final_error_rad", response.final_error()).shown("final error", "rad", 4),
    ])
    .conclude(options.json, None);
    written.and(verdict)
}
