//! Arguments about a vehicle that more than one command takes.

use tvc_nano::{Axis, Params};

/// An axis of the vehicle, by its name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum AxisName {
    /// Nose up and down.
    #[default]
    Pitch,
    /// To the sides.
    Roll,
}

impl From<AxisName> for Axis {
    fn from(name: AxisName) -> Self {
        match name {
            AxisName::Pitch => Self::Pitch,
            AxisName::Roll => Self::Roll,
        }
    }
}

/// Parses a parameter of the firmware and a value that it can have, `NAME=VALUE`.
///
/// # Errors
/// What is wrong with it.
pub fn parameter(text: &str) -> Result<(String, f32), String> {
    let (name, value) =
        text.split_once('=').ok_or("a parameter is NAME=VALUE, such as PID_KP=1.2")?;
    let value = value.parse().map_err(|_| format!("{value} is no number"))?;
    Params::default().set(name, value).map_err(|error| format!("{name}: {error}"))?;
    Ok((name.to_owned(), value))
}
