//! The image's own control law in the model's pitch loop, with the parameters that it ships with.

use std::path::Path;

use anyhow::Result;
use plant::pitch_loop::{COMMAND_LIMIT_RAD, Measurement, Timing};
use plant::{Parameters, ServoModel, Setup};
use tvc_nano::{Controller, Params};

use crate::out::exit::BadInput;
use crate::param_file;
use rig::ServoKind;

/// The image's controller with the linkage of a drone.
pub struct Law {
    controller: Controller,
    zero_rad: f64,
}

impl Law {
    /// The controller with its crank at zero rudder.
    pub fn new(params: &Params, drone: &Parameters) -> Self {
        Self {
            controller: Controller::new(params, COMMAND_LIMIT_RAD as f32),
            zero_rad: drone.linkage().zero_rudder_crank_rad(),
        }
    }

    /// Takes a measurement and gives the crank command, in rad.
    pub fn update(&mut self, measurement: Measurement) -> f64 {
        let (pitch, rate) = (measurement.pitch_rad, measurement.rate_rad_s);
        self.zero_rad + f64::from(self.controller.update(pitch as f32, rate as f32))
    }
}

/// The parameters that the image flies a servo with: its defaults, the rig's parameters for the
/// servo, and those of a file.
///
/// # Errors
/// A file that cannot be used.
pub fn parameters(servo: ServoKind, gains: Option<&Path>) -> Result<Params> {
    let mut params = Params::default();
    for (name, value) in servo.parameters() {
        params
            .set(name, *value)
            .map_err(|error| anyhow::anyhow!("{error}"))?;
    }
    for row in gains
        .map(param_file::read)
        .transpose()?
        .into_iter()
        .flatten()
    {
        params
            .set(&row.name, row.value)
            .map_err(|error| BadInput::new(format!("{}: {error}", row.name)))?;
    }
    Ok(params)
}

/// The drone with a servo and the firmware's timing, changed by what a parameter file says.
///
/// # Errors
/// A file that cannot be used.
pub fn setup(servo: ServoKind, file: Option<&Path>) -> Result<Setup> {
    let (servo, timing) = match servo {
        ServoKind::S3003 => (ServoModel::S3003, Timing::NANO_50HZ),
        ServoKind::Digital => (ServoModel::DIGITAL, Timing::NANO_300HZ),
    };
    let base = Setup {
        drone: Parameters::PHYS,
        servo,
        timing,
    };
    let Some(path) = file else { return Ok(base) };
    let bad = |error: &dyn std::fmt::Display| BadInput::new(format!("{}: {error}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| bad(&error))?;
    Ok(Setup::parse_over(&text, &base).map_err(|error| bad(&error))?)
}
