//! The HTML report of `tvc fly`.

use anyhow::Result;
use maud::{Markup, html};
use rig::flight::FlightRecord;
use rig::ground_station::Attitude;
use rig::ground_truth::Motion;
use rig::replay::ReplayRecord;

use super::since;
use flights::figures::settling_band_deg;
use report::measure::Figures;
use report::page::{figure, page, verdicts};
use report::plot::{Line, Plot};

/// The figures, and the whole page as HTML.
pub fn told(title: &str, figures: Figures, plots: &[Markup]) -> (Figures, String) {
    let runs = figures.table("runs");
    let body = html! {
        (verdicts(&figures.missed()))
        @if !runs.is_empty() {
            h2 { "Step responses" }
            p { "Figures of the drone's true pitch, released with 0.2 rad/s." }
            (runs.markup())
        }
        @for plot in plots { (plot) }
        h2 { "Loop, image and emulation" }
        (figures.lines().markup())
        footer {
            "The firmware image ran on an emulated SAMD21 with an emulated BNO055, servo and \
             drone; nothing here was measured on a board. Repeat it with the same options and \
             seed: the simulated figures come out the same."
        }
    };
    (figures, page(title, body))
}

/// The pictures of a flight.
pub fn flown(record: &FlightRecord) -> Result<Markup> {
    let motion = |of: fn(&Motion) -> f64| -> Vec<(f64, f64)> {
        let motion = record.motion.iter();
        motion.map(|m| (since(record, m.time), of(m).to_degrees())).collect()
    };
    let [start_rad, _] = record.start_rad;
    let band = settling_band_deg(start_rad);
    let estimated = record.received.attitudes.iter().filter(|a| a.at >= record.released);
    let estimated = estimated.map(|a| (since(record, a.at), a.pitch_rad().to_degrees()));
    let pitch = [
        Line::new("true", 0, motion(|m| m.tilt_rad[0])),
        Line::new("estimated, as it arrives", 1, estimated.collect()),
    ];
    let rudder = [
        Line::new("crank commanded", 4, motion(|m| m.targets_rad[0])),
        Line::new("crank", 2, motion(|m| m.cranks_rad[0])),
        Line::new("rudder", 0, motion(|m| m.rudders_rad[0])),
    ];
    let time = "time since release, s";
    let pitch = Plot::new(time, "pitch, deg", pitch.into()).with_band(Some((-band, band)));
    let rudder = Plot::new(time, "angle, deg", rudder.into());
    Ok(html! {
        h2 { "From " (start_rad) " rad" }
        (figure("Pitch, with the 5 % band that it has to settle in.", pitch.svg()?))
        (figure("The servo's crank and the rudder behind the linkage.", rudder.svg()?))
    })
}

/// The picture of a replayed recording.
pub fn played(record: &ReplayRecord) -> Result<Markup> {
    let angle = |of: fn(&Attitude) -> f64| -> Vec<(f64, f64)> {
        let attitudes = record.received.attitudes.iter();
        attitudes.map(|a| (f64::from(a.time_ms) / 1e3, of(a).to_degrees())).collect()
    };
    let lines =
        [Line::new("pitch", 0, angle(Attitude::pitch_rad)), Line::new("tilt", 2, angle(tilt_rad))];
    let estimate = Plot::new("time since power-on, s", "angle, deg", lines.into());
    Ok(html! {
        h2 { "Estimated attitude" }
        (figure("What the image sent over USB.", estimate.svg()?))
    })
}

/// Angle between the body's z axis and the vertical, rad.
fn tilt_rad(attitude: &Attitude) -> f64 {
    let [_, x, y, _] = attitude.quaternion.map(f64::from);
    (1.0 - 2.0 * (x * x + y * y)).clamp(-1.0, 1.0).acos()
}
