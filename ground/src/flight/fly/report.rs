//! The HTML report of `tvc fly`.

use std::sync::Arc;

use maud::{Markup, html};
use rig::flight::FlightRecord;
use rig::recording::Recording;
use rig::replay::ReplayRecord;

use super::figures::{Figures, ROW_COLUMNS, RUN_COLUMNS, run_rows};
use crate::out::page::{figure, page, table, verdicts};
use crate::out::plot::{Line, Plot};

/// Settling band, share of the start, as drawn.
const BAND: f64 = 0.05;
/// Half the width that the settling band has at least in a picture, deg.
const LEAST_BAND_DEG: f64 = 0.2;

/// What is drawn; the figures come when the page is made.
pub enum Page {
    /// Flights from one or several tilts.
    Flights {
        /// Name of the servo.
        servo: &'static str,
        /// The seed.
        seed: u64,
        /// A record a start.
        records: Vec<FlightRecord>,
    },
    /// A replayed recording.
    Recording {
        /// What was played.
        recording: Arc<Recording>,
        /// What came of it.
        record: Box<ReplayRecord>,
    },
}

impl Page {
    /// A page about flights.
    pub fn flights(servo: &'static str, seed: u64, records: Vec<FlightRecord>) -> Self {
        Self::Flights {
            servo,
            seed,
            records,
        }
    }

    /// A page about a replay.
    pub fn recording(recording: Arc<Recording>, record: ReplayRecord) -> Self {
        Self::Recording {
            recording,
            record: Box::new(record),
        }
    }

    /// The whole page as HTML.
    pub fn render(&self, figures: &Figures, missed: &[String]) -> anyhow::Result<String> {
        let (title, plots) = match self {
            Self::Flights {
                servo,
                seed,
                records,
            } => (
                format!("Flight on the virtual rig: servo {servo}, seed {seed}"),
                flights(records)?,
            ),
            Self::Recording { recording, record } => {
                (format!("Replay of {}", recording.name()), played(record)?)
            }
        };
        let body = html! {
            (verdicts(missed))
            @if !figures.runs.is_empty() {
                h2 { "Step responses" }
                p { "Figures of the drone's true pitch, released with 0.2 rad/s." }
                (table(&RUN_COLUMNS, &run_rows(&figures.runs)))
            }
            (plots)
            h2 { "Loop, image and emulation" }
            (table(&ROW_COLUMNS, &figures.rows()))
            footer {
                "The firmware image ran on an emulated SAMD21 with an emulated BNO055, servo and \
                 drone; nothing here was measured on a board. Repeat it with the same options and \
                 seed: the simulated figures come out the same."
            }
        };
        Ok(page(&title, body))
    }
}

/// Half the settling band as drawn, deg.
pub fn settling_band_deg(start_rad: f64) -> f64 {
    (BAND * start_rad.abs()).to_degrees().max(LEAST_BAND_DEG)
}

fn flights(records: &[FlightRecord]) -> anyhow::Result<Markup> {
    let mut parts = Vec::new();
    for record in records {
        let seconds = |at: samd21::board::Ticks| at.saturating_sub(record.released).as_secs_f64();
        let motion = |of: fn(&rig::ground_truth::Motion) -> f64| -> Vec<(f64, f64)> {
            record
                .motion
                .iter()
                .map(|m| (seconds(m.time), of(m).to_degrees()))
                .collect()
        };
        let band = settling_band_deg(record.start_rad);
        let estimate = record.received.attitudes.iter();
        let pitch = Plot {
            x: "time since release, s",
            y: "pitch, deg",
            lines: vec![
                Line {
                    name: "true",
                    colour: 0,
                    points: motion(|m| m.pitch_rad),
                },
                Line {
                    name: "estimated, as it arrives",
                    colour: 1,
                    points: estimate
                        .filter(|a| a.at >= record.released)
                        .map(|a| (seconds(a.at), a.pitch_rad().to_degrees()))
                        .collect(),
                },
            ],
            band: Some((-band, band)),
        };
        let rudder = Plot {
            x: "time since release, s",
            y: "angle, deg",
            lines: vec![
                Line {
                    name: "crank asked for",
                    colour: 4,
                    points: motion(|m| m.target_rad),
                },
                Line {
                    name: "crank",
                    colour: 2,
                    points: motion(|m| m.crank_rad),
                },
                Line {
                    name: "rudder",
                    colour: 0,
                    points: motion(|m| m.rudder_rad),
                },
            ],
            band: None,
        };
        parts.push(html! {
            h2 { "From " (record.start_rad) " rad" }
            (figure("Pitch, with the 5 % band that it has to settle in.", pitch.svg()?))
            (figure("The servo's crank and the rudder behind the linkage.", rudder.svg()?))
        });
    }
    Ok(html! { @for part in &parts { (part) } })
}

fn played(record: &ReplayRecord) -> anyhow::Result<Markup> {
    let seconds = |a: &rig::ground_station::Attitude| f64::from(a.time_ms) / 1e3;
    let angle = |of: fn(&rig::ground_station::Attitude) -> f64| -> Vec<(f64, f64)> {
        record
            .received
            .attitudes
            .iter()
            .map(|a| (seconds(a), of(a).to_degrees()))
            .collect()
    };
    let estimate = Plot {
        x: "time since power-on, s",
        y: "angle, deg",
        lines: vec![
            Line {
                name: "pitch",
                colour: 0,
                points: angle(rig::ground_station::Attitude::pitch_rad),
            },
            Line {
                name: "tilt",
                colour: 2,
                points: angle(tilt_rad),
            },
        ],
        band: None,
    };
    Ok(html! {
        h2 { "Estimated attitude" }
        (figure("What the image sent over USB.", estimate.svg()?))
    })
}

/// Angle between the body's z axis and the vertical, rad.
fn tilt_rad(attitude: &rig::ground_station::Attitude) -> f64 {
    let [_, x, y, _] = attitude.quaternion.map(f64::from);
    (1.0 - 2.0 * (x * x + y * y)).clamp(-1.0, 1.0).acos()
}
