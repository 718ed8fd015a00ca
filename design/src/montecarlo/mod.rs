//! `tvc montecarlo`: many dispersed drones under the image's own control law, on the model.

mod case;
mod options;
pub mod report;
pub mod summary;
pub mod table;

use std::time::Instant;

use anyhow::Result;
use plant::dispersion::{self, Campaign, Ranges};
use plant::pitch_loop::Timing;

use crate::control_law::{self, Law};
use ::report::campaign;
use ::report::exit::{BadInput, Verdict};
use ::report::kind;
pub use case::Case;
pub use options::{MonteCarlo, MonteCarloCommand, Rerun};
use summary::Worst;
use table::Row;

/// What pages are named.
const NAME: &str = "montecarlo";
/// Number of the worst runs that are written as files.
const WORST: usize = 5;

/// Carries out what `options` say.
pub fn run(options: &MonteCarlo) -> Result<Verdict> {
    match &options.command {
        None => fly(options),
        Some(MonteCarloCommand::Merge(options)) => options.run(NAME, |rows: &[Row]| {
            let figures = summary::figures(rows, &Worst::of(rows, WORST), None);
            let page = report::render(&figures, rows)?;
            Ok((figures, page))
        }),
        Some(MonteCarloCommand::Rerun(options)) => case::rerun(options),
    }
}

fn fly(options: &MonteCarlo) -> Result<Verdict> {
    let report = options.output.page(NAME)?;
    kind::try_folder(&options.worst)?;
    let setup = options.vehicle.drone(options.servo)?;
    let params = control_law::parameters(options.servo, options.params.as_deref())?;
    let mut ranges = Ranges { cm_lateral_m: 1e-3 * options.lateral_mm, ..Ranges::WIDE };
    for (quantity, value) in &options.spread {
        *quantity(&mut ranges) = *value;
    }
    let seed = options.campaign.seed;
    let campaign = Campaign {
        shard: options.shard.unwrap_or((0, 1)),
        ranges,
        ..Campaign::new(seed, options.runs)
    };
    let begun = Instant::now();
    let runs = campaign.indices().count() as u64;
    let outcomes = campaign::on_threads("runs", runs, options.campaign.jobs, |done| {
        let law = |timing: &Timing| {
            let mut law = Law::new(&params, &setup.drone, timing);
            move |measurement| law.update(measurement)
        };
        dispersion::fly(&setup, &campaign, |_| true, law, done)
    })??;
    let wall_s = begun.elapsed().as_secs_f64();
    eprintln!("{} runs in {wall_s:.1} s", outcomes.len());

    let row = |outcome: &dispersion::Outcome| {
        let draw = campaign.draw(outcome.index);
        Row::new(options.servo.name(), seed, options.lateral_mm, &draw, outcome)
    };
    let rows: Vec<Row> = outcomes.iter().map(row).collect();
    if rows.is_empty() {
        return Err(BadInput::new("--shard: this part of the campaign has no run").into());
    }
    let mut written = Ok(());
    let mut worst = Worst::of(&rows, WORST);
    for (place, worst) in worst.iter_mut().enumerate() {
        let path = options.worst.join(format!("worst-{}.toml", place + 1));
        let case = Case::new(&campaign, worst.row.run, &setup, &params);
        match case.write(&path, &worst.row) {
            Ok(()) => worst.file = Some(path.display().to_string()),
            refused => written = written.and(refused),
        }
    }
    let figures = summary::figures(&rows, &worst, options.require);
    let page = report::render(&figures, &rows)?;
    let verdict = options.output.conclude(&rows, &figures, (&report, page));
    written.and(verdict)
}
