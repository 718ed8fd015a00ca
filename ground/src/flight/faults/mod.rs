//! `tvc faults`: every fault of the sensor and its cable, at random instants of a flight.

mod report;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use rig::bno055::FaultKind;
use rig::faults::{Campaign, Case, DEADLINE, Ending, GLITCHES, Outcome};
use rig::{ServoKind, Setup, prepare};

use crate::flight::hardware::HardwareChoice;
use crate::flight::vehicle::VehicleKind;
use crate::image::ImageOption;
use crate::out::exit::{BadInput, Verdict};
use crate::out::kind;
use crate::out::measure::Limit::{AtLeast, AtMost};
use crate::out::measure::{Figure, Figures, figure, rows};

/// Options of `tvc faults`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc faults                                    every fault, 50 instants each
  cargo tvc faults --kind sda-stuck --kind spikes     two of them
  cargo tvc faults --glitches                         short ones of the cable: all but 1 % ridden out
  cargo tvc faults --vehicle drone2                   both rudders of the two-axis drone
  cargo tvc faults --runs 5 --json > faults.json      a quick look, for a script

A run is safe if the drone is back on course with control active (recovered), or if the firmware is
in failsafe (neutral); in both cases without a missing or wild pulse, without a reset, and with the
rudder never off neutral for more than 150 ms without valid data. Everything else is unsafe. The
same seed gives the same runs.

Exit status: 0 no unsafe run (and 99 % of glitches ridden out), 1 at least one or something failed,
2 unusable input.")]
pub struct Faults {
    /// Instants of the flight at which each fault is injected.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,

    /// What hangs on the rig.
    #[arg(long, value_enum, default_value_t)]
    pub vehicle: VehicleKind,

    /// Only this fault; can be given several times [default: all].
    #[arg(long, value_name = "KIND", num_args = 1..)]
    pub kind: Vec<FaultKind>,

    /// Glitches of the cable instead: 4 to 40 ms without acknowledge, with a line held, all ones or
    /// a stretched clock. At least 99 % must be ridden out with control active.
    #[arg(long, conflicts_with = "kind")]
    pub glitches: bool,

    /// Seed of all that is random: the sensor, and every run's instant, length and strength.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// What the emulated parts are like.
    #[command(flatten)]
    pub hardware: HardwareChoice,

    /// Runs at a time [default: one for each processor core].
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Where to write the HTML report: every run, how it ended and how long it was blind.
    #[arg(long, value_name = "FILE.html", default_value = "report/faults.html", value_parser = kind::page)]
    pub report: PathBuf,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Carries out the campaign, prints its table, and names every unsafe run.
pub fn run(options: &Faults) -> Result<Verdict> {
    if options.vehicle == VehicleKind::Rocket {
        return Err(BadInput::new(
            "--vehicle rocket: the campaign's flights are those of a drone; take drone or drone2",
        )
        .into());
    }
    let begun = Instant::now();
    let image = options.image.image()?;
    let bar = spinner("boot and flight without a fault");
    let mut setup = Setup::with_polarity(ServoKind::S3003, options.seed);
    setup.rig.hardware = options.hardware.hardware()?;
    options.vehicle.hang(&mut setup.rig)?;
    let ready = prepare(&image, &setup, &mut |_| {})?;
    let frame_hz = f64::from(setup.servo.frame_hz());
    let mut campaign = Campaign::new(&ready, frame_hz, options.seed)
        .context("the flight that is to be disturbed")?;
    if options.glitches {
        campaign = campaign.of_glitches();
    }
    bar.finish_and_clear();

    let kinds = if options.glitches {
        GLITCHES.to_vec()
    } else if options.kind.is_empty() {
        FaultKind::ALL.to_vec()
    } else {
        FaultKind::ALL
            .into_iter()
            .filter(|kind| options.kind.contains(kind))
            .collect()
    };
    let outcomes = carry_out(&campaign, &kinds, options)?;
    let recovered = outcomes
        .iter()
        .filter(|outcome| outcome.ending == Ending::Recovered)
        .count();
    let recovered_pct = 100.0 * recovered as f64 / outcomes.len() as f64;
    let mut recovered_pct = figure("recovered_pct", recovered_pct).shown("recovered", "%", 1);
    if options.glitches {
        recovered_pct = recovered_pct.limit(AtLeast(99.0));
    }
    let figures = Figures::from([
        figure("vehicle", options.vehicle.name()).shown("vehicle", "", 0),
        figure("seed", options.seed).shown("seed", "", 0),
        figure("deadline_ms", DEADLINE.as_us_f64() / 1e3).shown(
            "longest allowed off neutral without valid data",
            "ms",
            0,
        ),
        rows("faults", kinds.iter().map(|kind| ended(*kind, &outcomes))),
        recovered_pct,
        figure("wall_s", begun.elapsed().as_secs_f64()).shown("time that it took", "s", 1),
    ]);
    let page = report::render(&figures, options.seed, &outcomes)?;
    let verdict = figures.conclude(options.json, Some((&options.report, page)))?;
    for outcome in &outcomes {
        if let Ending::Unsafe(why) = outcome.ending {
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

/// How one kind's runs ended.
fn ended(kind: FaultKind, outcomes: &[Outcome]) -> [Figure; 6] {
    let runs = || outcomes.iter().filter(|outcome| outcome.case.kind == kind);
    let count = |key, ends: fn(&Ending) -> bool| {
        let count = runs().filter(|run| ends(&run.ending)).count();
        figure(key, count).shown(key, "", 0)
    };
    // The longest that a rudder was off neutral without valid data.
    let worst_ms = runs().map(|run| run.unguarded_ms).fold(0.0, f64::max);
    [
        figure("kind", kind.name()).shown("fault", "", 0),
        count("runs", |_| true),
        count("recovered", |ending| matches!(ending, Ending::Recovered)),
        count("neutral", |ending| matches!(ending, Ending::Neutral)),
        count("unsafe", |ending| matches!(ending, Ending::Unsafe(_))).limit(AtMost(0.0)),
        figure("worst_ms", worst_ms).shown("worst", "ms", 1),
    ]
}

/// A run in words, with all that is needed to fly it again.
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
