//! `tvc faults`: everything that a sensor and its cable do wrong, at random instants of a flight.

mod report;

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use rig::bno055::FaultKind;
use rig::faults::{Campaign, Case, DEADLINE, Ending, Outcome};
use rig::{ServoKind, Setup, prepare};
use serde::Serialize;

use crate::out::exit::Verdict;
use crate::out::file::{print_figures, write_whole};
use clap::Args;
use std::path::PathBuf;

/// Options of `tvc faults`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc faults                                    every fault, 50 instants each
  cargo tvc faults --kind sda-stuck --kind spikes     two of them
  cargo tvc faults --runs 5 --json > faults.json      a quick look, for a script

A run is safe if the drone is back on course with control active (recovered), or if the firmware is
in failsafe (neutral); in both cases without a missing or wild pulse, without a reset, and with the
rudder never off neutral for more than 150 ms without sound data. Everything else is unsafe. The
same seed gives the same runs.

Exit status: 0 no unsafe run, 1 at least one or something failed, 2 unusable input.")]
pub struct Faults {
    /// Instants of the flight at which each fault is injected.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,

    /// Only this fault; can be given several times [default: all].
    #[arg(long, value_name = "KIND", num_args = 1..)]
    pub kind: Vec<FaultKind>,

    /// Seed of all that is random: the sensor, and every run's instant, length and strength.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Runs at a time [default: one for each processor core].
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,

    /// Where to write the HTML report: every run, how it ended and how long it was blind.
    #[arg(long, value_name = "FILE.html", default_value = "report/faults.html")]
    pub report: PathBuf,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Everything that `tvc faults --json` prints, as one object.
#[derive(Debug, Serialize)]
struct Figures {
    seed: u64,
    deadline_ms: f64,
    faults: Vec<KindFigures>,
    wall_s: f64,
}

/// How one kind's runs ended.
#[derive(Debug, Serialize)]
struct KindFigures {
    kind: &'static str,
    runs: usize,
    recovered: usize,
    neutral: usize,
    #[serde(rename = "unsafe")]
    unsafe_runs: usize,
    /// The longest that a rudder was off neutral without sound data, ms.
    worst_ms: f64,
}

/// What the columns of the table are.
const COLUMNS: [&str; 6] = [
    "fault",
    "runs",
    "recovered",
    "neutral",
    "unsafe",
    "worst, ms",
];

/// Carries out the campaign, prints its table, and tells every unsafe run.
pub fn run(options: &Faults) -> Result<Verdict> {
    let begun = Instant::now();
    let image = rig::image::build(&mut |line| eprintln!("{line}")).context("the image")?;
    let bar = spinner("boot and flight without a fault");
    let setup = Setup::new(ServoKind::S3003, options.seed);
    let ready = prepare(&image, &setup, &mut |_| {})?;
    let frame_hz = f64::from(setup.servo.frame_hz());
    let campaign = Campaign::new(&ready, frame_hz, options.seed)
        .context("the flight that is to be disturbed")?;
    bar.finish_and_clear();

    let kinds = if options.kind.is_empty() {
        FaultKind::ALL.to_vec()
    } else {
        FaultKind::ALL
            .into_iter()
            .filter(|kind| options.kind.contains(kind))
            .collect()
    };
    let outcomes = carry_out(&campaign, &kinds, options)?;
    let figures = Figures {
        seed: options.seed,
        deadline_ms: DEADLINE.as_us_f64() / 1e3,
        faults: kinds
            .iter()
            .map(|kind| KindFigures::of(*kind, &outcomes))
            .collect(),
        wall_s: begun.elapsed().as_secs_f64(),
    };
    let page = report::render(&figures, &outcomes)?;
    write_whole(&options.report, page.as_bytes())?;
    print_figures(&figures, options.json, |figures| {
        format!("{}\n", figures.table())
    })?;
    eprintln!("report: {}", options.report.display());
    let mut verdict = Verdict::Met;
    for outcome in &outcomes {
        if let Ending::Unsafe(why) = outcome.ending {
            verdict = Verdict::Missed;
            eprintln!("unsafe: {}: {why}", story(outcome));
        }
    }
    Ok(verdict)
}

fn carry_out(campaign: &Campaign, kinds: &[FaultKind], options: &Faults) -> Result<Vec<Outcome>> {
    let cases: Vec<Case> = kinds
        .iter()
        .flat_map(|&kind| (0..options.runs).map(move |number| Case { kind, number }))
        .collect();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.jobs.map_or(0, usize::from))
        .build()?;
    let bar = ProgressBar::new(cases.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} runs, {eta} to go") {
        bar.set_style(style);
    }
    let outcomes = pool.install(|| {
        cases
            .par_iter()
            .map(|&case| {
                let outcome = campaign
                    .run(case)
                    .with_context(|| format!("run {} of fault {}", case.number, case.kind));
                bar.inc(1);
                outcome
            })
            .collect()
    });
    bar.finish_and_clear();
    outcomes
}

impl KindFigures {
    fn of(kind: FaultKind, outcomes: &[Outcome]) -> Self {
        let runs = || outcomes.iter().filter(|outcome| outcome.case.kind == kind);
        let count = |ends: fn(&Ending) -> bool| runs().filter(|run| ends(&run.ending)).count();
        Self {
            kind: kind.name(),
            runs: runs().count(),
            recovered: count(|ending| matches!(ending, Ending::Recovered)),
            neutral: count(|ending| matches!(ending, Ending::Neutral)),
            unsafe_runs: count(|ending| matches!(ending, Ending::Unsafe(_))),
            worst_ms: runs().map(|run| run.blind_ms).fold(0.0, f64::max),
        }
    }
}

impl Figures {
    /// The table's rows, in the order of [`COLUMNS`].
    fn rows(&self) -> Vec<Vec<String>> {
        let row = |row: &KindFigures| {
            vec![
                row.kind.to_owned(),
                row.runs.to_string(),
                row.recovered.to_string(),
                row.neutral.to_string(),
                row.unsafe_runs.to_string(),
                format!("{:.1}", row.worst_ms),
            ]
        };
        self.faults.iter().map(row).collect()
    }

    fn table(&self) -> Table {
        let mut table = Table::new();
        table.load_style(NOTHING);
        table.set_header(COLUMNS);
        table.add_rows(self.rows());
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        table
    }
}

/// What there is to know of a run, to look at it again.
fn story(outcome: &Outcome) -> String {
    format!(
        "{} run {}, {:?} at {:.3} s for {:.0} ms, said last \"{}\"",
        outcome.case.kind,
        outcome.case.number,
        outcome.fault,
        outcome.at_s,
        outcome.lasted_s * 1e3,
        outcome.said
    )
}

fn spinner(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(what);
    bar.enable_steady_tick(Duration::from_millis(120));
    bar
}
