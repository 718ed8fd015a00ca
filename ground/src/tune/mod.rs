//! `tvc tune`: from a drone and requirements to gains.

mod design;
mod margins;
mod search;

use std::collections::BTreeMap;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use tvc_nano::Params;

use crate::cli::{ServoChoice, Tune};
use crate::failure::Verdict;
use crate::law;
use crate::link::Parameter;
use crate::output::{print_json, write_whole};
use crate::param;
use design::{Gains, Grid, NAMES, Problem, Requirements, RunFigures};
use margins::Margins;

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
    let setup = law::setup(options.servo, options.params.as_deref())?;
    let base = law::parameters(options.servo, None)?;
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
