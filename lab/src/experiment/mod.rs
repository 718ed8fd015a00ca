//! `lab experiment`: the two navigation experiments of the thesis, all estimators side by side on
//! the same simulated sensors.

mod candidates;
mod figures;
mod report;
mod truth;

use anyhow::Result;

use ::report::exit::Verdict;
use ::report::kind::{Kind as FileKind, given_or};
use candidates::CANDIDATES;
use figures::Estimator;
use ground::filters::progress::Progress;
use report::Traces;
use truth::Kind;
mod options;
pub use options::{Experiment, ExperimentCommand, GyroBias, Sensing};

/// Runs the experiment, prints the figures and writes the report.
///
/// # Errors
/// An estimator cannot be set up, or the report cannot be written.
pub fn run(options: &Experiment) -> Result<Verdict> {
    let (kind, sensing) = match &options.command {
        ExperimentCommand::Static(sensing) => (Kind::Static, sensing),
        ExperimentCommand::Motion(sensing) => (Kind::Motion, sensing),
    };
    let usual = format!("report/experiment-{}.html", kind.name());
    let path = given_or(sensing.report.as_deref(), usual, FileKind::Page)?;
    // Progress is counted in simulated ms; the sensors take as long as all estimators together.
    let length = ((kind.duration_s() + sensing.warm_up) * 1e3) as u64;
    let share = length / CANDIDATES.len() as u64;
    let mut progress = Progress::new(length + share * CANDIDATES.len() as u64);
    let samples = truth::samples(kind, sensing, &mut |seconds| {
        progress.at("sensors", (seconds * 1e3) as u64);
    });
    progress.part_done(length);
    let mut estimates = Vec::new();
    for candidate in &CANDIDATES {
        progress.at(candidate.name, 0);
        estimates.push(candidate.estimate(kind, &samples)?);
        progress.part_done(share);
    }
    progress.end();

    let estimators = Estimator::all(kind, &samples, &estimates);
    let figures = figures::figures(kind, sensing.seed, &samples, &estimators);
    let traces = Traces { kind, samples: &samples, estimates: &estimates };
    let page = report::render(&traces, sensing.seed, &figures, &estimators)?;
    figures.conclude(sensing.json, Some((&path, page)))
}
