//! `tvc montecarlo --vehicle rocket`: many rockets that are not as their images were told, through
//! their burn.

use std::path::Path;

use anyhow::Result;
use maud::html;
use plant::dispersion;
use rayon::prelude::*;
use rig::rocket;
use serde::Serialize;

use super::{MonteCarlo, pool, progress};
use crate::flight::requirements::ASCENT_ERROR_MOST_DEG;
use crate::model::ascent::{self, Law, Outcome};
use report::distribution::Distribution;
use report::exit::Verdict;
use report::measure::Limit::AtLeast;
use report::measure::{Figures, data, figure};
use report::page::{figure as picture, page, verdicts};
use report::plot::{Line, Plot};

/// Runs that are named, the worst first.
const WORST: usize = 5;

/// One rocket.
#[derive(Clone, Debug, Serialize)]
struct Run {
    seed: u64,
    airframe: &'static str,
    /// None for a rocket that was lost.
    error_rms_deg: Option<f64>,
    /// When it was lost, s since ignition.
    lost_at_s: Option<f64>,
}

impl Run {
    fn passes(&self) -> bool {
        self.error_rms_deg
            .is_some_and(|error| error <= ASCENT_ERROR_MOST_DEG)
    }

    /// What the worst have most of.
    fn badness(&self) -> f64 {
        self.error_rms_deg.unwrap_or(f64::INFINITY)
    }
}

/// Flies the campaign, prints the figures and writes the page.
pub fn run(options: &MonteCarlo, report: &Path) -> Result<Verdict> {
    let bar = progress(options.runs);
    let mut runs: Vec<Run> = pool(options)?.install(|| {
        (0..options.runs)
            .into_par_iter()
            .map(|index| {
                let run = fly(options.seed.wrapping_add(index));
                bar.inc(1);
                run
            })
            .collect::<Result<_>>()
    })?;
    bar.finish_and_clear();
    let rate = dispersion::pass_rate(&runs, Run::passes);
    let errors = Distribution::of(runs.iter().map(|run| run.error_rms_deg));
    let lost = runs.iter().filter(|run| run.lost_at_s.is_some()).count();
    let percent = |key, share: f64, label| figure(key, share).shown(label, "%", 2).scaled(100.0);
    runs.sort_by(|a, b| b.badness().total_cmp(&a.badness()));
    let figures = Figures::from([
        figure("vehicle", "rocket"),
        figure("seed", options.seed).shown("seed", "", 0),
        figure("runs", options.runs).shown("runs", "", 0),
        percent("pass_rate", rate.rate, "passed").limit(options.require.map(AtLeast)),
        percent("pass_rate_low", rate.low, "lower 95 % bound"),
        percent("pass_rate_high", rate.high, "upper 95 % bound"),
        figure("lost", lost).shown("lost", "", 0),
        errors.figure("error_rms_deg", ("error rms", "deg", 2), [None; 2]),
        data("worst", &runs.iter().take(WORST).collect::<Vec<_>>()),
    ]);
    let title = format!("Monte Carlo: {} rockets through their burn", options.runs);
    let shares = runs.iter().rev().enumerate().filter_map(|(place, run)| {
        let share = 100.0 * (place + 1) as f64 / options.runs as f64;
        Some((run.error_rms_deg?, share))
    });
    let plot = Plot::new(
        "error rms, deg",
        "rockets with no more, %",
        vec![Line::new("", 0, shares.collect())],
    );
    let body = html! {
        (verdicts(&figures.missed()))
        p {
            "Rockets that differ from what their gains were made for, on the model: every other airframe \
             is unstable. One passes that stays within " (ASCENT_ERROR_MOST_DEG) " deg rms of the \
             vertical from 2 s after the launch to the end of its burn."
        }
        (figures.lines().markup())
        (picture("How many rockets have no more than an error.", plot.svg()?))
    };
    figures.conclude(options.json, Some((report, page(&title, body))))
}

fn fly(seed: u64) -> Result<Run> {
    let (airframe, on_pad) = rocket::dispersed(seed);
    let law = Law::Scheduled(airframe.design());
    let (error_rms_deg, lost_at_s) = match ascent::fly(&on_pad, airframe, law, 1.0)? {
        Outcome::Flown(error_rad) => (Some(error_rad.to_degrees()), None),
        Outcome::LostAt(at_s) => (None, Some(at_s)),
    };
    Ok(Run {
        seed,
        airframe: airframe.name(),
        error_rms_deg,
        lost_at_s,
    })
}
