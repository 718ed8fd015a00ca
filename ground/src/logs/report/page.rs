//! The HTML page of `tvc report`.

use std::path::Path;

use anyhow::Result;
use client::ServoMap;
use maud::{Markup, html};
use tvc_nano::Params;

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
        parts.push(one(index, release, &servo)?);
        if let Some(sweep) = Sweep::of(release) {
            parts.push(sweep.markup()?);
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
        @for part in &parts { (part) }
        h2 { "Loop, link and health" }
        (figures.table("hold").markup())
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

fn one(index: usize, release: &Release, servo: &ServoMap) -> Result<Markup> {
    let set: Vec<(f64, f64)> = release
        .trace(|_| 0.0)
        .iter()
        .zip(&release.set_rad)
        .map(|((time, _), set)| (*time, set.to_degrees()))
        .collect();
    let target = release.set_rad[0].to_degrees();
    let start = release.steps[0].pitch_rad().to_degrees() - target;
    let band = settling_band_deg(start.to_radians());
    let rests = release.set_rad.iter().all(|set| *set == release.set_rad[0]);
    let since = "time since release, s";
    let pitch = release.trace(|step| step.pitch_rad().to_degrees());
    let pitch = Plot::new(
        since,
        "pitch, deg",
        vec![Line::new("pitch", 0, pitch), Line::new("set point", 1, set)],
    );
    let pitch = pitch.with_band(rests.then_some((target - band, target + band)));
    let commanded = release.trace(|step| servo.angle_rad(step.pulses_us[0]).to_degrees());
    let name = "servo commanded";
    let command = Plot::new(
        since,
        "servo commanded, deg",
        vec![Line::new(name, 4, commanded)],
    );
    Ok(html! {
        h2 { "Release " (index + 1) }
        (figure("Pitch, with the 5 % band that a step has to settle in.", pitch.svg()?))
        (figure("The servo angle commanded.", command.svg()?))
    })
}
