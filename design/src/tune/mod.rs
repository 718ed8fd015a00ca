//! `tvc tune`: from a drone and requirements to gains.

mod design;
mod flown;
mod margins;
mod rocket;
mod search;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use client::Parameter;
use design::{Gains, Grid, NAMES, Problem, Requirements, Run};
use rig::{Image, ServoKind};
use tvc_nano::Params;

use crate::control_law;
use crate::vehicle::{Vehicle, VehicleChoice, VehicleKind};
use flights::{param_file, requirements};
use report::arguments::number;
use report::exit::Verdict;
use report::file::write_whole;
use report::kind;
use report::measure::{Figure, Figures, data, figure, rows};
use report::progress;

/// Options of `tvc tune`.
#[derive(Debug, Args)]
#[command(after_help = "\
The search flies the nonlinear model with the servo's limits, the firmware's law and its timing. It
starts from 21 tilts between 0.1 and 0.85 rad with 0.2 rad/s, at all frame phases and sensor ages. It
also flies those of 400 dispersed drones that are hard to fly. 95 % of the flights from each third
of the tilts must meet what is required. Overshoot counts in percent of the tilt, and at least of
0.15 rad.

Ratios refer to the time-optimal limit: bang-bang with the rudder's rate limited, without delay and
lag, to within 5 % of the start.

The image then flies the best gains of the last generations, each with vehicles of 12 seeds, each
from a tilt of every third. The gains that fly best are written, where they meet what is required.

Examples:
  tvc tune                                      gains for the analog servo
  tvc tune --servo digital --out digital.param  gains for the digital one, as a parameter file
  tvc tune --params my.param --generations 0    how good gains are, without a search
  tvc tune --vehicle identified.toml --json     gains for a drone that `tvc identify` measured
  tvc param load digital.param                  take them over into a vehicle
  tvc tune --vehicle rocket                     a rocket's gain schedule, and the best constant gains
  tvc tune --vehicle mine.toml --out mine.param    all parameters of a rocket that a file describes

Exit status: 0 every requirement met, 1 one missed, 2 unusable input.")]
pub struct Tune {
    /// What is to be flown: drone (its gains are those of both axes of drone2), rocket with PID
    /// gains that follow its burn, or a FILE.toml (docs/guides/vehicles.md).
    #[arg(long, default_value = "drone")]
    pub vehicle: VehicleChoice,

    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoKind::S3003)]
    pub servo: ServoKind,

    /// Largest overshoot, in percent of the start.
    #[arg(long, value_name = "PCT", default_value_t = Self::OVERSHOOT_PCT, value_parser = positive)]
    pub overshoot: f64,

    /// Longest 5 % settling, as a multiple of the time-optimal limit [default: 1.25, digital 1.2].
    #[arg(long, value_name = "RATIO", value_parser = positive)]
    pub settling: Option<f64>,

    /// Least gain margin, in dB.
    #[arg(long, value_name = "DB", default_value_t = Self::MARGIN_DB, value_parser = positive)]
    pub margin: f64,

    /// Generations of the search, of 14 candidates each; 0 leaves the analytic start.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub generations: u32,

    /// Seeds with which the image flies each of the best gains; 0 leaves it at the prediction.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(..=1000))]
    pub flights: u32,

    /// Write gains that miss a requirement, too.
    #[arg(long, requires = "out")]
    pub anyway: bool,

    /// Begin with the gains of this file instead of analytic ones; with `--generations 0` the
    /// figures are theirs.
    #[arg(long, value_name = "FILE.param")]
    pub params: Option<PathBuf>,

    /// Seed of the search and of the dispersed drones.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Where to write the gains: a name and a value a line.
    #[arg(long, value_name = "FILE.param", value_parser = kind::parameters)]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

impl Tune {
    const OVERSHOOT_PCT: f64 = 2.0;
    const MARGIN_DB: f64 = 4.0;
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, f64::MIN_POSITIVE..=f64::MAX, "a number above zero is needed")
}

/// Gains that the image flies: the last that were the best.
const CANDIDATES: usize = 5;

/// Parameters that describe the model, which the gains go with.
const MODEL: [&str; 3] = ["PID_LAW", "PITCH_GAIN", "SRV_RAD_S"];

/// Searches as `options` say, prints what was found and writes it.
///
/// # Errors
/// A file that cannot be used or written; the image is not to be had or does not fly.
pub fn run(options: &Tune, image: impl FnOnce() -> Result<Image>) -> Result<Verdict> {
    let Vehicle { kind, setup, airframes, .. } = options.vehicle.read(options.servo)?;
    if kind == VehicleKind::Rocket {
        return rocket::run(options, airframes);
    }
    let required = Requirements {
        overshoot_pct: options.overshoot,
        ratio: options.settling.unwrap_or(requirements::most_settling_ratio(options.servo)),
        gain_db: options.margin,
    };
    let base = control_law::parameters(options.servo, None)?;
    let problem = Problem::new(setup, &base, options.seed)?;
    let start = match options.params.as_deref() {
        Some(path) => design::gains(&control_law::parameters(options.servo, Some(path))?),
        None => problem.start(),
    };
    let mut best = search(&problem, start, options, &required)?;
    let (params, flown) = if options.flights == 0 {
        (problem.params(&best.swap_remove(0)), Vec::new())
    } else {
        best_flown(&problem, &best, options, &required, &image()?)?
    };
    let gains = named(&params);
    let analytic = named(&problem.params(&start));
    let runs = problem.figures(&params, Grid::FINE)?;
    let margins = problem.margins(&params)?;
    let figures = Figures::from([
        figure("servo", options.servo.name()),
        figure("seed", options.seed),
        data("gains", &gains),
        data("analytic", &analytic),
        rows("", gains.iter().map(|gain| gain_row(gain, &analytic))),
        rows("runs", runs.iter().map(|run| run.figures("predicted from", &required))),
        rows("flown", flown.iter().map(|run| run.figures("flown from", &required))),
        figure("slow_overshoot_pct", problem.slow_overshoot_pct(&params)?).shown(
            "overshoot with a sensor at 35 Hz, worst",
            "%",
            2,
        ),
        margins.figures(required.gain_db),
        figure("overshoot_limit_pct", required.overshoot_pct),
        figure("settling_limit_ratio", required.ratio),
        figure("gain_margin_limit_db", required.gain_db),
    ]);
    let verdict = figures.conclude(options.json, None)?;
    match &options.out {
        Some(out) if verdict == Verdict::Met || options.anyway => {
            let row = |(name, value): (&&str, &f32)| {
                let (name, value) = ((*name).into(), *value);
                Parameter { name, value }
            };
            write(out, &gains.iter().map(row).collect::<Vec<_>>())?;
        }
        Some(out) => eprintln!("{} is not written: --anyway writes it", out.display()),
        None => {}
    }
    Ok(verdict)
}

/// Writes parameters and says where they are.
fn write(out: &Path, rows: &[Parameter]) -> Result<()> {
    write_whole(out, param_file::text(rows).as_bytes())?;
    eprintln!("gains: {}", out.display());
    Ok(())
}

/// The gains that the image flies best, and their flights.
fn best_flown(
    problem: &Problem,
    candidates: &[Gains],
    options: &Tune,
    required: &Requirements,
    image: &Image,
) -> Result<(Params, Vec<Run>)> {
    let bar = progress::bar(candidates.len() as u64, "{bar:40} candidate {pos}/{len} flown");
    let mut best: Option<(f64, Params, Vec<Run>)> = None;
    for gains in candidates {
        let params = problem.params(gains);
        let runs = problem.flown(image, options.servo, &params, options.flights)?;
        let cost: f64 = runs.iter().map(|run| run.cost(required).0).sum();
        // Gains that meet what is required go before those that do not.
        let missed = runs.iter().filter(|run| !run.is_met(required)).count() as f64;
        let cost = cost + 1e3 * missed;
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, params, runs));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let (_, params, runs) = best.ok_or_else(|| anyhow::anyhow!("no gains to fly"))?;
    Ok((params, runs))
}

/// What was searched and what goes with it, by the firmware's names.
fn named(params: &Params) -> BTreeMap<&'static str, f32> {
    let names = NAMES.iter().chain(&MODEL);
    let values = names.filter_map(|name| Some((*name, params.value(name)?)));
    values.collect()
}

/// A parameter as it was at the start of the search and as it was found.
fn gain_row(
    (name, value): (&&'static str, &f32),
    analytic: &BTreeMap<&'static str, f32>,
) -> [Figure; 3] {
    let gain = |value: f32, label| figure("", f64::from(value)).shown(label, "", 4);
    [
        figure("", *name).shown("parameter", "", 0),
        gain(analytic[name], "analytic"),
        gain(*value, "found"),
    ]
}

/// The best gains, the best first.
fn search(
    problem: &Problem,
    start: Gains,
    options: &Tune,
    required: &Requirements,
) -> Result<Vec<Gains>> {
    let bar = progress::bar(options.generations.into(), search::BAR);
    // A drone that cannot be flown at all is reported before the search.
    problem.cost(&start, required)?;
    let cost = |gains: &Gains| problem.cost(gains, required).unwrap_or(f64::INFINITY);
    let mut best = vec![start];
    search::minimise(start, options.generations, options.seed, cost, |gains, least| {
        if best.last() != Some(gains) {
            best.push(*gains);
        }
        bar.set_message(format!("{least:.3}"));
        bar.inc(1);
    });
    bar.finish_and_clear();
    Ok(best.into_iter().rev().take(CANDIDATES).collect())
}
