//! `tvc montecarlo`: many dispersed drones under the image's own control law, on the model.

mod case;
mod options;
pub mod report;
pub mod summary;
pub mod table;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use plant::dispersion::{self, Campaign, Ranges};
use plant::pitch_loop::Timing;

use crate::model::control_law::{self, Law};
use ::report::exit::Verdict;
use ::report::file::write_table;
use ::report::kind::{self, Kind};
pub use case::Case;
pub use options::{Merge, MonteCarlo, MonteCarloCommand, Rerun};
use summary::Worst;
use table::Row;

/// Number of the worst runs that are written as files.
const WORST: usize = 5;

/// Carries out what `options` say.
pub fn run(options: &MonteCarlo) -> Result<Verdict> {
    match &options.command {
        None => {
            let report = report_of(options.report.as_deref())?;
            fly(options, &report)
        }
        Some(MonteCarloCommand::Merge(options)) => merge(options),
        Some(MonteCarloCommand::Rerun(options)) => case::rerun(options),
    }
}

fn fly(options: &MonteCarlo, report: &Path) -> Result<Verdict> {
    kind::try_folder(&options.worst)?;
    let setup = control_law::setup(options.servo, options.drone.as_deref())?;
    let params = control_law::parameters(options.servo, options.params.as_deref())?;
    let mut ranges = Ranges::WIDE.with_lateral_m(1e-3 * options.lateral_mm);
    for spread in &options.spread {
        spread.apply(&mut ranges);
    }
    let campaign = Campaign {
        shard: options.shard.unwrap_or((0, 1)),
        ranges,
        ..Campaign::new(options.seed, options.runs)
    };
    let begun = Instant::now();
    let bar = progress(campaign.indices().count() as u64);
    let outcomes = pool(options)?.install(|| {
        let law = |timing: &Timing| {
            let mut law = Law::new(&params, &setup.drone, timing);
            move |measurement| law.update(measurement)
        };
        dispersion::fly(&setup, &campaign, law, || bar.inc(1))
    })?;
    bar.finish_and_clear();
    let wall_s = begun.elapsed().as_secs_f64();
    eprintln!("{} runs in {wall_s:.1} s", outcomes.len());

    let rows: Vec<Row> = outcomes
        .iter()
        .map(|outcome| {
            let draw = campaign.draw(outcome.index);
            Row::new(
                options.servo.name(),
                options.seed,
                options.lateral_mm,
                &draw,
                outcome,
            )
        })
        .collect();
    let mut written = write_table(options.out.as_deref(), &rows);
    let mut worst = Worst::of(&rows, WORST);
    for (place, worst) in worst.iter_mut().enumerate() {
        let path = options.worst.join(format!("worst-{}.toml", place + 1));
        let case = Case::new(&campaign, worst.row.run, &setup, &params);
        // What cannot be written is complained of when everything else has been handed over.
        match case.write(&path, &worst.row) {
            Ok(()) => worst.file = Some(path.display().to_string()),
            refused => written = written.and(refused),
        }
    }
    let figures = summary::figures(&rows, &worst, options.require);
    let page = report::render(&figures, &rows)?;
    let verdict = figures.conclude(options.json, Some((report, page)));
    written.and(verdict)
}

/// As many threads as are wanted.
fn pool(options: &MonteCarlo) -> Result<rayon::ThreadPool> {
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(jobs) = options.jobs {
        pool = pool.num_threads(jobs.into());
    }
    pool.build().context("threads")
}

fn merge(options: &Merge) -> Result<Verdict> {
    let files: Vec<&Path> = options.files.iter().map(AsRef::as_ref).collect();
    if let Some(out) = &options.out {
        kind::keep_apart(out, files.iter().copied())?;
    }
    let report = report_of(options.report.as_deref())?;
    let rows = table::merge(&files)?;
    let figures = summary::figures(&rows, &Worst::of(&rows, WORST), None);
    let page = report::render(&figures, &rows)?;
    let verdict = figures.conclude(options.json, Some((&report, page)));
    write_table(options.out.as_deref(), &rows).and(verdict)
}

/// Where the page of a campaign goes.
fn report_of(given: Option<&Path>) -> Result<PathBuf> {
    kind::given_or(given, "report/montecarlo.html", Kind::Page)
}

fn progress(runs: u64) -> ProgressBar {
    let bar = ProgressBar::new(runs);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} runs, {eta} left") {
        bar.set_style(style);
    }
    bar
}
