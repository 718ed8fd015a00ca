//! Flights of the drone with two rudders: from tilts of either axis and of both, at several
//! headings, with and without spin.

use anyhow::{Context, Result};
use client::StateKind;
use indicatif::{ProgressBar, ProgressStyle};
use maud::{Markup, html};
use rayon::prelude::*;
use rig::flight::{FlightRecord, Release, Setup};
use rig::{Image, prepare};
use serde::Serialize;
use tvc_nano::Axis;

use super::flights::{FLIGHT_S, START_RATE_RAD_S, with_wait_states};
use crate::flight::fly::Fly;
use crate::flight::requirements;
use report::distribution::Distribution;
use report::measure::{Figures, data, figure, rows};
use report::page::{figure as picture, page, verdicts};
use report::plot::{Line, Plot};

/// Tilts of one axis or of each, rad.
pub(super) const STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.6];
/// Which axes are tilted, pitch and roll, and how a table calls that.
pub(super) const DIRECTIONS: [([f64; 2], &str); 3] = [
    ([1.0, 0.0], "pitch"),
    ([0.0, 1.0], "roll"),
    ([1.0, 1.0], "both"),
];
/// Rates about the drone's own vertical at the release, rad/s.
const SPINS_RAD_S: [f64; 2] = [0.0, 1.0];
/// Where the nose points, deg from north to the east.
const HEADINGS_DEG: [f64; 3] = [0.0, 90.0, 135.0];
/// Settling band, share of the start.
const BAND: f64 = 0.05;
/// The part of a flight that is drawn, s, and the time from point to point, ms.
const DRAWN_S: f64 = 1.5;
const DRAWN_EVERY: usize = 5;

/// One flight: lists name pitch first, then roll.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Run {
    pub(super) seed: u64,
    pub(super) heading_deg: f64,
    pub(super) spin_rad_s: f64,
    pub(super) start_rad: [f64; 2],
    /// None for an axis that was upright.
    pub(super) overshoot_pct: [Option<f64>; 2],
    pub(super) settling_5pct_s: [Option<f64>; 2],
    /// Largest angle of an axis that was upright, of the start of the other; none if both were
    /// tilted.
    pub(super) cross_coupling_pct: Option<f64>,
    pub(super) stayed_active: bool,
    #[serde(skip)]
    pub(super) direction: &'static str,
    #[serde(skip)]
    pub(super) size_rad: f64,
    /// Time, s, and angles, deg.
    #[serde(skip)]
    pub(super) path: Vec<(f64, [f64; 2])>,
}

/// Flies all of it with each of `seeds` seeds; the figures and the page.
pub fn fly(image: &Image, setup: &Setup, seeds: u32, options: &Fly) -> Result<(Figures, String)> {
    let sizes = options
        .start
        .map_or(STARTS_RAD.to_vec(), |start| vec![start]);
    let boots: Vec<(u64, f64)> = (0..seeds)
        .map(|index| options.seed + u64::from(index))
        .flat_map(|seed| HEADINGS_DEG.map(|heading_deg| (seed, heading_deg)))
        .collect();
    let bar = ProgressBar::new(boots.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} headings, {eta} to go") {
        bar.set_style(style);
    }
    let runs: Vec<Vec<Run>> = boots
        .into_par_iter()
        .map(|(seed, heading_deg)| {
            let runs = fly_heading(image, setup, seed, heading_deg, &sizes);
            bar.inc(1);
            runs
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let runs: Vec<Run> = runs.into_iter().flatten().collect();
    let (cycles, steps) = cycles(image, setup, options.seed, sizes[0])?;

    let table = sizes.iter().flat_map(|&size| {
        DIRECTIONS.map(|(_, direction)| {
            let of = || {
                let all = runs.iter();
                all.filter(move |run| run.size_rad == size && run.direction == direction)
            };
            summary(size, direction, of, options)
        })
    });
    let figures = Figures::from([
        figure("vehicle", options.vehicle.name()),
        figure("servo", options.servo.name()),
        figure("seed", options.seed),
        figure("seeds", seeds),
        figure(
            "loop",
            [
                figure("cycles_per_step_mean", cycles).shown(
                    "cycles a step, 0 wait states, mean",
                    "",
                    0,
                ),
                figure("cycles_per_step_max", steps).shown(
                    "cycles a step, 0 wait states, worst",
                    "",
                    0,
                ),
            ],
        ),
        rows("starts", table.collect::<Vec<_>>()),
        data("runs", &runs),
    ]);
    let plots = sizes.iter().map(|&size| plots(size, &runs));
    let plots: Vec<Markup> = plots.collect::<Result<_>>()?;
    let title = format!(
        "Two axes on the virtual rig: servos {}, {} flights",
        options.servo.name(),
        runs.len()
    );
    let body = html! {
        (verdicts(&figures.missed()))
        p {
            "Parts of the drone's true tilt in axes that do not spin with it, released with 0.2 rad/s \
             away from upright: of one axis and of both, with and without 1 rad/s about its own \
             vertical, with the nose to the north, east and south-east. Cross coupling is the largest \
             angle of an axis that was upright, as a share of the other's start."
        }
        (figures.table("starts").markup())
        @for plot in &plots { (plot) }
    };
    Ok((figures, page(&title, body)))
}

fn summary<'a, I: Iterator<Item = &'a Run>>(
    size: f64,
    direction: &'static str,
    of: impl Fn() -> I,
    options: &Fly,
) -> [report::measure::Figure; 6] {
    // A run that has left control has neither settled nor a bounded overshoot.
    let tilted = |value: fn(&Run, usize) -> Option<f64>| {
        let values = of().flat_map(move |run| {
            let axes = (0..Axis::COUNT).filter(|axis| run.start_rad[*axis] != 0.0);
            axes.map(move |axis| value(run, axis).filter(|_| run.stayed_active))
                .collect::<Vec<_>>()
        });
        Distribution::of(values)
    };
    let overshoot = tilted(|run, axis| run.overshoot_pct[axis]);
    let settling = tilted(|run, axis| run.settling_5pct_s[axis]);
    let cross = of().filter_map(|run| run.cross_coupling_pct);
    let cross = cross.fold(None, |worst: Option<f64>, one| {
        Some(worst.map_or(one, |worst| worst.max(one)))
    });
    let within = |value: f64| value.is_finite().then_some(value);
    [
        figure("start_rad", size).shown("start", "rad", 2),
        figure("axes", direction).shown("axes", "", 0),
        figure("overshoot_pct", within(overshoot.worst))
            .shown("overshoot, worst", "%", 1)
            .or("lost")
            .limit(requirements::OVERSHOOT_PCT),
        figure("settling_5pct_mean_s", within(settling.mean))
            .shown("5 % settling, mean", "s", 3)
            .or("never"),
        figure("settling_5pct_s", within(settling.worst))
            .shown("worst", "s", 3)
            .or("never")
            .limit(requirements::settling_s(options.servo)),
        figure("cross_coupling_pct", cross)
            .shown("cross coupling", "%", 1)
            .limit((direction != "both").then_some(requirements::CROSS_COUPLING_PCT)),
    ]
}

/// Boots with the nose at a heading and flies every start.
fn fly_heading(
    image: &Image,
    setup: &Setup,
    seed: u64,
    heading_deg: f64,
    sizes: &[f64],
) -> Result<Vec<Run>> {
    let mut one = setup.clone();
    one.rig = with_wait_states(setup, 1);
    one.rig.seed = seed;
    one.rig.bench.heading_rad = heading_deg.to_radians();
    let ready = prepare(image, &one, &mut |_| ())?;
    let side = if seed.is_multiple_of(2) { -1.0 } else { 1.0 };
    let mut runs = Vec::new();
    for &size_rad in sizes {
        for (direction, name) in DIRECTIONS {
            for spin_rad_s in SPINS_RAD_S {
                let tilt_rad = direction.map(|share| side * share * size_rad);
                let release = Release {
                    tilt_rad,
                    rate_rad_s: START_RATE_RAD_S,
                    spin_rad_s,
                };
                let record = ready
                    .fly_from(&release, FLIGHT_S, &mut |_| ())
                    .with_context(|| {
                        let [pitch, roll] = tilt_rad;
                        format!(
                            "flying from {pitch} and {roll} rad at {heading_deg} deg with seed {seed}"
                        )
                    })?;
                runs.push(Run {
                    seed,
                    heading_deg,
                    spin_rad_s,
                    direction: name,
                    size_rad,
                    ..Run::of(&record)?
                });
            }
        }
    }
    Ok(runs)
}

/// Cycles of a step of both axes without wait states: mean and worst.
fn cycles(image: &Image, setup: &Setup, seed: u64, size_rad: f64) -> Result<(f64, f64)> {
    let mut zero = setup.clone();
    zero.rig = with_wait_states(setup, 0);
    zero.rig.seed = seed;
    zero.rig.bench.faults.clear();
    let release = Release {
        tilt_rad: [size_rad; 2],
        rate_rad_s: START_RATE_RAD_S,
        spin_rad_s: 0.0,
    };
    let ready = prepare(image, &zero, &mut |_| ())?;
    let record = ready.fly_from(&release, 1.0, &mut |_| ())?;
    let spread = record.timing.cycles_per_step;
    Ok((spread.mean, spread.max))
}

impl Run {
    pub(super) fn of(record: &FlightRecord) -> Result<Self> {
        let start_rad = record.start_rad;
        let responses = [Axis::Pitch, Axis::Roll].map(|axis| {
            let tilted = start_rad[axis.index()] != 0.0;
            tilted.then(|| record.response(axis)).transpose()
        });
        let [pitch, roll] = responses;
        let responses = [pitch?, roll?];
        let seconds = |at: samd21::board::Ticks| at.saturating_sub(record.released).as_secs_f64();
        let path: Vec<(f64, [f64; 2])> = record
            .motion
            .iter()
            .map(|m| (seconds(m.time), [m.pitch_rad, m.roll.roll_rad]))
            .collect();
        let upright = start_rad.iter().position(|start| *start == 0.0);
        let cross_coupling_pct = upright.map(|axis| {
            let largest = path.iter().map(|(_, tilt)| tilt[axis].abs());
            100.0 * largest.fold(0.0, f64::max) / start_rad[1 - axis].abs()
        });
        let of = |figure: fn(&plant::StepResponse) -> Option<f64>| {
            [0, 1].map(|axis| responses[axis].as_ref().and_then(figure))
        };
        Ok(Self {
            seed: 0,
            heading_deg: 0.0,
            spin_rad_s: 0.0,
            start_rad,
            overshoot_pct: of(|response| Some(response.overshoot_pct())),
            settling_5pct_s: of(|response| response.settling_s(BAND)),
            cross_coupling_pct,
            stayed_active: record.final_state == Some(StateKind::Active),
            direction: "",
            size_rad: 0.0,
            path: path
                .into_iter()
                .filter(|(at_s, _)| *at_s <= DRAWN_S)
                .step_by(DRAWN_EVERY)
                .map(|(at_s, tilt)| (at_s, tilt.map(f64::to_degrees)))
                .collect(),
        })
    }
}

/// All flights from a size of tilt: over time for each direction, and seen from above.
fn plots(size_rad: f64, runs: &[Run]) -> Result<Markup> {
    let mut parts = Vec::new();
    for (_, direction) in DIRECTIONS {
        let of = || {
            let all = runs.iter();
            all.filter(|run| run.size_rad == size_rad && run.direction == direction)
        };
        let line = |axis: usize, name: &'static str, colour: usize| {
            of().enumerate().map(move |(index, run)| {
                let path = run.path.iter().map(|(at_s, tilt)| (*at_s, tilt[axis]));
                let name = if index == 0 { name } else { "" };
                Line::new(name, colour, path.collect())
            })
        };
        let lines = line(0, "pitch", 0).chain(line(1, "roll", 1)).collect();
        let band = (BAND * size_rad).to_degrees();
        let plot = Plot::new("time since release, s", "angle, deg", lines);
        parts.push((direction, plot.with_band(Some((-band, band))).svg()?));
    }
    Ok(html! {
        h2 { "From " (size_rad) " rad" }
        @for (direction, svg) in parts {
            (picture(&format!("Tilted: {direction}. All flights over each other."), svg))
        }
    })
}
