//! Many flights: how settling, overshoot and what is left in the end are distributed over seeds.
//!
//! A single flight is a draw: by the phases of frame and sensor alone its settling differs by a
//! tenth.

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use maud::{Markup, html};
use plant::limit::{self, Actuator};
use plant::pitch_loop::COMMAND_LIMIT_RAD;
use rayon::prelude::*;
use rig::flight::{FlightRecord, Setup};
use rig::{Image, prepare};
use tvc_nano::Axis;

use super::flights::{FLIGHT_S, START_RATE_RAD_S, STARTS_RAD, with_wait_states};
use crate::flight::fly::Fly;
use crate::flight::requirements;
use report::distribution::Distribution;
use report::measure::{Figures, figure, rows};
use report::page::{figure as picture, page, verdicts};
use report::plot::{Line, Plot};

/// The last part of a flight, in which what is left is measured, s.
const REST_S: f64 = 1.0;
/// Settling band, share of the start.
const BAND: f64 = 0.05;

/// What one flight gave.
struct Draw {
    start_rad: f64,
    overshoot_pct: f64,
    settling_s: Option<f64>,
    residual_mrad: f64,
    /// Time (s) and pitch (deg), with the start's sign taken off.
    path: Vec<(f64, f64)>,
}

/// Flies every start with each of `seeds` seeds, alternately to either side; the figures and the
/// page.
pub fn fly(image: &Image, setup: &Setup, seeds: u32, options: &Fly) -> Result<(Figures, String)> {
    let starts = options
        .start
        .map_or(STARTS_RAD.to_vec(), |start| vec![start]);
    let bar = ProgressBar::new(seeds.into());
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} seeds, {eta} to go") {
        bar.set_style(style);
    }
    let draws: Vec<Vec<Draw>> = (0..seeds)
        .into_par_iter()
        .map(|index| {
            let draws = fly_seed(image, setup, options.seed + u64::from(index), &starts);
            bar.inc(1);
            draws
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let draws: Vec<Draw> = draws.into_iter().flatten().collect();

    let of = |start: f64| draws.iter().filter(move |draw| draw.start_rad == start);
    let mut table = Vec::new();
    for &start in &starts {
        let limit_s = limit_s(setup, start)?;
        let settling = || of(start).map(|draw| draw.settling_s);
        let ratio = Distribution::of(settling().map(|s| s.map(|s| s / limit_s)));
        let overshoot = Distribution::of(of(start).map(|draw| Some(draw.overshoot_pct)));
        let residual = Distribution::of(of(start).map(|draw| Some(draw.residual_mrad)));
        table.push([
            figure("start_rad", start).shown("start", "rad", 2),
            figure("limit_s", limit_s).shown("limit", "s", 3),
            ratio.figure(
                "ratio",
                ("times the limit", "", 2),
                requirements::settling_ratio(options.servo).map(Some),
            ),
            overshoot.figure(
                "overshoot_pct",
                ("overshoot", "%", 1),
                requirements::OVERSHOOT_DISTRIBUTION.map(Some),
            ),
            Distribution::of(settling()).figure(
                "settling_5pct_s",
                ("5 % settling", "s", 3),
                [None; 2],
            ),
            residual.figure("residual_mrad", ("residual", "mrad", 1), [None; 2]),
        ]);
    }
    let figures = Figures::from([
        figure("servo", options.servo.name()),
        figure("seed", options.seed),
        figure("seeds", seeds),
        rows("distribution", table),
    ]);
    let plots = starts.iter().map(|&start| plot(start, of(start)));
    let plots: Vec<Markup> = plots.collect::<Result<_>>()?;
    let title = format!(
        "{seeds} flights from each tilt on the virtual rig: servo {}",
        options.servo.name()
    );
    let body = html! {
        (verdicts(&figures.missed()))
        p {
            "Figures of the drone's true pitch, released with 0.2 rad/s away from upright, to either \
             side in turn. The limit is bang-bang control with the rudder's rate limited, without \
             delay and lag; the residual is the rms of the pitch over the last second."
        }
        (figures.table("distribution").markup())
        @for plot in &plots { (plot) }
    };
    Ok((figures, page(&title, body)))
}

fn fly_seed(image: &Image, setup: &Setup, seed: u64, starts: &[f64]) -> Result<Vec<Draw>> {
    let mut one = setup.clone();
    one.rig = with_wait_states(setup, 1);
    one.rig.seed = seed;
    let ready = prepare(image, &one, &mut |_| ())?;
    let side = if seed.is_multiple_of(2) { -1.0 } else { 1.0 };
    let flights = starts.iter().map(|&start| {
        let (tilt, rate) = (side * start, side * START_RATE_RAD_S);
        let record = ready
            .fly(tilt, rate, FLIGHT_S, &mut |_| ())
            .with_context(|| format!("flying from {tilt} rad with seed {seed}"))?;
        Draw::of(&record, start, side)
    });
    flights.collect()
}

impl Draw {
    fn of(record: &FlightRecord, start_rad: f64, side: f64) -> Result<Self> {
        let response = record.response(Axis::Pitch)?;
        let seconds = |at: samd21::board::Ticks| at.saturating_sub(record.released).as_secs_f64();
        let motion = record.motion.iter().map(|m| (seconds(m.time), m.pitch_rad));
        let rest: Vec<f64> = motion
            .clone()
            .filter(|(at_s, _)| *at_s >= FLIGHT_S - REST_S)
            .map(|(_, pitch_rad)| pitch_rad * pitch_rad)
            .collect();
        let rms_rad = (rest.iter().sum::<f64>() / rest.len().max(1) as f64).sqrt();
        Ok(Self {
            start_rad,
            overshoot_pct: response.overshoot_pct(),
            settling_s: response.settling_s(BAND),
            residual_mrad: 1e3 * rms_rad,
            path: motion
                .map(|(at_s, pitch_rad)| (at_s, (side * pitch_rad).to_degrees()))
                .filter(|(at_s, _)| *at_s <= REST_S)
                .collect(),
        })
    }
}

/// The shortest 5 % settling that the rudder's speed allows, s (docs/model.md).
fn limit_s(setup: &Setup, start_rad: f64) -> Result<f64> {
    let bench = &setup.rig.bench;
    let actuator = Actuator {
        rate_rad_s: bench.servo.speed_rad_s,
        limit_rad: COMMAND_LIMIT_RAD,
    };
    let limit = limit::time_optimal(
        &bench.parameters,
        actuator,
        start_rad,
        START_RATE_RAD_S,
        0.0,
    )?;
    Ok(limit.response.settling_s(BAND).unwrap_or(limit.to_rest_s))
}

fn plot<'a>(start_rad: f64, draws: impl Iterator<Item = &'a Draw>) -> Result<Markup> {
    let lines = draws
        .map(|draw| Line::new("", 0, draw.path.clone()))
        .collect();
    let band = (BAND * start_rad).to_degrees();
    let plot =
        Plot::new("time since release, s", "pitch, deg", lines).with_band(Some((-band, band)));
    Ok(html! {
        h2 { "From " (start_rad) " rad" }
        (picture("All flights over each other, with the 5 % band.", plot.svg()?))
    })
}
