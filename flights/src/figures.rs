//! Figures of a release, on the rig or in a log, held to what is required.

use client::LinkCounts;
use plant::StepResponse;
use rig::measure::Spread;

use crate::log::Release;
use crate::requirements;
use report::measure::{Figure, Limit, figure};
use rig::ServoKind;
use tvc_nano::{Axis, Params};

/// Settling band, share of the start.
const BAND: f64 = 0.05;
/// Half the width that the settling band has at least in a picture, deg.
const LEAST_BAND_DEG: f64 = 0.2;
/// Tilt from which on a vehicle with two axes counts as tilted about one of them, rad.
const TILTED_RAD: f64 = 0.05;

/// One release, by the angle of an axis.
#[derive(Clone, Debug)]
pub struct Run {
    /// Tilt at the release, from the set point, rad.
    pub start_rad: f64,
    /// Excursion past the set point, percent of the start.
    pub overshoot_pct: f64,
    /// Time to a tenth of the start, s; none if it never gets there.
    pub rise_s: Option<f64>,
    /// Time after which it stays within 5 % of the start, s; none if it never does.
    pub settling_5pct_s: Option<f64>,
    /// Mean error over the last tenth of the flight, rad.
    pub final_error_rad: f64,
    /// Whether the firmware was still in control at the end.
    pub stayed_active: bool,
}

impl Run {
    /// A release from `start_rad`.
    pub fn new(start_rad: f64, response: &StepResponse, stayed_active: bool) -> Self {
        Self {
            start_rad,
            overshoot_pct: response.overshoot_pct(),
            rise_s: response.rise_s(),
            settling_5pct_s: response.settling_s(BAND),
            final_error_rad: response.final_error(),
            stayed_active,
        }
    }

    /// The figures, held to what is required with `servo`.
    pub fn figures(&self, servo: ServoKind) -> [Figure; 6] {
        [
            figure("start_rad", self.start_rad).shown("start", "rad", 2),
            figure("overshoot_pct", self.overshoot_pct)
                .shown("overshoot", "%", 1)
                .limit(requirements::OVERSHOOT_PCT),
            figure("rise_s", self.rise_s).shown("rise", "s", 3).or("never"),
            figure("settling_5pct_s", self.settling_5pct_s)
                .shown("5 % settling", "s", 3)
                .or("never")
                .limit(requirements::settling_s(servo)),
            figure("final_error_rad", self.final_error_rad).shown("final error", "rad", 4),
            figure("stayed_active", self.stayed_active)
                .shown("in control to the end", "", 0)
                .limit(requirements::IN_CONTROL),
        ]
    }
}

/// Mean and maximum of a time in us, the mean held to a limit if there is one.
pub fn spread(key: &'static str, of: Spread, label: &str, mean: Option<Limit>) -> Figure {
    let shown = |key, us: f64, which| figure(key, us).shown(format!("{label}, {which}"), "us", 0);
    figure(key, [shown("mean", of.mean, "mean").limit(mean), shown("max", of.max, "worst")])
}

/// What arrived over a link.
pub fn telemetry(counts: LinkCounts) -> Figure {
    let held = |key, count: u64, label| {
        let shown = figure(key, count).shown(label, "", 0);
        shown.limit(requirements::LOST_MESSAGES)
    };
    figure(
        "telemetry",
        [
            figure("messages", counts.messages).shown("messages", "", 0),
            held("lost", counts.lost, "messages lost"),
            held("crc_errors", counts.crc_errors, "messages damaged"),
        ],
    )
}

/// Half the settling band of a start as a picture shows it, deg.
pub fn settling_band_deg(start_rad: f64) -> f64 {
    (BAND * start_rad.abs()).to_degrees().max(LEAST_BAND_DEG)
}

/// The servo that firmware parameters are for, by their frame rate.
pub fn servo(params: &Params) -> ServoKind {
    if params.srv_rate_hz() >= ServoKind::Digital.frame_hz() {
        ServoKind::Digital
    } else {
        ServoKind::S3003
    }
}

/// The response of an axis to the release, if its set point rested; one that begins on it is none,
/// nor is that of a vehicle with two axes which was tilted about the other.
pub fn response(release: &Release, axis: Axis) -> Option<Run> {
    let set_rad = release.set_rad(axis);
    let target = set_rad[0];
    if set_rad.iter().any(|set| *set != target) {
        return None;
    }
    let response = StepResponse::new(release.motion(axis), target).ok()?;
    if release.axes().len() > 1 && response.initial_error().abs() < TILTED_RAD {
        return None;
    }
    Some(Run::new(response.initial_error(), &response, release.stayed))
}
