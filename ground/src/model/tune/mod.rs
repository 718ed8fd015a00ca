//! `tvc tune`: from a drone and requirements to gains.

mod design;
mod margins;
mod search;

use std::collections::BTreeMap;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use tvc_nano::Params;

use crate::model::control_law;
use crate::out::exit::Verdict;
use crate::out::file::{print_json, write_whole};
use crate::servo::ServoChoice;
use crate::vehicle::link::Parameter;
use crate::vehicle::param;
use clap::Args;
use design::{Gains, Grid, NAMES, Problem, Requirements, RunFigures};
use margins::Margins;
use std::path::PathBuf;

/// Options of `tvc tune`.
#[derive(Debug, Args)]
#[command(after_help = "\
The search flies the nonlinear model with the servo's limits and the firmware's timing, from 0.2,
0.4 and 0.8 rad with 0.2 rad/s, at the frame phases and sensor ages that there are, and 90 dispersed
drones besides. Ratios refer to the time-optimal limit: bang-bang with the rudder's rate limited,
without delay and lag, to within 5 % of the start.

Examples:
  tvc tune                                      gains for the analog servo
  tvc tune --servo digital --out digital.param  gains for the digital one, as a parameter file
  tvc tune --params identified.toml --json      gains for a drone that `tvc identify` measured
  tvc param load digital.param                  take them over into a vehicle

Exit status: 0 every requirement met, 1 one missed, 2 unusable input.")]
pub struct Tune {
    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoChoice::S3003)]
    pub servo: ServoChoice,

    /// Drone, servo and timing where they differ from the servo's preset (docs/model.md).
    #[arg(long, value_name = "FILE.toml")]
    pub params: Option<PathBuf>,

    /// Largest overshoot, in percent of the start.
    #[arg(long, value_name = "PCT", default_value_t = 3.0, value_parser = positive)]
    pub overshoot: f64,

    /// Longest 5 % settling, as a multiple of the time-optimal limit [default: 1.7, digital 1.55].
    #[arg(long, value_name = "RATIO", value_parser = positive)]
    pub settling: Option<f64>,

    /// Least phase margin, in deg.
    #[arg(long, value_name = "DEG", default_value_t = 30.0, value_parser = positive)]
    pub margin: f64,

    /// Generations of the search, of 10 candidates each; 0 leaves the analytic start.
    #[arg(long, value_name = "N", default_value_t = 25)]
    pub generations: u32,

    /// Seed of the search and of the dispersed drones.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Where to write the gains: a name and a value a line.
    #[arg(long, value_name = "FILE.param")]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number above zero is needed".into()),
    }
}

/// Parameters that describe the model, which the gains go with.
const MODEL: [&str; 2] = ["PITCH_GAIN", "SRV_RAD_S"];

/// What was found.
#[derive(Serialize)]
struct Report {
    servo: &'static str,
    seed: u64,
    gains: BTreeMap<&'static str, f32>,
    analytic: BTreeMap<&'static str, f32>,
    runs: Vec<RunFigures>,
    margins: Margins,
    overshoot_limit_pct: f64,
    settling_limit_ratio: f64,
    phase_margin_limit_deg: f64,
    met: bool,
}

/// Searches as `options` say, prints what was found and writes it.
pub fn run(options: &Tune) -> Result<Verdict> {
    let required = Requirements {
        overshoot_pct: options.overshoot,
        ratio: options.settling.unwrap_or(match options.servo {
            ServoChoice::S3003 => 1.7,
            ServoChoice::Digital => 1.55,
        }),
        phase_deg: options.margin,
    };
    let setup = control_law::setup(options.servo, options.params.as_deref())?;
    let base = control_law::parameters(options.servo, None)?;
    let problem = Problem::new(setup, &base, options.seed)?;
    let start = problem.start();
    let gains = search(&problem, start, options, &required)?;
    let params = problem.params(&gains);
    let report = report(&problem, &params, start, options, &required)?;
    if let Some(out) = &options.out {
        let rows: Vec<Parameter> = report
            .gains
            .iter()
            .map(|(name, value)| Parameter {
                name: (*name).into(),
                value: *value,
            })
            .collect();
        write_whole(out, param::file::text(&rows).as_bytes())?;
        eprintln!("gains: {}", out.display());
    }
    if options.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(Verdict::naming(&missed(&report, &required)))
}

fn search(
    problem: &Problem,
    start: Gains,
    options: &Tune,
    required: &Requirements,
) -> Result<Gains> {
    let bar = ProgressBar::new(options.generations.into());
    if let Ok(style) =
        ProgressStyle::with_template("{bar:40} generation {pos}/{len}, {eta} left, cost {msg}")
    {
        bar.set_style(style);
    }
    // A drone that cannot be flown at all is said before the search.
    problem.cost(&start, required)?;
    let cost = |gains: &Gains| problem.cost(gains, required).unwrap_or(f64::INFINITY);
    let (gains, _) = search::minimise(start, options.generations, options.seed, cost, |least| {
        bar.set_message(format!("{least:.3}"));
        bar.inc(1);
    });
    bar.finish_and_clear();
    Ok(gains)
}

fn report(
    problem: &Problem,
    params: &Params,
    start: Gains,
    options: &Tune,
    required: &Requirements,
) -> Result<Report> {
    let named = |params: &Params| {
        NAMES
            .iter()
            .chain(&MODEL)
            .filter_map(|name| Some((*name, params.value(name)?)))
            .collect()
    };
    let mut report = Report {
        servo: options.servo.name(),
        seed: options.seed,
        gains: named(params),
        analytic: named(&problem.params(&start)),
        runs: problem.figures(params, Grid::FINE)?,
        margins: problem.margins(params)?,
        overshoot_limit_pct: required.overshoot_pct,
        settling_limit_ratio: required.ratio,
        phase_margin_limit_deg: required.phase_deg,
        met: false,
    };
    report.met = missed(&report, required).is_empty();
    Ok(report)
}

/// A line for each requirement that is not met.
fn missed(report: &Report, required: &Requirements) -> Vec<String> {
    let mut lines = Vec::new();
    for run in &report.runs {
        if run.overshoot_pct > required.overshoot_pct {
            lines.push(format!(
                "from {} rad: overshoot {:.2} %, allowed {} %",
                run.start_rad, run.overshoot_pct, required.overshoot_pct
            ));
        }
        if run.ratio.is_none_or(|ratio| ratio > required.ratio) {
            lines.push(format!(
                "from {} rad: 5 % settling {} of the limit, allowed {}",
                run.start_rad,
                run.ratio
                    .map_or("never".into(), |ratio| format!("{ratio:.2}")),
                required.ratio
            ));
        }
    }
    match report.margins.phase_deg {
        Some(deg) if deg >= required.phase_deg => {}
        found => lines.push(format!(
            "phase margin {}, required {} deg",
            found.map_or("none".into(), |deg| format!("{deg:.1} deg")),
            required.phase_deg
        )),
    }
    lines
}

fn print(report: &Report) {
    println!("{:<16} {:>10} {:>10}", "parameter", "analytic", "found");
    for (name, value) in &report.gains {
        println!("{name:<16} {:>10.4} {value:>10.4}", report.analytic[name]);
    }
    println!();
    println!("worst of frame phases, sensor ages and clocks:");
    println!("start rad  overshoot %  5 % settled s  limit s  ratio");
    for run in &report.runs {
        println!(
            "{:>9} {:>12.2} {:>14} {:>8.3} {:>6}",
            run.start_rad,
            run.overshoot_pct,
            run.settling_5pct_s
                .map_or("never".into(), |s| format!("{s:.3}")),
            run.limit_s,
            run.ratio.map_or("-".into(), |ratio| format!("{ratio:.2}")),
        );
    }
    println!();
    let or_none = |value: Option<f64>| value.map_or("none".into(), |v| format!("{v:.1}"));
    let m = &report.margins;
    println!(
        "margins: gain {} dB, phase {} deg at {} rad/s, delay {} ms, peak sensitivity {:.2}",
        or_none(m.gain_db),
        or_none(m.phase_deg),
        or_none(m.crossover_rad_s),
        or_none(m.delay_s.map(|s| 1e3 * s)),
        m.peak_sensitivity
    );
}
