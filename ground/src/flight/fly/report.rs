//! The HTML report of `tvc fly`.

use std::sync::Arc;

use maud::{Markup, html};
use recordings::Recording;
use rig::flight::FlightRecord;
use rig::replay::ReplayRecord;

use crate::flight::figures::settling_band_deg;
use report::measure::Figures;
use report::page::{figure, page, verdicts};
use report::plot::{Line, Plot};

/// What the page draws; its figures are handed to [`render`](Self::render).
pub enum Page {
    /// Flights from one or several tilts.
    Flights {
        /// Name of the servo.
        servo: &'static str,
        /// The seed.
        seed: u64,
        /// One record for each start.
        records: Vec<FlightRecord>,
    },
    /// A replayed recording.
    Recording {
        /// What was played.
        recording: Arc<Recording>,
        /// What the image made of it.
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
    pub fn render(&self, figures: &Figures) -> anyhow::Result<String> {
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
        let runs = figures.table("runs");
        let body = html! {
            (verdicts(&figures.missed()))
            @if !runs.is_empty() {
                h2 { "Step responses" }
                p { "Figures of the drone's true pitch, released with 0.2 rad/s." }
                (runs.markup())
            }
            (plots)
            h2 { "Loop, image and emulation" }
            (figures.lines().markup())
            footer {
                "The firmware image ran on an emulated SAMD21 with an emulated BNO055, servo and \
                 drone; nothing here was measured on a board. Repeat it with the same options and \
                 seed: the simulated figures come out the same."
            }
        };
        Ok(page(&title, body))
    }
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
        let [start_rad, _] = record.start_rad;
        let band = settling_band_deg(start_rad);
        let estimate = record.received.attitudes.iter();
        let estimated = estimate
            .filter(|a| a.at >= record.released)
            .map(|a| (seconds(a.at), a.pitch_rad().to_degrees()));
        let since = "time since release, s";
        let pitch = Plot::new(
            since,
            "pitch, deg",
            vec![
                Line::new("true", 0, motion(|m| m.pitch_rad)),
                Line::new("estimated, as it arrives", 1, estimated.collect()),
            ],
        );
        let pitch = pitch.with_band(Some((-band, band)));
        let rudder = Plot::new(
            since,
            "angle, deg",
            vec![
                Line::new("crank commanded", 4, motion(|m| m.target_rad)),
                Line::new("crank", 2, motion(|m| m.crank_rad)),
                Line::new("rudder", 0, motion(|m| m.rudder_rad)),
            ],
        );
        parts.push(html! {
            h2 { "From " (start_rad) " rad" }
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
    let estimate = Plot::new(
        "time since power-on, s",
        "angle, deg",
        vec![
            Line::new("pitch", 0, angle(rig::ground_station::Attitude::pitch_rad)),
            Line::new("tilt", 2, angle(tilt_rad)),
        ],
    );
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
