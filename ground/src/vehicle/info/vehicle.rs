//! What the vehicle tells of itself.

use std::time::Duration;

use anyhow::Result;
use client::status::sick;
use client::{Failure, Parameter, Request, request};
use mavlink::dialects::common::{AUTOPILOT_VERSION_DATA, MavMessage, SYS_STATUS_DATA};
use report::measure::{Figure, data, figure};
use tvc_nano::failsafe::{RefusalKind, StateCode};
use tvc_nano::params::Polarity;
use tvc_nano::{Axis, Params};

use crate::vehicle::link::Vehicle;
use flights::log::vehicle_build;

/// How long what the vehicle tells once a second is waited for.
const TOLD: Duration = Duration::from_secs(3);

/// Groups of parameters that a calibration writes, by how their names begin.
const CALIBRATED: [(&str, &str); 5] = [
    ("accelerometer", "CAL_ACC_"),
    ("gyroscope", "CAL_GYR_"),
    (MAGNETOMETER, "CAL_MAG_"),
    ("mount", "MNT_"),
    (SERVO, "SRV_"),
];
/// The group of the magnetometer.
const MAGNETOMETER: &str = "magnetometer";
/// The group of the servo.
pub const SERVO: &str = "servo";

/// The vehicle.
#[derive(Debug, Default)]
pub struct Told {
    /// Version and build; `None` if it does not tell.
    pub build: Option<String>,
    /// It runs the image at hand.
    pub runs_image: Option<bool>,
    /// The state of the flight.
    pub state: String,
    /// The same, as the vehicle tells it.
    pub code: Option<StateCode>,
    /// Everything that is enabled is healthy.
    pub healthy: Option<bool>,
    /// What has been set up: some parameter of it has another value than its default, or, of the
    /// servo, the polarity has been seen.
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
/// It does not answer.
pub fn ask(vehicle: &mut Vehicle, image: Option<&str>) -> Result<Told> {
    // What it tells is taken from the messages; an old one refuses.
    vehicle.link().request(Request::Order(request::VERSION));
    let (mut build, mut status) = (None, None);
    let end = vehicle.now() + TOLD;
    while (build.is_none() || status.is_none()) && vehicle.now() < end {
        for frame in vehicle.receive()? {
            match frame.message {
                MavMessage::AUTOPILOT_VERSION(told) => build = Some(told),
                MavMessage::SYS_STATUS(told) => status = Some(told),
                _ => {}
            }
        }
    }
    let parameters = vehicle.parameters()?;
    let may_arm = may_arm(vehicle)?;
    let code = vehicle.link().client().state_code();
    let heard = Heard { build, code, status, parameters, may_arm };
    Ok(heard.told(image))
}

/// Whether an order to arm would be obeyed, as the vehicle says when it is asked; `None` where the
/// firmware does not know the question.
fn may_arm(vehicle: &mut Vehicle) -> Result<Option<Result<(), RefusalKind>>> {
    let Err(error) = vehicle.command(request::MAY_ARM) else {
        return Ok(Some(Ok(())));
    };
    match error.downcast_ref() {
        Some(Failure::Refused { refusal, .. }) => Ok(refusal.map(Err)),
        _ => Err(error),
    }
}

/// What has been heard.
#[derive(Default)]
struct Heard {
    build: Option<AUTOPILOT_VERSION_DATA>,
    code: Option<StateCode>,
    status: Option<SYS_STATUS_DATA>,
    parameters: Vec<Parameter>,
    may_arm: Option<Result<(), RefusalKind>>,
}

impl Heard {
    fn told(&self, image: Option<&str>) -> Told {
        let mut params = Params::default();
        for row in &self.parameters {
            // One that this tool does not know says nothing here.
            let _ = params.set(&row.name, row.value);
        }
        let defaults = Params::default();
        let differs = |row: &&Parameter| {
            // The polarity is told apart below, and the frame rate is that of the kind of servo.
            let counts = !matches!(&*row.name, "SRV_POLARITY" | "SRV2_POLARITY" | "SRV_RATE_HZ");
            counts && defaults.value(&row.name).is_some_and(|default| default != row.value)
        };
        let set: Vec<_> = self.parameters.iter().filter(differs).collect();
        let is_checked = |axis: &Axis| params.polarity(*axis) == Polarity::Checked;
        let polarity_checked = params.axes().iter().all(is_checked);
        // A servo may be as the defaults say: whoever has seen the rudder answer knows.
        let is_done = |(name, prefix): &&(&str, &str)| {
            let is_set_up = set.iter().any(|row| row.name.starts_with(prefix));
            is_set_up || (*name == SERVO && polarity_checked)
        };
        let has_mag = params.sensor_kind().description().has_mag;
        let groups = CALIBRATED.iter().filter(|(name, _)| has_mag || *name != MAGNETOMETER);
        let (calibrated, uncalibrated): (Vec<_>, Vec<_>) = groups.partition(is_done);
        let names =
            |groups: Vec<&(&'static str, &str)>| groups.iter().map(|group| group.0).collect();
        let build = self.build.as_ref().map(vehicle_build);
        let state = self.code.map_or("unknown".into(), |code| code.to_string());
        let refusal = self.may_arm.and_then(Result::err).map(|why| match why {
            RefusalKind::WrongState => format!("in {state}"),
            why => why.to_string(),
        });
        Told {
            runs_image: image.and_then(|image| Some(build.as_ref()?.ends_with(image))),
            build,
            state,
            code: self.code,
            healthy: self.status.as_ref().map(|status| sick(status).is_empty()),
            calibrated: names(calibrated),
            uncalibrated: names(uncalibrated),
            polarity_checked,
            ready: self.may_arm.map(|answer| answer.is_ok()),
            refusal,
        }
    }
}

impl Told {
    /// A line each.
    pub fn figures(&self) -> Vec<Figure> {
        let build = self.build.as_deref().unwrap_or("build not told");
        let same = match self.runs_image {
            Some(true) => ": the image above",
            Some(false) => ": not the image above",
            None => "",
        };
        let healthy = match self.healthy {
            Some(true) => "healthy",
            Some(false) => "not healthy",
            None => "not told",
        };
        let list = |names: &[&str]| match names {
            [] => "nothing".to_owned(),
            names => names.join(", "),
        };
        let polarity = if self.polarity_checked { "seen" } else { "not seen yet" };
        let arming = match (&self.refusal, self.ready) {
            (Some(refusal), _) => format!("refused: {refusal}"),
            (None, Some(_)) => "would be obeyed".into(),
            (None, None) => "not told".into(),
        };
        vec![
            figure("build", self.build.as_deref()).said("vehicle", format!("{build}{same}")),
            figure("runs_image", self.runs_image),
            figure("state", &*self.state).shown("state", "", 0),
            figure("healthy", self.healthy).said("sensors", healthy),
            data("calibrated", &self.calibrated).said("calibrated", list(&self.calibrated)),
            data("uncalibrated", &self.uncalibrated).said("default", list(&self.uncalibrated)),
            figure("polarity_checked", self.polarity_checked).said("polarity", polarity),
            figure("ready", self.ready).said("arming", arming),
            figure("refusal", self.refusal.as_deref()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_its_defaults_is_named() {
        let rows = |pairs: &[(&str, f32)]| -> Vec<Parameter> {
            pairs.iter().map(|(name, value)| Parameter::new(*name, *value)).collect()
        };
        let told = |pairs, image| {
            let build = AUTOPILOT_VERSION_DATA {
                flight_custom_version: *b"0a1b2c3d",
                ..AUTOPILOT_VERSION_DATA::default()
            };
            let heard = Heard { build: Some(build), parameters: rows(pairs), ..Heard::default() };
            heard.told(image)
        };
        let blank = told(&[("SRV_POLARITY", 0.0), ("CAL_ACC_SX", 1.0)], None);
        assert_eq!(blank.uncalibrated.len(), CALIBRATED.len());
        assert!(!blank.polarity_checked && blank.runs_image.is_none());
        let some = told(
            &[("SRV_POLARITY", 1.0), ("SRV_RATE_HZ", 300.0), ("CAL_ACC_SX", 1.01)],
            Some("0a1b2c3d"),
        );
        assert_eq!(some.calibrated, ["accelerometer", "servo"]);
        let unseen = told(&[("SRV_CENTRE_US", 1500.0), ("SRV_RATE_HZ", 50.0)], None);
        assert_eq!(unseen.calibrated, ["servo"]);
        assert_eq!((some.polarity_checked, some.runs_image), (true, Some(true)));
        assert_eq!(told(&[], Some("ffffffff")).runs_image, Some(false));
    }

    #[test]
    fn a_refusal_to_arm_is_told_in_words() {
        let told = |may_arm| {
            let heard = Heard { code: Some(StateCode::Boot), may_arm, ..Heard::default() };
            let told = heard.told(None);
            (told.ready, told.refusal)
        };
        assert_eq!(told(None), (None, None));
        assert_eq!(told(Some(Ok(()))), (Some(true), None));
        let refused = |why: &str| (Some(false), Some(why.to_owned()));
        let in_boot = "in boot: waiting for the sensor";
        assert_eq!(told(Some(Err(RefusalKind::WrongState))), refused(in_boot));
        let tilted = told(Some(Err(RefusalKind::Tilt)));
        assert_eq!(tilted, refused("tilt beyond 50 deg"));
    }
}
