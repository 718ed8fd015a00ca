//! The HTML page of `tvc report`.

use std::path::Path;

use anyhow::Result;
use client::ServoMap;
use maud::{Markup, html};
use tvc_nano::{Axis, Params};

use super::sweep::Sweep;
use super::{events, last_parameters};
use crate::flight::figures::settling_band_deg;
use crate::logs::log::{Flight, Release, Step};
use crate::out::measure::Figures;
use crate::out::page::{figure, page, table, verdicts};
use crate::out::plot::{Line, Plot};

/// The whole page.
pub fn render(log: &Path, flight: &Flight, figures: &Figures) -> Result<String> {
    let servo = ServoMap::of(&flight.parameters());
    let mut parts = vec![whole(flight, &servo)?];
    for (index, release) in flight.releases().iter().enumerate() {
        parts.push(html! { h2 { "Release " (index + 1) } });
        for axis in release.axes() {
            parts.push(one(release, *axis)?);
            if let Some(sweep) = Sweep::of(release, *axis) {
                parts.push(sweep.markup()?);
            }
        }
    }
    let runs = figures.table("runs");
    let body = html! {
        (verdicts(&figures.missed()))
        @if !runs.is_empty() {
            h2 { "Step responses" }
            p { "Figures of the pitch that the vehicle estimated." }
            (runs.markup())
        }
        @let roll = figures.table("roll_runs");
        @if !roll.is_empty() {
            h2 { "Step responses of roll" }
            (roll.markup())
        }
        @for part in &parts { (part) }
        h2 { "Loop, link and health" }
        (figures.table("hold").markup())
        (figures.table("roll_hold").markup())
        (figures.lines().markup())
        h2 { "What the vehicle said" }
        (table(&["words", "its clock, s"], &events(flight).iter().map(|(time, text)| {
            vec![text.clone(), format!("{time:.3}")]
        }).collect::<Vec<_>>()))
        h2 { "Parameters" }
        (table(&["parameter", "value", "default"], &last_parameters(flight).iter().map(|(name, value)| {
            let default = Params::default().value(name);
            vec![name.clone(), value.to_string(), default.map_or(String::new(), |d| d.to_string())]
        }).collect::<Vec<_>>()))
        footer {
            "By the vehicle's own estimate and clock, from its telemetry; delays in the servo, the rudder and the \
             air do not show here."
        }
    };
    Ok(page(&format!("Report of {}", log.display()), body))
}

fn whole(flight: &Flight, servo: &ServoMap) -> Result<Markup> {
    let begin = flight.steps().next().map_or(0.0, Step::time_s);
    let line = |of: &dyn Fn(&Step) -> f64| -> Vec<(f64, f64)> {
        flight
            .steps()
            .map(|step| (step.time_s() - begin, of(step)))
            .collect()
    };
    let commanded = line(&|step| servo.angle_rad(step.pulses_us[0]).to_degrees());
    let plot = Plot::new(
        "time, s",
        "angle, deg",
        vec![
            Line::new("pitch", 0, line(&|step| step.pitch_rad().to_degrees())),
            Line::new("servo commanded", 4, commanded),
        ],
    );
    Ok(html! {
        h2 { "The whole log" }
        (figure("Pitch and the servo angle commanded.", plot.svg()?))
    })
}

/// An axis in a release: its angle, and what its servo was commanded.
fn one(release: &Release, axis: Axis) -> Result<Markup> {
    let servo = ServoMap::of_axis(&release.params, axis);
    let motion = release.motion(axis);
    let degrees = |(time, angle): (f64, f64)| (time, angle.to_degrees());
    let set_rad = release.set_rad(axis);
    let times = motion.iter().map(|(time, _)| *time);
    let set = times.zip(set_rad.iter().copied()).map(degrees);
    let target = set_rad[0].to_degrees();
    let band = settling_band_deg(motion[0].1 - set_rad[0]);
    let rests = set_rad.iter().all(|set| *set == set_rad[0]);
    let since = "time since release, s";
    let (name, label, caption, command_caption) = match axis {
        Axis::Pitch => (
            "pitch",
            "pitch, deg",
            "Pitch, with the 5 % band that a step has to settle in.",
            "The servo angle commanded.",
        ),
        Axis::Roll => (
            "roll",
            "roll, deg",
            "Roll, with the 5 % band that a step has to settle in.",
            "The angle commanded of the second servo.",
        ),
    };
    let lines = vec![
        Line::new(name, 0, motion.iter().copied().map(degrees).collect()),
        Line::new("set point", 1, set.collect()),
    ];
    let angle = Plot::new(since, label, lines);
    let angle = angle.with_band(rests.then_some((target - band, target + band)));
    let pulse = |step: &Step| servo.angle_rad(step.pulses_us[axis.index()]).to_degrees();
    let command = Plot::new(
        since,
        "servo commanded, deg",
        vec![Line::new("servo commanded", 4, release.trace(pulse))],
    );
    Ok(html! {
        (figure(caption, angle.svg()?))
        (figure(command_caption, command.svg()?))
    })
}
