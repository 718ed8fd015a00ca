//! What the vehicle tells of itself.

use std::time::{Duration, Instant};

use anyhow::Result;
use client::status::sick;
use client::{Parameter, Readiness, Request, request};
use mavlink::dialects::common::{AUTOPILOT_VERSION_DATA, MavMessage};
use serde::Serialize;
use tvc_nano::Params;
use tvc_nano::failsafe::StateCode;
use tvc_nano::params::Polarity;

use crate::logs::log::vehicle_build;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::PortOptions;

/// How long what the vehicle tells once a second is waited for.
const TOLD: Duration = Duration::from_secs(3);

/// Groups of parameters that a calibration writes, by how their names begin.
const CALIBRATED: [(&str, &str); 5] = [
    ("accelerometer", "CAL_ACC_"),
    ("gyroscope", "CAL_GYR_"),
    ("magnetometer", "CAL_MAG_"),
    ("mount", "MNT_"),
    ("servo", "SRV_"),
];

/// The vehicle.
#[derive(Debug, Default, Serialize)]
pub struct Told {
    /// Version and build; `None` if it does not tell.
    pub build: Option<String>,
    /// It runs the image at hand.
    pub runs_image: Option<bool>,
    /// The state of the flight.
    pub state: String,
    /// The same, as the vehicle tells it.
    #[serde(skip)]
    pub code: Option<StateCode>,
    /// Everything that is enabled is healthy.
    pub healthy: Option<bool>,
    /// What has been set up: some parameter of it has another value than its default.
    pub calibrated: Vec<&'static str>,
    /// What has its defaults.
    pub uncalibrated: Vec<&'static str>,
    /// A person has seen the rudder answer the right way.
    pub polarity_checked: bool,
    /// An order to arm would be obeyed.
    pub ready: Option<bool>,
    /// Why not.
    pub refusal: Option<String>,
}

/// Asks the vehicle; `image` is the build id of the image at hand.
///
/// # Errors
/// No such port, no vehicle, or it falls silent.
pub fn ask(options: &PortOptions, image: Option<&str>) -> Result<Told> {
    let mut vehicle = Vehicle::connect(options)?;
    let now = vehicle.link().now();
    let version = Request::Order(request::VERSION);
    // What it tells is taken from the messages; an old one refuses.
    vehicle.link().client().request(now, version);
    let mut readiness = Readiness::default();
    let mut build = None;
    let end = Instant::now() + TOLD;
    let is_complete = |readiness: &Readiness| {
        readiness.code().is_some() && readiness.is_ready().is_some() && readiness.is_level_known()
    };
    while (build.is_none() || !is_complete(&readiness)) && Instant::now() < end {
        for frame in vehicle.receive()? {
            if let MavMessage::AUTOPILOT_VERSION(told) = &frame.message {
                build = Some(told.clone());
            }
            readiness.take(&frame.message);
        }
    }
    let parameters = vehicle.parameters()?;
    Ok(told(&readiness, build.as_ref(), &parameters, image))
}

fn told(
    readiness: &Readiness,
    build: Option<&AUTOPILOT_VERSION_DATA>,
    parameters: &[Parameter],
    image: Option<&str>,
) -> Told {
    let mut params = Params::default();
    for row in parameters {
        // One that this tool does not know says nothing here.
        let _ = params.set(&row.name, row.value);
    }
    let is_set_up = |prefix: &str| {
        let defaults = Params::default();
        let differs = |row: &Parameter| {
            let default = defaults.value(&row.name);
            // It is told apart below, and the frame rate is that of the kind of servo.
            let counts = !matches!(&*row.name, "SRV_POLARITY" | "SRV_RATE_HZ");
            counts
                && row.name.starts_with(prefix)
                && default.is_some_and(|value| value != row.value)
        };
        parameters.iter().any(differs)
    };
    let (calibrated, uncalibrated): (Vec<_>, Vec<_>) =
        CALIBRATED.iter().partition(|(_, prefix)| is_set_up(prefix));
    let names = |groups: Vec<&(&'static str, &str)>| groups.iter().map(|group| group.0).collect();
    let build = build.map(vehicle_build);
    Told {
        runs_image: image.and_then(|image| Some(build.as_ref()?.ends_with(image))),
        build,
        state: readiness
            .code()
            .map_or("unknown".into(), |code| code.to_string()),
        code: readiness.code(),
        healthy: readiness.status().map(|status| sick(status).is_empty()),
        calibrated: names(calibrated),
        uncalibrated: names(uncalibrated),
        polarity_checked: params.polarity() == Polarity::Checked,
        ready: readiness.is_ready(),
        refusal: readiness.refusal(&params),
    }
}

impl Told {
    /// For a person, a line each.
    pub fn lines(&self, mut line: impl FnMut(&str, &str)) {
        let build = self.build.as_deref().unwrap_or("build not told");
        let same = match self.runs_image {
            Some(true) => ": the image above",
            Some(false) => ": not the image above",
            None => "",
        };
        line("vehicle", &format!("{build}{same}"));
        line("state", &self.state);
        line(
            "sensors",
            match self.healthy {
                Some(true) => "healthy",
                Some(false) => "not healthy",
                None => "not told",
            },
        );
        let list = |names: &[&str]| match names {
            [] => "nothing".to_owned(),
            names => names.join(", "),
        };
        line("calibrated", &list(&self.calibrated));
        if !self.uncalibrated.is_empty() {
            line("default", &list(&self.uncalibrated));
        }
        let polarity = if self.polarity_checked {
            "seen"
        } else {
            "not seen yet"
        };
        line("polarity", polarity);
        let arming = match (&self.refusal, self.ready) {
            (Some(refusal), _) => format!("refused: {refusal}"),
            (None, Some(_)) => "would be obeyed".into(),
            (None, None) => "not told".into(),
        };
        line("arming", &arming);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_its_defaults_is_named() {
        let rows = |pairs: &[(&str, f32)]| -> Vec<Parameter> {
            let row = |(name, value): &(&str, f32)| Parameter {
                name: (*name).into(),
                value: *value,
            };
            pairs.iter().map(row).collect()
        };
        let told = |pairs, image| {
            let version = AUTOPILOT_VERSION_DATA {
                flight_custom_version: *b"0a1b2c3d",
                ..AUTOPILOT_VERSION_DATA::default()
            };
            super::told(&Readiness::default(), Some(&version), &rows(pairs), image)
        };
        let blank = told(&[("SRV_POLARITY", 0.0), ("CAL_ACC_SX", 1.0)], None);
        assert_eq!(blank.uncalibrated.len(), CALIBRATED.len());
        assert!(!blank.polarity_checked && blank.runs_image.is_none());
        let some = told(
            &[
                ("SRV_POLARITY", 1.0),
                ("SRV_RATE_HZ", 300.0),
                ("CAL_ACC_SX", 1.01),
            ],
            Some("0a1b2c3d"),
        );
        assert_eq!(some.calibrated, ["accelerometer"]);
        assert_eq!((some.polarity_checked, some.runs_image), (true, Some(true)));
        assert_eq!(told(&[], Some("ffffffff")).runs_image, Some(false));
    }
}
