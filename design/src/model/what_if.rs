//! `tvc model what-if`: a log's release again on the model, as it was and with something changed.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use maud::html;
use plant::Setup;
use plant::pitch_loop::PitchLoop;
use plant::response::StepResponse;
use tvc_nano::{Axis, Params};

use crate::control_law::Law;
use crate::model::WhatIf;
use crate::vehicle::store;
use flights::figures::{Run, response, servo, settling_band_deg};
use flights::log::{Flight, Release, Step};
use report::exit::{BadInput, Verdict};
use report::measure::{Figures, data, figure, rows, shown};
use report::page::{self, page};
use report::plot::{Line, Plot};

/// Change of pitch at which the drone is seen to have left its start, rad.
const LEFT_RAD: f64 = 0.005;
/// Longest time for which it may have moved before, s.
const UNSEEN_S: f64 = 0.15;
/// Time after that within which the model is compared with the log to find the start, s.
const COMPARED_S: f64 = 0.5;

/// Pitch over the time since the release: s, rad.
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
    let path = &options.log;
    let flight = Flight::read(path)?;
    let release = flight.release(options.release).map_err(|error| BadInput::of(path, error))?;
    let setup = options.vehicle.drone(servo(&release.params))?;
    let changed: BTreeMap<String, f32> = options.parameters.iter().cloned().collect();
    let all = flown_again(&release, &setup, &changed).map_err(|error| BadInput::of(path, error))?;
    let difference_rad = rms_difference(&all[0].motion, &all[1].motion);
    let figures = figures(&all, &changed, difference_rad);
    let page = markup(options, release.set_rad(Axis::Pitch)[0], &all, &figures)?;
    figures.conclude(options.json, Some((&options.report, page)))
}

/// The log, the model as it was and, if something is changed, with that.
///
/// # Errors
/// The release is no step response.
fn flown_again(
    release: &Release<'_>,
    setup: &Setup,
    changed: &BTreeMap<String, f32>,
) -> Result<Vec<Flown>> {
    let mut params = release.params.clone();
    let logged = logged(release)?;
    let start = Start::of(release, setup, &logged.motion)?;
    let end_s = logged.motion.last().map_or(0.0, |last| last.0);
    let target_rad = |params: &Params| f64::from(params.pitch_set_deg()).to_radians();
    let as_it_was = start.fly(setup, &params, end_s)?;
    let mut all = vec![logged, flown("model", as_it_was, target_rad(&params))?];
    if !changed.is_empty() {
        store(&mut params, changed.iter().map(|(name, value)| (name, *value)))?;
        let motion = start.fly(setup, &params, end_s)?;
        all.push(flown("what if", motion, target_rad(&params))?);
    }
    Ok(all)
}

/// How the drone leaves the hand.
#[derive(Clone, Copy, Debug)]
struct Start {
    /// Time for which it is held, s since the vehicle's release: its rudder steers already.
    held_s: f64,
    /// Pitch at which it is held, rad.
    pitch_rad: f64,
    /// Pitch rate with which it leaves, rad/s.
    rate_rad_s: f64,
}

impl Start {
    /// The start of a release. When the hand has opened is not in the log: of the steps before the
    /// motion is seen, the one from which the model comes nearest to the log.
    fn of(release: &Release<'_>, setup: &Setup, logged: &Motion) -> Result<Self> {
        let pitch_rad = logged[0].1;
        let is_left = |(_, rad): &(f64, f64)| (rad - pitch_rad).abs() > LEFT_RAD;
        let left = logged.iter().position(is_left).unwrap_or(0);
        let left_s = logged[left].0;
        let early = logged.partition_point(|(time_s, _)| *time_s <= left_s + COMPARED_S);
        let mut best: Option<(f64, Self)> = None;
        for (step, (held_s, _)) in release.steps.iter().zip(&logged[..=left]) {
            if *held_s < left_s - UNSEEN_S {
                continue;
            }
            let start = Self { held_s: *held_s, pitch_rad, rate_rad_s: step.rate_rad_s[1].into() };
            let motion = start.fly(setup, &release.params, left_s + COMPARED_S)?;
            let difference = rms_difference(&logged[..early], &motion);
            if best.is_none_or(|(least, _)| difference < least) {
                best = Some((difference, start));
            }
        }
        let (_, start) = best.context("this release has no start")?;
        Ok(start)
    }

    /// The model's motion from the release on, with these parameters.
    fn fly(self, setup: &Setup, params: &Params, end_s: f64) -> Result<Motion> {
        let mut law = Law::new(params, &setup.drone, &setup.timing);
        let pitch_rad = self.pitch_rad;
        let mut model = PitchLoop::new(&setup.drone, setup.servo, setup.timing, pitch_rad, 0.0)?;
        model.drone_mut().clamp(pitch_rad);
        let mut motion = vec![(0.0, pitch_rad)];
        while motion.last().is_some_and(|last| last.0 < end_s) {
            if model.drone().held() && model.sample().time_s >= self.held_s {
                model.drone_mut().release(self.rate_rad_s);
            }
            let sample = model.step(|measurement| law.update(measurement));
            motion.push((sample.time_s, sample.pitch_rad));
        }
        Ok(motion)
    }
}

/// The release as the log has it.
///
/// # Errors
/// Its set point does not rest, or it begins on it.
fn logged(release: &Release<'_>) -> Result<Flown> {
    let run = response(release, Axis::Pitch)
        .context("this release is no step response: its set point moves, or it begins on it")?;
    let motion = release.trace(Step::pitch_rad);
    Ok(Flown { name: "log", motion, run })
}

fn flown(name: &'static str, motion: Motion, target_rad: f64) -> Result<Flown> {
    let response = StepResponse::new(motion.iter().copied(), target_rad)?;
    let run = Run::new(response.initial_error(), &response, true);
    Ok(Flown { name, motion, run })
}

/// RMS difference of pitch at the times of the log, rad.
fn rms_difference(logged: &[(f64, f64)], model: &[(f64, f64)]) -> f64 {
    let at = |time_s: f64| {
        let next = model.partition_point(|point| point.0 < time_s);
        model.get(next).or(model.last()).map_or(0.0, |point| point.1)
    };
    let squares = logged.iter().map(|(time_s, rad)| (rad - at(*time_s)).powi(2));
    (squares.sum::<f64>() / logged.len() as f64).sqrt()
}

fn figures(all: &[Flown], changed: &BTreeMap<String, f32>, difference_rad: f64) -> Figures {
    let row = |flown: &Flown| {
        let run = &flown.run;
        [
            figure("of", flown.name).shown("of", "", 0),
            figure("start_rad", run.start_rad).shown("start", "rad", 3),
            figure("overshoot_pct", run.overshoot_pct).shown("overshoot", "%", 1),
            figure("rise_s", run.rise_s).shown("rise", "s", 3).or("never"),
            figure("settling_5pct_s", run.settling_5pct_s)
                .shown("5 % settling", "s", 3)
                .or("never"),
            figure("final_error_rad", run.final_error_rad).shown("final error", "rad", 4),
        ]
    };
    let words = changed.iter().map(|(name, value)| format!("{name} = {value}"));
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
        let points = flown.motion.iter().map(|(time_s, rad)| (*time_s, rad.to_degrees()));
        Line::new(flown.name, colour, points.collect())
    });
    let set_deg = set_rad.to_degrees();
    let half_deg = settling_band_deg(all[0].run.start_rad);
    let plot = Plot::new("time since release, s", "pitch, deg", lines.collect());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::VehicleChoice;
    use flights::log::{Entry, Event, Log};
    use rig::ServoKind;
    use tvc_nano::failsafe::StateKind;

    /// A log of the model's own flight from 0.3 rad, held for a tenth of a second.
    fn log(setup: &Setup) -> Log {
        let mut law = Law::new(&Params::default(), &setup.drone, &setup.timing);
        let mut model = PitchLoop::new(&setup.drone, setup.servo, setup.timing, 0.3, 0.0).unwrap();
        let step = |index: u64, pitch_rad: f64, rate_rad_s: f64| {
            let half = pitch_rad / 2.0;
            Event::Step(Step {
                quaternion: [half.cos() as f32, 0.0, half.sin() as f32, 0.0],
                rate_rad_s: [0.0, rate_rad_s as f32, 0.0],
                ..Step::level(1_000_000 + index * 10_000)
            })
        };
        let mut events = vec![Event::State(StateKind::Active as u32)];
        model.drone_mut().clamp(0.3);
        for index in 0..210 {
            if index == 10 {
                model.drone_mut().release(0.2);
            }
            let now = model.sample();
            events.push(step(index, now.pitch_rad, now.rate_rad_s));
            for _ in 0..20 {
                model.step(|measurement| law.update(measurement));
            }
        }
        let messages = events.iter().flat_map(Event::messages);
        let entry = |message| Entry { time_us: 0, from_vehicle: true, message, lost_before: 0 };
        Log { entries: messages.map(entry).collect(), ..Log::default() }
    }

    #[test]
    fn the_model_repeats_its_own_flight_and_answers_to_a_change() {
        let setup = VehicleChoice::default().drone(ServoKind::S3003).unwrap();
        let flight = Flight::of(&log(&setup));
        let release = flight.release(None).unwrap();
        let again = |changed: &[(&str, f32)]| {
            let changed = changed.iter().map(|(name, value)| ((*name).to_owned(), *value));
            flown_again(&release, &setup, &changed.collect()).unwrap()
        };
        let same = again(&[]);
        assert_eq!(same.len(), 2);
        let difference_rad = rms_difference(&same[0].motion, &same[1].motion);
        assert!(difference_rad < 0.01, "{difference_rad}");
        let settled = |flown: &Flown| flown.run.settling_5pct_s.unwrap();
        assert!((settled(&same[0]) - settled(&same[1])).abs() < 0.03);
        let loose = again(&[("SFC_GAIN_S", 0.1)]);
        let overshoot = |flown: &Flown| flown.run.overshoot_pct;
        assert!(overshoot(&loose[2]) > overshoot(&loose[1]) + 10.0);
        let moved = again(&[("PITCH_SET_DEG", 5.0)]);
        let (_, last_rad) = moved[2].motion.last().unwrap();
        assert!((last_rad - 5_f64.to_radians()).abs() < 0.02, "{last_rad}");
    }
}
