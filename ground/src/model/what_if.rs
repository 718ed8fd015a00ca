//! `tvc model what-if`: a log's release again on the model, as it was and with something changed.

use std::collections::BTreeMap;

use anyhow::Result;
use maud::html;
use plant::pitch_loop::PitchLoop;
use plant::response::StepResponse;
use tvc_nano::Params;

use crate::flight::figures::{Run, settling_band_deg};
use crate::logs::log::{Flight, Log, Release, Step};
use crate::logs::report::{response, servo};
use crate::model::WhatIf;
use crate::model::control_law::{Law, setup};
use crate::out::exit::{BadInput, Verdict};
use crate::out::measure::{Figures, data, figure, rows, shown};
use crate::out::page::{self, page};
use crate::out::plot::{Line, Plot};

/// Change of pitch at which the drone has left its start, rad.
const LEFT_RAD: f64 = 0.005;

/// Pitch over the time since the drone left its start: s, rad.
type Motion = Vec<(f64, f64)>;

/// A motion and its figures.
struct Flown {
    name: &'static str,
    motion: Motion,
    run: Run,
}

/// Flies the release that `options` name.
///
/// # Errors
/// [`BadInput`] for a log without such a release, or a drone that cannot be.
pub fn run(options: &WhatIf) -> Result<Verdict> {
    let named = |error: &dyn std::fmt::Display| {
        BadInput::new(format!("{}: {error}", options.log.display()))
    };
    let flight = Flight::of(&Log::read(&options.log)?);
    let release = flight
        .release(options.release)
        .map_err(|error| named(&error))?;
    let mut params = release.params.clone();
    let setup = setup(servo(&params), options.drone.as_deref())?;
    let logged = logged(&release).map_err(|error| named(&error))?;
    let [start_rad, rate_rad_s] = start(&release);
    let end_s = logged.motion.last().map_or(0.0, |last| last.0);
    let fly = |name, params: &Params| -> Result<Flown> {
        let target_rad = f64::from(params.pitch_set_deg()).to_radians();
        let mut law = Law::new(params, &setup.drone);
        let mut model = PitchLoop::new(
            &setup.drone,
            setup.servo,
            setup.timing,
            start_rad,
            rate_rad_s,
        )?;
        let mut motion = vec![(0.0, start_rad)];
        while motion.last().is_some_and(|last| last.0 < end_s) {
            let sample = model.step(|measurement| law.update(measurement));
            motion.push((sample.time_s, sample.pitch_rad));
        }
        flown(name, motion, target_rad).map_err(|error| named(&error).into())
    };
    let as_it_was = fly("model", &params)?;
    let changed: BTreeMap<String, f32> = options.parameters.iter().cloned().collect();
    for (name, value) in &changed {
        params
            .set(name, *value)
            .map_err(|error| BadInput::new(format!("{name}: {error}")))?;
    }
    let difference_rad = rms_difference(&logged.motion, &as_it_was.motion);
    let mut all = vec![logged, as_it_was];
    if !changed.is_empty() {
        all.push(fly("what if", &params)?);
    }
    let figures = figures(&all, &changed, difference_rad);
    let page = markup(options, release.set_rad[0], &all, &figures)?;
    figures.conclude(options.json, Some((&options.report, page)))
}

/// The steps of a release from where the drone leaves its start.
fn free<'a>(release: &'a Release<'_>) -> &'a [&'a Step] {
    let first_rad = release.steps[0].pitch_rad();
    let is_left = |step: &&Step| (step.pitch_rad() - first_rad).abs() > LEFT_RAD;
    let left = release.steps.iter().position(is_left).unwrap_or(0);
    &release.steps[left.saturating_sub(1)..]
}

/// Pitch, rad, and pitch rate, rad/s, where the drone leaves its start.
fn start(release: &Release<'_>) -> [f64; 2] {
    let step = free(release)[0];
    [step.pitch_rad(), step.rate_rad_s[1].into()]
}

/// The release as the log has it.
///
/// # Errors
/// Its set point does not rest, or it begins on it.
fn logged(release: &Release<'_>) -> Result<Flown> {
    let none = || {
        anyhow::anyhow!("this release is no step response: its set point moves, or it begins on it")
    };
    let whole = response(release).ok_or_else(none)?;
    let steps = free(release);
    let begin_s = steps[0].time_s();
    let motion = steps
        .iter()
        .map(|step| (step.time_s() - begin_s, step.pitch_rad()));
    let mut logged = flown("log", motion.collect(), release.set_rad[0])?;
    logged.run.stayed_active = whole.stayed_active;
    Ok(logged)
}

fn flown(name: &'static str, motion: Motion, target_rad: f64) -> Result<Flown> {
    let response = StepResponse::new(motion.iter().copied(), target_rad)?;
    let run = Run::new(response.initial_error(), &response, true);
    Ok(Flown { name, motion, run })
}

/// RMS difference of pitch at the times of the log, rad.
fn rms_difference(logged: &Motion, model: &Motion) -> f64 {
    let at = |time_s: f64| {
        let next = model.partition_point(|point| point.0 < time_s);
        model
            .get(next)
            .or(model.last())
            .map_or(0.0, |point| point.1)
    };
    let squares = logged
        .iter()
        .map(|(time_s, rad)| (rad - at(*time_s)).powi(2));
    (squares.sum::<f64>() / logged.len() as f64).sqrt()
}

fn figures(all: &[Flown], changed: &BTreeMap<String, f32>, difference_rad: f64) -> Figures {
    let row = |flown: &Flown| {
        let run = &flown.run;
        [
            figure("of", flown.name).shown("of", "", 0),
            figure("start_rad", run.start_rad).shown("start", "rad", 3),
            figure("overshoot_pct", run.overshoot_pct).shown("overshoot", "%", 1),
            figure("rise_s", run.rise_s)
                .shown("rise", "s", 3)
                .or("never"),
            figure("settling_5pct_s", run.settling_5pct_s)
                .shown("5 % settling", "s", 3)
                .or("never"),
            figure("final_error_rad", run.final_error_rad).shown("final error", "rad", 4),
        ]
    };
    let words = changed
        .iter()
        .map(|(name, value)| format!("{name} = {value}"));
    let words: Vec<String> = words.collect();
    let mut figures = vec![
        rows("runs", all.iter().map(row)),
        figure("model_difference_rad_rms", difference_rad).shown("model from log, rms", "rad", 4),
        data("changed", changed),
    ];
    if !words.is_empty() {
        figures.push(shown("what if", words.join(", ")));
    }
    figures.into()
}

fn markup(options: &WhatIf, set_rad: f64, all: &[Flown], figures: &Figures) -> Result<String> {
    let lines = all.iter().enumerate().map(|(colour, flown)| {
        let points = flown
            .motion
            .iter()
            .map(|(time_s, rad)| (*time_s, rad.to_degrees()));
        Line::new(flown.name, colour, points.collect())
    });
    let set_deg = set_rad.to_degrees();
    let half_deg = settling_band_deg(all[0].run.start_rad);
    let plot = Plot::new(
        "time since the drone left its start, s",
        "pitch, deg",
        lines.collect(),
    );
    let plot = plot.with_band(Some((set_deg - half_deg, set_deg + half_deg)));
    let body = html! {
        (figures.table("runs").markup())
        (figures.lines().markup())
        (page::figure(
            "Pitch of the log, of the model as the vehicle was, and with what is changed. The band is 5 % of the start.",
            plot.svg()?
        ))
    };
    Ok(page(&format!("What if: {}", options.log.display()), body))
}
