//! `tvc report`: a log as figures and as a page; a log of the rig is treated as one of a real
//! vehicle.

mod compare;
pub mod page;
pub mod sweep;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use client::StateKind;
use client::state::state_of;
use client::status::sick;
use rig::ServoKind;
use rig::measure::Spread;
use tvc_nano::Axis;

use flights::figures::{Run, response, servo, spread, telemetry};
use flights::log::{Event, Flight, Release, Step};
use flights::requirements;
use report::exit::Verdict;
use report::kind::{self, Kind};
use report::measure::{Figure, Figures, Limit::AtLeast, data, figure, rows, shown};
use sweep::Sweep;

/// Options of `tvc report`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc report flight.tlog                 writes flight.html, prints the figures
  tvc report flight.tlog --out step.html
  tvc report flight.tlog --json          figures for a script
  tvc report before.tlog after.tlog --out both.html    releases of several logs over each other

A log without a release has no verdict: exit status 1.
Exit status: 0 every requirement met, 1 one missed or something failed, 2 unusable input.")]
pub struct Report {
    /// A telemetry log (.tlog, .mcap), or several to compare.
    #[arg(value_name = "LOG", required = true)]
    pub logs: Vec<PathBuf>,

    /// Where to write the page [default: the log's name with .html; report/logs.html for several].
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Where the page of several logs goes.
const SEVERAL: &str = "report/logs.html";

/// Time after the release in which the drone swings upright, s: it does not count for how well it
/// is held.
const SWING_S: f64 = 2.0;

/// Timing of the control loop by the vehicle's own clock.
struct LoopTiming {
    /// Samples a second where none is missing.
    rate_hz: f64,
    /// Largest deviation of the time between two samples from its mean, us.
    jitter_us_max: f64,
    /// From the start of a sample's burst to its control step, us.
    sample_to_step_us: Spread,
}

/// Reads a log, prints its figures and writes the page.
pub fn run(options: &Report) -> Result<Verdict> {
    let given = options.out.as_deref();
    let [log] = options.logs.as_slice() else {
        let page = kind::given_or(given, SEVERAL, Kind::Page)?;
        return compare::run(&options.logs, &page, options.json);
    };
    let page = kind::given_or(given, log.with_extension("html"), Kind::Page)?;
    let flight = Flight::read(log)?;
    conclude(&flight, figures(&flight), log, Some(&page), options.json)
}

/// Prints the figures, writes the page to its file, and names the requirements that are missed.
pub fn conclude(
    flight: &Flight,
    figures: Figures,
    log: &Path,
    page: Option<&Path>,
    json: bool,
) -> Result<Verdict> {
    let page =
        page.map(|path| anyhow::Ok((path, page::render(log, flight, &figures)?))).transpose()?;
    figures.conclude(json, page)
}

/// The figures of a log.
pub fn figures(flight: &Flight) -> Figures {
    let releases = flight.releases();
    let servo = servo(&flight.parameters());
    let has_roll = releases.iter().any(|release| release.axes().len() > 1);
    let mut figures = vec![flight.origin.figures(), releases_figure(releases.len())];
    figures.extend(axis_figures(&releases, Axis::Pitch, servo));
    figures.extend([
        loop_figures(flight),
        telemetry(flight.counts),
        health_figures(flight),
        data("parameters", &last_parameters(flight)),
        data("events", &events(flight)),
    ]);
    if has_roll {
        figures.extend(axis_figures(&releases, Axis::Roll, servo));
    }
    figures.into()
}

/// The figures of the releases, of one axis.
fn axis_figures(releases: &[Release], axis: Axis, servo: ServoKind) -> Vec<Figure> {
    let ([runs_key, hold_key, sweep_key], name) = match axis {
        Axis::Pitch => (["runs", "hold", "sweep"], None),
        Axis::Roll => (["roll_runs", "roll_hold", "roll_sweep"], Some("roll")),
    };
    let runs = releases.iter().filter_map(|release| response(release, axis));
    let run = |run: Run| {
        let axis = name.map(|name| shown("axis", name));
        axis.into_iter().chain(run.figures(servo)).collect::<Vec<_>>()
    };
    let hold = |(index, release)| hold_figures(index, release, axis);
    let sweeps: Vec<_> = releases.iter().map(|release| Sweep::of(release, axis)).collect();
    let mut figures = vec![
        rows(runs_key, runs.map(run)),
        rows(hold_key, releases.iter().enumerate().map(hold)),
        data(sweep_key, &sweeps),
    ];
    let of = name.map_or(String::new(), |name| format!(" of {name}"));
    for (index, sweep) in sweeps.iter().enumerate() {
        let label = format!("release {}: bandwidth{of}", index + 1);
        figures.extend(sweep.as_ref().map(|sweep| shown(label, sweep.words())));
    }
    figures
}

/// How many releases the log has. Without any there is nothing to judge, and no verdict.
fn releases_figure(count: usize) -> Figure {
    let releases = figure("releases", count).limit(AtLeast(1.0));
    match count {
        0 => releases.said("releases", "none, so there is nothing to judge"),
        _ => releases.shown("releases", "", 0),
    }
}

/// How well an axis was held at its set point after the swing upright; none for a shorter release,
/// nor for an axis that was not steered.
fn hold_figures(index: usize, release: &Release, axis: Axis) -> Option<[Figure; 4]> {
    let trace = release.motion(axis);
    let errors: Vec<f64> = trace
        .iter()
        .filter(|_| release.axes().contains(&axis))
        .zip(release.set_rad(axis))
        .filter(|((time, _), _)| *time >= SWING_S)
        .map(|((_, pitch), set)| pitch - set)
        .collect();
    let count = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / count;
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
    let max = errors.iter().map(|e| e.abs()).fold(0.0, f64::max);
    let label = match axis {
        Axis::Pitch => "release",
        Axis::Roll => "release, roll",
    };
    (!errors.is_empty()).then(|| {
        [
            shown(label, format!("{}, after {SWING_S} s", index + 1)),
            figure("mean_error_rad", mean).shown("mean error", "rad", 4),
            figure("rms_error_rad", rms).shown("rms", "rad", 4),
            figure("max_error_rad", max).shown("worst", "rad", 4),
        ]
    })
}

fn loop_figures(flight: &Flight) -> Figure {
    let timing = loop_timing(flight);
    let count = |key, count: usize, label| figure(key, count).shown(label, "", 0);
    figure(
        "loop",
        [
            count("steps", flight.steps().count(), "control steps"),
            figure("rate_hz", timing.rate_hz).shown("control rate", "Hz", 2),
            figure("jitter_us_max", timing.jitter_us_max)
                .shown("jitter, worst", "us", 1)
                .limit(requirements::JITTER_US),
            spread("sample_to_step_us", timing.sample_to_step_us, "burst start to step", None),
            count("missed", flight.missed(), "control steps without a sample"),
        ],
    )
}

/// Health, as the vehicle reports it once a second: its counts within the log, and the seconds
/// after the self-test in which something enabled was not healthy.
fn health_figures(flight: &Flight) -> Figure {
    let (mut load_max, mut bus_errors, mut dropped, mut unhealthy) = (0.0_f64, 0, 0, 0);
    let (mut first, mut starting) = (None, true);
    for event in &flight.events {
        match event {
            Event::State(code) => {
                starting = matches!(state_of(*code), Some(StateKind::Boot | StateKind::SelfTest));
            }
            Event::Status(status) => {
                let first = first.get_or_insert(status);
                load_max = load_max.max(f64::from(status.load) * 1e-3);
                bus_errors = status.errors_count3.wrapping_sub(first.errors_count3);
                dropped = status.errors_count1.wrapping_sub(first.errors_count1);
                unhealthy += u32::from(!sick(status).is_empty() && !starting);
            }
            _ => {}
        }
    }
    let count = |key, count: u32, label| figure(key, count).shown(label, "", 0);
    figure(
        "health",
        [
            figure("load_max", load_max).shown("processor awake, most", "%", 1).scaled(100.0),
            count("bus_errors", bus_errors.into(), "bus errors"),
            count("dropped", dropped.into(), "frames dropped by the vehicle"),
            count("unhealthy", unhealthy, "seconds unhealthy"),
        ],
    )
}

/// What the plan of ticks follows from. The vehicle changes it, its own measurement of the stretch
/// above all, only while it is disarmed.
const PLAN: [&str; 3] = ["I2C_STRETCH_US", "I2C_KHZ", "SRV_RATE_HZ"];

/// Time within which ticks have moved to another plan, us: some servo frames.
const PLANNED_US: u64 = 100_000;

/// A step that moves to another plan is no jitter.
fn loop_timing(flight: &Flight) -> LoopTiming {
    let mut periods = Vec::new();
    let mut delays = Vec::new();
    let mut last = None;
    let (mut now_us, mut planned_us) = (0, 0);
    for event in &flight.events {
        match event {
            Event::Gap(_) => last = None,
            Event::Parameter(name, _) if PLAN.contains(&name.as_str()) => {
                planned_us = now_us + PLANNED_US;
            }
            Event::Step(step) => {
                now_us = step.now_us;
                last = last.filter(|_| now_us > planned_us);
                let time_us = step.sample.map(|sample| sample.time.0 as f64);
                if let (Some(before), Some(time_us)) = (last, time_us) {
                    periods.push(time_us - before);
                }
                if let Some(time_us) = time_us {
                    delays.push(step.now_us as f64 - time_us);
                }
                last = time_us;
            }
            _ => {}
        }
    }
    let period: Spread = periods.iter().copied().collect();
    LoopTiming {
        rate_hz: if period.count > 0 { 1e6 / period.mean } else { 0.0 },
        jitter_us_max: periods.iter().map(|us| (us - period.mean).abs()).fold(0.0, f64::max),
        sample_to_step_us: delays.into_iter().collect(),
    }
}

fn last_parameters(flight: &Flight) -> BTreeMap<String, f32> {
    let told = flight.events.iter().filter_map(|event| match event {
        Event::Parameter(name, value) => Some((name.clone(), *value)),
        _ => None,
    });
    told.collect()
}

/// What was said, with the time of the step before.
fn events(flight: &Flight) -> Vec<(f64, String)> {
    let mut time = flight.steps().next().map_or(0.0, Step::time_s);
    let mut said = Vec::new();
    for event in &flight.events {
        match event {
            Event::Step(step) => time = step.time_s(),
            Event::Said(_, text) => said.push((time, text.clone())),
            Event::Gap(lost) => said.push((time, format!("({lost} frames lost here)"))),
            _ => {}
        }
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use tvc_nano::StateCode;

    #[test]
    fn a_step_to_another_plan_of_ticks_is_no_jitter() {
        let step = |now_us| Event::Step(Step::level(now_us));
        let before = (0..100).map(|index| step(index * 6_667));
        let after = (101..200).map(|index| step(index * 6_667));
        let told = Event::Parameter("I2C_STRETCH_US".into(), 191.0);
        let mut flight =
            Flight { events: before.chain([told]).chain(after).collect(), ..Flight::default() };
        assert!(loop_timing(&flight).jitter_us_max < 1.0);
        flight.events.remove(100);
        assert!(loop_timing(&flight).jitter_us_max > 6_000.0);
    }

    /// A vehicle with this number of axes that is tilted by 0.3 rad to the side and comes upright
    /// within a second.
    fn rolled(axes: f32) -> Flight {
        let step = |index: u32| {
            let since_s = f64::from(index) / 150.0;
            let half = 0.15 * (1.0 - since_s).max(0.0);
            Event::Step(Step {
                quaternion: [half.cos() as f32, half.sin() as f32, 0.0, 0.0],
                ..Step::level(u64::from(index) * 6_667)
            })
        };
        let begin =
            [Event::Parameter("AXES".into(), axes), Event::State(StateCode::Active.number())];
        Flight {
            events: begin.into_iter().chain((0..450).map(step)).collect(),
            ..Flight::default()
        }
    }

    #[test]
    fn a_vehicle_with_two_axes_is_judged_by_both_and_one_that_was_upright_is_no_step() {
        let object = serde_json::json!(figures(&rolled(2.0)));
        assert_eq!(object["runs"].as_array().map(Vec::len), Some(0));
        assert_eq!(object["hold"].as_array().map(Vec::len), Some(1));
        let run = &object["roll_runs"][0];
        assert!((run["start_rad"].as_f64().unwrap() - 0.3).abs() < 1e-6, "{run}");
        assert!(run["settling_5pct_s"].as_f64().unwrap() < 1.0, "{run}");
        assert_eq!(object["roll_hold"].as_array().map(Vec::len), Some(1));
        let flight = rolled(2.0);
        let page = page::render(Path::new("a.tlog"), &flight, &figures(&flight)).unwrap();
        assert!(page.contains("Step responses of roll"));
        let one = serde_json::json!(figures(&rolled(1.0)));
        assert_eq!(one.get("roll_runs"), None);
    }

    #[test]
    fn a_log_without_a_release_has_no_verdict() {
        let missed = figures(&Flight::default()).missed();
        let expected = "releases: none, so there is nothing to judge, required: at least 1";
        assert!(missed.iter().any(|line| line == expected), "{missed:?}");
    }
}
