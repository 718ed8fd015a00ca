//! The HTML page of `tvc report`.

use std::path::Path;

use anyhow::Result;
use client::state::state_of;
use client::status::is_unsettled;
use client::{ServoMap, StateKind};
use maud::{Markup, html};
use tvc_nano::{Axis, Params};

use super::sweep::Sweep;
use super::{events, last_parameters};
use flights::figures::settling_band_deg;
use flights::log::{Event, Flight, Release, Step};
use report::measure::Figures;
use report::page::{figure, page, table, verdicts};
use report::plot::{Line, Plot};

/// The whole page.
pub fn render(log: &Path, flight: &Flight, figures: &Figures) -> Result<String> {
    let servo = ServoMap::of(&flight.parameters(), Axis::Pitch);
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

/// Where the estimate has begun anew and has not settled: times since the first step, s.
fn settling(flight: &Flight) -> Vec<(f64, f64)> {
    let mut stretches = Vec::new();
    let (mut begin, mut now_s, mut since) = (None, 0.0, None);
    for event in &flight.events {
        let is_settling = match event {
            Event::Step(step) => {
                now_s = step.time_s() - *begin.get_or_insert(step.time_s());
                continue;
            }
            Event::State(code) => match state_of(*code) {
                Some(StateKind::Boot | StateKind::SelfTest) => true,
                // The health that is told once a second says whether it has settled.
                Some(StateKind::Standby) => continue,
                _ => false,
            },
            Event::Status(status) => is_unsettled(status),
            _ => continue,
        };
        if is_settling {
            since.get_or_insert(now_s);
        } else {
            stretches.extend(since.take().map(|from| (from, now_s)));
        }
    }
    stretches.extend(since.map(|from| (from, now_s)));
    stretches
}

fn whole(flight: &Flight, servo: &ServoMap) -> Result<Markup> {
    let begin = flight.steps().next().map_or(0.0, Step::time_s);
    let line = |of: &dyn Fn(&Step) -> f64| -> Vec<(f64, f64)> {
        flight.steps().map(|step| (step.time_s() - begin, of(step))).collect()
    };
    let commanded = line(&|step| servo.angle_rad(step.pulses_us[0]).to_degrees());
    let lines = vec![
        Line::new("pitch", 0, line(&|step| step.pitch_rad().to_degrees())),
        Line::new("servo commanded", 4, commanded),
    ];
    let plot = Plot::new("time, s", "angle, deg", lines);
    let stretches = settling(flight);
    let caption = match stretches.is_empty() {
        true => "Pitch and the servo angle commanded.",
        false => "Pitch and the servo angle commanded. Shaded: the estimate begins anew.",
    };
    let plot = Plot { stretches, ..plot };
    Ok(html! {
        h2 { "The whole log" }
        (figure(caption, plot.svg()?))
    })
}

/// An axis in a release: its angle, and what its servo was commanded.
fn one(release: &Release, axis: Axis) -> Result<Markup> {
    let servo = ServoMap::of(&release.params, axis);
    let motion = release.motion(axis);
    let degrees = |(time, angle): (f64, f64)| (time, angle.to_degrees());
    let set_rad = release.set_rad(axis);
    let times = motion.iter().map(|(time, _)| *time);
    let set = times.zip(set_rad.iter().copied()).map(degrees);
    let target = set_rad[0].to_degrees();
    let band = settling_band_deg(motion[0].1 - set_rad[0]);
    let rests = set_rad.iter().all(|set| *set == set_rad[0]);
    let since = "time since release, s";
    let (name, title, command_caption) = match axis {
        Axis::Pitch => ("pitch", "Pitch", "The servo angle commanded."),
        Axis::Roll => ("roll", "Roll", "The angle commanded of the second servo."),
    };
    let label = format!("{name}, deg");
    let caption = format!("{title}, with the 5 % band that a step has to settle in.");
    let lines = vec![
        Line::new(name, 0, motion.iter().copied().map(degrees).collect()),
        Line::new("set point", 1, set.collect()),
    ];
    let angle = Plot::new(since, &label, lines);
    let angle = angle.with_band(rests.then_some((target - band, target + band)));
    let pulse = |step: &Step| servo.angle_rad(step.pulses_us[axis.index()]).to_degrees();
    let command = vec![Line::new("servo commanded", 4, release.trace(pulse))];
    let command = Plot::new(since, "servo commanded, deg", command);
    Ok(html! {
        (figure(&caption, angle.svg()?))
        (figure(command_caption, command.svg()?))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{MavSysStatusSensor, SYS_STATUS_DATA};
    use tvc_nano::StateCode;

    #[test]
    fn the_estimate_begins_anew_in_the_self_test_and_until_it_is_healthy() {
        let step = |seconds: u64| Event::Step(Step::level(seconds * 1_000_000));
        let status = |healthy: bool| {
            let ahrs = MavSysStatusSensor::MAV_SYS_STATUS_AHRS;
            Event::Status(SYS_STATUS_DATA {
                onboard_control_sensors_enabled: ahrs,
                onboard_control_sensors_health: match healthy {
                    true => ahrs,
                    false => MavSysStatusSensor::empty(),
                },
                ..SYS_STATUS_DATA::default()
            })
        };
        let state = |code: StateCode| Event::State(code.number());
        let flight = |events: Vec<Event>| Flight { events, ..Flight::default() };
        let whole = flight(vec![
            step(10),
            status(true),
            step(11),
            state(StateCode::SelfTest(None)),
            step(12),
            state(StateCode::Standby),
            status(false),
            step(13),
            status(true),
            step(14),
            state(StateCode::Armed),
            step(15),
            status(false),
            step(17),
        ]);
        assert_eq!(settling(&whole), [(1.0, 3.0), (5.0, 7.0)]);
        // Who is armed has settled, whatever was told before.
        let armed = [step(0), state(StateCode::SelfTest(None)), step(1)];
        let armed = armed.into_iter().chain([state(StateCode::Armed), step(2)]);
        assert_eq!(settling(&flight(armed.collect())), [(0.0, 1.0)]);
    }
}
