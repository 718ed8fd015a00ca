//! A simulation described by a TOML file: drone, start, input, and the trajectory it gives.
//!
//! ```toml
//! seconds = 5.0
//! dt_s = "5 ms"                 # of the output; the integrator chooses its own
//!
//! [drone]                       # and [servo], [timing]: as in a parameter file
//! preset = "THESIS_TEXT"
//!
//! [start]                       # all zero if left out, the crank at zero rudder
//! pitch_rad = 0.2
//! pitch_rate_rad_s = 0.2
//!
//! [input]                       # one of these; no input at all is a crank without torque
//! torque_n_m = 0.1              # or a table: [[0.0, 0.0], [1.0, 0.1]], straight between points
//! # voltage_v = 6.0             # torque through the motor constant
//! # crank_rad = [[0.0, 0.0], [0.5, 0.3]]   # prescribed crank, smooth between points
//! # ideal_servo = { kp = 1.0, kd = 0.3, stiffness = 900.0, damping = 60.0 }
//! # pulse_servo = { kp = 1.0, kd = 0.3 }   # the loop of `pitch_loop`, on [servo] and [timing]
//!
//! [options]
//! hold_pitch = false            # true: body 0 does not turn
//! # crank_stop = { angle_rad = 0.8, stiffness_n_m_rad = 50.0, damping_n_m_s = 0.05 }
//! ```
//!
//! The ideal servo is `th1'' = stiffness (command - th1) - damping th1'` with the command
//! `th1z + kp th0 + kd w0`.

mod run;
mod signal;

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::integrate::IntegrationError;
use crate::parameters::{ParameterError, finite, not_negative, positive};
use crate::setup::{Setup, SetupError, in_si};

pub use signal::Signal;

/// Most rows of a trajectory.
const MOST_ROWS: f64 = 5e6;

/// What drives the crank.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Input {
    /// A torque on the crank, in N m.
    TorqueNM(Signal),
    /// A voltage of the servo motor, in V.
    VoltageV(Signal),
    /// The crank's angle, in rad.
    CrankRad(Signal),
    /// A servo of second order round a PD law.
    IdealServo {
        /// Gain on pitch, rad/rad.
        kp: f64,
        /// Gain on pitch rate, rad s/rad.
        kd: f64,
        /// Acceleration for each radian of error, in 1/s2.
        stiffness: f64,
        /// Acceleration for each rad/s, in 1/s.
        damping: f64,
    },
    /// The pulse-driven servo of the setup round a PD law.
    PulseServo {
        /// Gain on pitch, rad/rad.
        kp: f64,
        /// Gain on pitch rate, rad s/rad.
        kd: f64,
    },
}

/// Where the motion starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Pitch, in rad.
    pub pitch_rad: f64,
    /// Crank angle, in rad; zero rudder if left out. A prescribed crank starts where it is told to.
    pub crank_rad: Option<f64>,
    /// Pitch rate, in rad/s.
    pub pitch_rate_rad_s: f64,
    /// Crank rate, in rad/s.
    pub crank_rate_rad_s: f64,
}

/// A spring and damper that stop the crank beyond an angle, either side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrankStop {
    /// Where it begins, in rad.
    pub angle_rad: f64,
    /// Stiffness, in N m/rad.
    pub stiffness_n_m_rad: f64,
    /// Damping while in contact, in N m s/rad.
    pub damping_n_m_s: f64,
}

/// Peculiarities of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Body 0 does not turn.
    pub hold_pitch: bool,
    /// A stop of the crank.
    pub crank_stop: Option<CrankStop>,
}

/// A simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Drone, servo and timing.
    pub setup: Setup,
    /// Length, in s.
    pub seconds: f64,
    /// Interval of the output, in s.
    pub dt_s: f64,
    /// Start.
    pub start: Start,
    /// Input.
    pub input: Input,
    /// Peculiarities.
    pub options: Options,
}

/// One row of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Time, in s.
    pub t: f64,
    /// Pitch, in rad.
    pub theta0: f64,
    /// Crank, in rad.
    pub theta1: f64,
    /// Link, in rad.
    pub theta2: f64,
    /// Rudder, in rad.
    pub theta3: f64,
    /// Pitch rate, in rad/s.
    pub w0: f64,
    /// Crank rate relative to body 0, in rad/s.
    pub w1: f64,
    /// Link rate relative to body 0, in rad/s.
    pub w2: f64,
    /// Rudder rate relative to body 0, in rad/s.
    pub w3: f64,
}

/// Why a scenario cannot be run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// Drone, servo or timing.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// Start, input or options.
    #[error("{0}")]
    Key(String),
    /// A value out of range.
    #[error(transparent)]
    Range(#[from] ParameterError),
    /// A table whose times do not increase or whose values are not finite.
    #[error("the input's table must have finite values in order of time; point {0} has not")]
    Table(usize),
    /// Too many rows, or none.
    #[error("{seconds} s every {dt_s} s is not between one and five million rows")]
    Rows {
        /// Length, in s.
        seconds: f64,
        /// Interval, in s.
        dt_s: f64,
    },
    /// The pulse-driven loop runs on its own clock.
    #[error("{0}")]
    Loop(&'static str),
    /// The motion ran away.
    #[error(transparent)]
    Integration(#[from] IntegrationError),
}

/// The file without drone, servo and timing.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    seconds: f64,
    #[serde(default = "default_dt")]
    dt_s: f64,
    #[serde(default)]
    start: Start,
    #[serde(default = "no_torque")]
    input: Input,
    #[serde(default)]
    options: Options,
}

fn default_dt() -> f64 {
    5e-3
}

fn no_torque() -> Input {
    Input::TorqueNM(Signal::Constant(0.0))
}

impl Scenario {
    /// Reads a scenario file.
    ///
    /// # Errors
    /// Unknown keys, bad units, values out of range, each by name.
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        let mut file: Table = text
            .parse()
            .map_err(|error: toml::de::Error| SetupError::Syntax(error.to_string()))?;
        let setup = Setup::take(&mut file)?;
        let rest = in_si("", Value::Table(file)).map_err(ScenarioError::Key)?;
        let File {
            seconds,
            dt_s,
            start,
            input,
            options,
        } = rest
            .try_into()
            .map_err(|error: toml::de::Error| ScenarioError::Key(error.message().to_string()))?;
        let scenario = Self {
            setup,
            seconds,
            dt_s,
            start,
            input,
            options,
        };
        scenario.validate()?;
        Ok(scenario)
    }

    /// Checks everything that a run relies on.
    ///
    /// # Errors
    /// The first thing found wanting.
    pub fn validate(&self) -> Result<(), ScenarioError> {
        self.setup.validate()?;
        let rows = self.seconds / self.dt_s;
        if !(self.dt_s > 0.0 && (1.0 - 1e-9..=MOST_ROWS).contains(&rows)) {
            return Err(ScenarioError::Rows {
                seconds: self.seconds,
                dt_s: self.dt_s,
            });
        }
        finite(&[
            ("pitch_rad", self.start.pitch_rad),
            ("crank_rad", self.start.crank_rad.unwrap_or(0.0)),
            ("pitch_rate_rad_s", self.start.pitch_rate_rad_s),
            ("crank_rate_rad_s", self.start.crank_rate_rad_s),
        ])?;
        if let Some(stop) = self.options.crank_stop {
            positive(&[
                ("angle_rad", stop.angle_rad),
                ("stiffness_n_m_rad", stop.stiffness_n_m_rad),
            ])?;
            not_negative(&[("damping_n_m_s", stop.damping_n_m_s)])?;
        }
        match &self.input {
            Input::TorqueNM(signal) | Input::VoltageV(signal) | Input::CrankRad(signal) => {
                signal.validate()
            }
            Input::IdealServo {
                kp,
                kd,
                stiffness,
                damping,
            } => {
                finite(&[("kp", *kp), ("kd", *kd)])?;
                positive(&[("stiffness", *stiffness), ("damping", *damping)])?;
                Ok(())
            }
            Input::PulseServo { kp, kd } => {
                finite(&[("kp", *kp), ("kd", *kd)])?;
                self.check_loop()
            }
        }
    }

    fn check_loop(&self) -> Result<(), ScenarioError> {
        let steps = self.dt_s / self.setup.timing.step_s;
        if (steps - steps.round()).abs() > 1e-6 || steps.round() < 1.0 {
            return Err(ScenarioError::Loop(
                "dt_s must be a whole number of the timing's step_s for a pulse_servo",
            ));
        }
        let plain = self.start.crank_rad.is_none() && self.start.crank_rate_rad_s == 0.0;
        if !plain || self.options != Options::default() {
            return Err(ScenarioError::Loop(
                "a pulse_servo starts at zero rudder, at rest, and takes no options",
            ));
        }
        Ok(())
    }
}
