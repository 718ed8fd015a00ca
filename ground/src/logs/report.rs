//! `tvc report`: a log as figures and as a page; a log of the rig is treated as one of a real vehicle.

mod page;
pub mod sweep;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use client::StateKind;
use client::state::state_of;
use plant::response::StepResponse;
use rig::measure::Spread as Measured;
use serde::Serialize;

use crate::flight::fly::figures::{
    OVERSHOOT_PCT, RUN_COLUMNS, RunFigures, Spread, TelemetryFigures, aligned, run_rows,
    settling_limit_s,
};
use crate::logs::log::{Event, Flight, Log, Step};
use crate::logs::replay::parameters;
use crate::out::exit::Verdict;
use crate::out::file::{print_figures, write_whole};
use clap::Args;
use rig::ServoKind;
use std::path::PathBuf;
use sweep::Sweep;
use tvc_nano::Params;

/// Options of `tvc report`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc report flight.tlog                 writes flight.html, prints the figures
  cargo tvc report flight.tlog --out step.html
  cargo tvc report flight.tlog --json          figures for a script

Exit status: 0 every requirement met, 1 one missed or something failed, 2 unusable input.")]
pub struct Report {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// Where to write the page [default: the log's name with .html].
    #[arg(long, value_name = "FILE.html")]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Settling band, share of the start.
const BAND: f64 = 0.05;
/// Time after the release in which the drone swings upright, s: it does not count for how well it is held.
const SWING_S: f64 = 2.0;
/// Least frame rate of a digital servo, Hz.
const DIGITAL_HZ: f32 = 300.0;
/// Largest deviation of a control period, us.
const JITTER_US: f64 = 100.0;

/// Everything that `tvc report --json` prints, as one object.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// One entry a release.
    pub runs: Vec<RunFigures>,
    /// How well each was held after its first two seconds; none for a shorter one.
    pub hold: Vec<Option<HoldFigures>>,
    /// The frequency response of each release whose set point swings.
    pub sweep: Vec<Option<Sweep>>,
    /// The control loop.
    #[serde(rename = "loop")]
    pub control: LoopFigures,
    /// What arrived.
    pub telemetry: TelemetryFigures,
    /// The vehicle's health.
    pub health: HealthFigures,
    /// Parameters at the end of the log.
    pub parameters: BTreeMap<String, f32>,
    /// The vehicle's texts with its clock, s.
    pub events: Vec<(f64, String)>,
}

/// How well pitch was held at its set point.
#[derive(Debug, Serialize)]
pub struct HoldFigures {
    /// Mean error, rad.
    pub mean_error_rad: f64,
    /// RMS error, rad.
    pub rms_error_rad: f64,
    /// Largest error, rad.
    pub max_error_rad: f64,
}

/// Timing by the vehicle's own clock.
#[derive(Debug, Serialize)]
pub struct LoopFigures {
    /// Control steps.
    pub steps: usize,
    /// Samples a second where none is missing.
    pub rate_hz: f64,
    /// Largest deviation of the time between two samples from its mean.
    pub jitter_us_max: f64,
    /// From the start of a sample's burst to its control step.
    pub sample_to_step_us: Spread,
    /// Steps without a usable sample.
    pub missed: usize,
}

/// Health, as the vehicle tells it once a second.
#[derive(Debug, Default, Serialize)]
pub struct HealthFigures {
    /// Largest share of time for which the processor was awake, 0 to 1.
    pub load_max: f64,
    /// Failed transfers on the sensor's bus within the log.
    pub bus_errors: u16,
    /// Frames within the log that the vehicle dropped because nobody took them.
    pub dropped: u16,
    /// Seconds after the self-test in which something enabled was not healthy.
    pub unhealthy: usize,
}

/// A release until control ended.
pub struct Release<'a> {
    /// Its steps.
    pub steps: Vec<&'a Step>,
    /// The set point at each, rad.
    pub set_rad: Vec<f64>,
    /// Control was on until the log or the operator ended it.
    pub stayed: bool,
}

/// Reads a log, prints its figures and writes the page.
pub fn run(options: &Report) -> Result<Verdict> {
    let flight = Flight::of(&Log::read(&options.log)?);
    let page = match &options.out {
        Some(path) => path.clone(),
        None => options.log.with_extension("html"),
    };
    conclude(&flight, &options.log, Some(&page), options.json)
}

/// Figures to standard output, the page to its file, and whether the requirements are met.
pub fn conclude(flight: &Flight, log: &Path, page: Option<&Path>, json: bool) -> Result<Verdict> {
    let figures = figures(flight);
    let missed = figures.missed(servo(&parameters(flight)));
    if let Some(path) = page {
        let text = page::render(log, flight, &figures, &missed)?;
        write_whole(path, text.as_bytes())?;
    }
    print_figures(&figures, json, Figures::text)?;
    if let Some(path) = page {
        eprintln!("report: {}", path.display());
    }
    Ok(Verdict::naming(&missed))
}

/// The servo that the parameters are for.
pub fn servo(params: &Params) -> ServoKind {
    if params.srv_rate_hz() >= DIGITAL_HZ {
        ServoKind::Digital
    } else {
        ServoKind::S3003
    }
}

/// The figures of a log.
pub fn figures(flight: &Flight) -> Figures {
    let releases = releases(flight);
    Figures {
        runs: releases.iter().filter_map(step_figures).collect(),
        hold: releases.iter().map(hold_figures).collect(),
        sweep: releases.iter().map(Sweep::of).collect(),
        control: loop_figures(flight),
        telemetry: TelemetryFigures {
            messages: flight.counts.messages,
            lost: flight.counts.lost,
            crc_errors: flight.counts.crc_errors,
        },
        health: health(flight),
        parameters: last_parameters(flight),
        events: events(flight),
    }
}

/// Every stretch of the log in which control was active.
pub fn releases(flight: &Flight) -> Vec<Release<'_>> {
    let mut set_rad = f64::from(parameters(flight).pitch_set_deg()).to_radians();
    let mut releases: Vec<Release> = Vec::new();
    let mut active = false;
    for event in &flight.events {
        match event {
            Event::State(code) => {
                let state = state_of(*code);
                match (active, state == Some(StateKind::Active)) {
                    (false, true) => releases.push(Release {
                        steps: Vec::new(),
                        set_rad: Vec::new(),
                        stayed: true,
                    }),
                    (true, false) => {
                        if let Some(release) = releases.last_mut() {
                            // Only the operator leads from control to standby.
                            release.stayed = state == Some(StateKind::Standby);
                        }
                    }
                    _ => {}
                }
                active = state == Some(StateKind::Active);
            }
            Event::Parameter(name, value) if name == "PITCH_SET_DEG" => {
                set_rad = f64::from(*value).to_radians();
            }
            Event::Step(step) if active => {
                if let Some(release) = releases.last_mut() {
                    release.steps.push(step);
                    release.set_rad.push(set_rad);
                }
            }
            _ => {}
        }
    }
    releases.retain(|release| release.steps.len() > 1);
    releases
}

impl Release<'_> {
    /// Time since the release and a value, at every step.
    pub fn trace(&self, of: impl Fn(&Step) -> f64) -> Vec<(f64, f64)> {
        let begin = self.steps[0].time_s();
        self.steps
            .iter()
            .map(|step| (step.time_s() - begin, of(step)))
            .collect()
    }
}

/// The response to the release, if the set point rested; one that begins on it is none.
fn step_figures(release: &Release) -> Option<RunFigures> {
    let target = release.set_rad[0];
    if release.set_rad.iter().any(|set| *set != target) {
        return None;
    }
    let response = StepResponse::new(release.trace(Step::pitch_rad), target).ok()?;
    Some(RunFigures {
        start_rad: response.initial_error(),
        overshoot_pct: response.overshoot_pct(),
        rise_s: response.rise_s(),
        settling_5pct_s: response.settling_s(BAND),
        final_error_rad: response.final_error(),
        stayed_active: release.stayed,
    })
}

fn hold_figures(release: &Release) -> Option<HoldFigures> {
    let trace = release.trace(Step::pitch_rad);
    let errors: Vec<f64> = trace
        .iter()
        .zip(&release.set_rad)
        .filter(|((time, _), _)| *time >= SWING_S)
        .map(|((_, pitch), set)| pitch - set)
        .collect();
    let count = errors.len() as f64;
    (!errors.is_empty()).then(|| HoldFigures {
        mean_error_rad: errors.iter().sum::<f64>() / count,
        rms_error_rad: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
        max_error_rad: errors.iter().map(|e| e.abs()).fold(0.0, f64::max),
    })
}

fn loop_figures(flight: &Flight) -> LoopFigures {
    let mut periods = Vec::new();
    let mut delays = Vec::new();
    let mut last = None;
    for event in &flight.events {
        match event {
            Event::Gap(_) => last = None,
            Event::Step(step) => {
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
    let period: Measured = periods.iter().copied().collect();
    let delay: Measured = delays.into_iter().collect();
    LoopFigures {
        steps: flight.steps().count(),
        rate_hz: if period.count > 0 {
            1e6 / period.mean
        } else {
            0.0
        },
        jitter_us_max: periods
            .iter()
            .map(|us| (us - period.mean).abs())
            .fold(0.0, f64::max),
        sample_to_step_us: delay.into(),
        missed: flight.missed(),
    }
}

fn health(flight: &Flight) -> HealthFigures {
    let mut figures = HealthFigures::default();
    let mut first = None;
    let mut starting = true;
    for event in &flight.events {
        match event {
            Event::State(code) => {
                starting = matches!(state_of(*code), Some(StateKind::Boot | StateKind::SelfTest));
            }
            Event::Status(status) => {
                let first = first.get_or_insert(status);
                figures.load_max = figures.load_max.max(f64::from(status.load) * 1e-3);
                figures.bus_errors = status.errors_count3.wrapping_sub(first.errors_count3);
                figures.dropped = status.errors_count1.wrapping_sub(first.errors_count1);
                let healthy = status
                    .onboard_control_sensors_health
                    .contains(status.onboard_control_sensors_enabled);
                figures.unhealthy += usize::from(!healthy && !starting);
            }
            _ => {}
        }
    }
    figures
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

impl Figures {
    /// Every requirement that was missed, a sentence each.
    pub fn missed(&self, servo: ServoKind) -> Vec<String> {
        let mut missed = crate::flight::fly::figures::missed_by_runs(&self.runs, servo);
        if self.control.jitter_us_max >= JITTER_US {
            missed.push(format!(
                "jitter {:.1} us, allowed {JITTER_US}",
                self.control.jitter_us_max
            ));
        }
        if self.telemetry.lost > 0 || self.telemetry.crc_errors > 0 {
            missed.push(format!(
                "{} messages lost, {} damaged",
                self.telemetry.lost, self.telemetry.crc_errors
            ));
        }
        missed
    }

    /// Name and figure of all that is not about single releases.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let (control, telemetry, health) = (&self.control, &self.telemetry, &self.health);
        let mut rows: Vec<Vec<String>> = Vec::new();
        let mut row = |name: &str, figure: String| rows.push(vec![name.to_owned(), figure]);
        row(
            "control steps / without a sample",
            format!("{} / {}", control.steps, control.missed),
        );
        row("control rate", format!("{:.2} Hz", control.rate_hz));
        row("jitter, worst", format!("{:.1} us", control.jitter_us_max));
        row(
            "burst start to step, mean / worst",
            format!(
                "{:.0} / {:.0} us",
                control.sample_to_step_us.mean, control.sample_to_step_us.max
            ),
        );
        row(
            "messages / lost / damaged",
            format!(
                "{} / {} / {}",
                telemetry.messages, telemetry.lost, telemetry.crc_errors
            ),
        );
        row("frames dropped by the vehicle", health.dropped.to_string());
        row(
            "processor awake, most",
            format!("{:.1} %", 100.0 * health.load_max),
        );
        row("bus errors", health.bus_errors.to_string());
        row("seconds unhealthy", health.unhealthy.to_string());
        for (index, hold) in self.hold.iter().enumerate() {
            if let Some(hold) = hold {
                row(
                    &format!(
                        "release {}: error after {SWING_S} s, mean / rms / worst",
                        index + 1
                    ),
                    format!(
                        "{:+.4} / {:.4} / {:.4} rad",
                        hold.mean_error_rad, hold.rms_error_rad, hold.max_error_rad
                    ),
                );
            }
        }
        for (index, sweep) in self.sweep.iter().enumerate() {
            if let Some(sweep) = sweep {
                row(&format!("release {}: bandwidth", index + 1), sweep.words());
            }
        }
        rows
    }

    /// Everything as text for a terminal.
    pub fn text(&self) -> String {
        use comfy_table::CellAlignment;

        let mut text = String::new();
        if !self.runs.is_empty() {
            text += &aligned(&RUN_COLUMNS, &run_rows(&self.runs), CellAlignment::Right);
            text += &format!(
                "\n\nrequired: overshoot <= {OVERSHOOT_PCT} %, 5 % settling <= {} s (s3003) or {} s (digital)\n\n",
                settling_limit_s(ServoKind::S3003),
                settling_limit_s(ServoKind::Digital)
            );
        }
        text += &aligned(&["", "measured"], &self.rows(), CellAlignment::Left);
        text.push('\n');
        text
    }
}
