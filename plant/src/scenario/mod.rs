//! Simulations described by TOML files: drone, start, input, and the trajectory that they give.
//!
//! ```toml
//! seconds = 5.0
//! dt_s = "5 ms"                 # of the output; the integrator chooses its own
//!
//! [drone]                       # and [servo], [timing]: as in a vehicle's file
//! preset = "THESIS_TEXT"
//!
//! [start]                       # all zero if left out, the crank at zero rudder
//! pitch_rad = 0.2
//! pitch_rate_rad_s = 0.2
//!
//! [input]                       # one of these; no input at all is a crank without torque
//! torque_n_m = 0.1              # or a table: [[0.0, 0.0], [1.0, 0.1]], straight between points
//! # voltage_v = 6.0             # torque through the motor constant
//! # torque_law = { kp = 2.0, kd = 8.0 }    # torque in proportion to the state
//! # crank_rad = [[0.0, 0.0], [0.5, 0.3]]   # prescribed crank, smooth between points
//! # ideal_servo = { kp = 1.0, kd = 0.3, stiffness = 900.0, damping = 60.0 }
//! # pulse_servo = { kp = 1.0, kd = 0.3 }   # the loop of `pitch_loop`, on [servo] and [timing]
//!
//! [loads]                       # over time, each a number, a table or a sine
//! thrust_n = [[0.0, 0.0], [0.5, 30.0]]     # in place of the drone's
//! pitch_moment_n_m = 0.0        # an external moment on body 0
//!
//! [options]
//! hold_pitch = false            # true: body 0 does not turn
//! # crank_stop = { angle_rad = 0.8, stiffness_n_m_rad = 50.0, damping_n_m_s = 0.05 }
//! ```
//!
//! See [`Signal`] for what a table or a sine looks like, and [`Input`] for the laws.

mod run;
mod signal;

use serde::{Deserialize, Serialize};
use toml::{Table as TomlTable, Value};

use crate::integrate::IntegrationError;
use crate::parameters::{ParameterError, finite, named, not_negative, positive};
use crate::setup::{Setup, SetupError, in_si};

pub use signal::{Between, Signal, Sine, Table};

/// Largest number of rows in a trajectory.
const MOST_ROWS: f64 = 5e6;

/// What drives the crank. `th1z` is the crank angle at zero rudder.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Input {
    /// A torque on the crank, in N m.
    TorqueNM(Signal),
    /// A voltage of the servo motor, in V; the torque is the motor constant times it.
    VoltageV(Signal),
    /// A torque on the crank in proportion to the state.
    TorqueLaw(TorqueLaw),
    /// The crank's angle, in rad.
    CrankRad(Signal),
    /// A servo of second order round a PD law.
    IdealServo(IdealServo),
    /// The pulse-driven servo of the setup round the reference PD law.
    PulseServo(PulseServo),
}

/// A servo of second order round a PD law: `th1'' = stiffness (command - th1) - damping th1'`,
/// with the command `th1z + kp th0 + kd w0 + command_rad`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdealServo {
    /// Gain on pitch, rad/rad.
    #[serde(default)]
    pub kp: f64,
    /// Gain on pitch rate, rad s/rad.
    #[serde(default)]
    pub kd: f64,
    /// Added to the law's command, in rad.
    #[serde(default)]
    pub command_rad: Signal,
    /// Acceleration for each radian of error, in 1/s2.
    pub stiffness: f64,
    /// Acceleration for each rad/s, in 1/s.
    pub damping: f64,
}

/// The pulse-driven servo of the setup round the reference PD law of
/// [`pitch_loop`](crate::pitch_loop).
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PulseServo {
    /// Gain on pitch, rad/rad.
    pub kp: f64,
    /// Gain on pitch rate, rad s/rad.
    pub kd: f64,
    /// Added to the law's command, in rad.
    pub command_rad: Signal,
}

/// `torque = -kp th0 - kd w0 - crank_kp (th1 - th1z) - crank_kd w1`, in N m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TorqueLaw {
    /// On pitch, in N m/rad.
    pub kp: f64,
    /// On pitch rate, in N m s/rad.
    pub kd: f64,
    /// On the crank's angle from zero rudder, in N m/rad.
    pub crank_kp: f64,
    /// On the crank's rate, in N m s/rad.
    pub crank_kd: f64,
}

/// Loads over time.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Loads {
    /// Thrust in N, in place of the drone's own.
    pub thrust_n: Option<Signal>,
    /// External moment on body 0 about the pivot, in N m.
    pub pitch_moment_n_m: Signal,
}

/// Where the motion starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Pitch, in rad.
    pub pitch_rad: f64,
    /// Crank angle, in rad; zero rudder if left out. Not for a prescribed crank, which starts where
    /// its input says.
    pub crank_rad: Option<f64>,
    /// Pitch rate, in rad/s.
    pub pitch_rate_rad_s: f64,
    /// Crank rate relative to body 0, in rad/s.
    pub crank_rate_rad_s: f64,
}

/// A spring and damper that stop the crank beyond an angle, either side.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrankStop {
    /// Where it begins, in rad.
    pub angle_rad: f64,
    /// Stiffness, in N m/rad.
    pub stiffness_n_m_rad: f64,
    /// Damping while in contact, in N m s/rad.
    pub damping_n_m_s: f64,
}

/// Options of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Body 0 does not turn.
    pub hold_pitch: bool,
    /// A stop of the crank, for a crank that a torque drives.
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
    /// Loads.
    pub loads: Loads,
    /// Options.
    pub options: Options,
}

/// One row of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
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

impl Row {
    /// The columns' names, in order.
    pub const COLUMNS: [&'static str; 9] =
        ["t", "theta0", "theta1", "theta2", "theta3", "w0", "w1", "w2", "w3"];

    /// The values in the columns' order.
    pub fn values(&self) -> [f64; 9] {
        let [t0, t1, t2, t3] = [self.theta0, self.theta1, self.theta2, self.theta3];
        [self.t, t0, t1, t2, t3, self.w0, self.w1, self.w2, self.w3]
    }
}

/// Why a scenario cannot be run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// Drone, servo or timing.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// A key that does not exist, a value of the wrong type or out of range, or parts that do not
    /// go together: what is wrong, naming the key.
    #[error("{0}")]
    Key(String),
    /// The crank reached an angle at which the linkage is open.
    #[error(
        "the linkage cannot close past a crank angle of {crank_rad:.3} rad, reached at t = {time_s} s: \
         crank_length_m, link_length_m, arm_length_m and ground_length_m do not fit"
    )]
    Open {
        /// The crank's angle, in rad.
        crank_rad: f64,
        /// When, in s.
        time_s: f64,
    },
    /// The motion ran away.
    #[error(transparent)]
    Integration(#[from] IntegrationError),
}

impl ScenarioError {
    /// Says which table a parameter is in.
    fn in_table(table: &'static str) -> impl FnOnce(ParameterError) -> Self {
        move |error| Self::Key(format!("[{table}] {error}"))
    }
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
    #[serde(default)]
    input: TomlTable,
    #[serde(default)]
    loads: Loads,
    #[serde(default)]
    options: Options,
}

fn default_dt() -> f64 {
    5e-3
}

impl Input {
    /// From the table `[input]`; an empty one is no torque.
    fn take(table: TomlTable) -> Result<Self, ScenarioError> {
        let keys: Vec<String> = table.keys().cloned().collect();
        match keys.as_slice() {
            [] => Ok(Self::TorqueNM(Signal::default())),
            [key] => Value::Table(table).try_into().map_err(|error: toml::de::Error| {
                ScenarioError::Key(format!("[input] {key}: {}", error.message()))
            }),
            several => Err(ScenarioError::Key(format!(
                "[input] takes one key, not {}",
                several.join(" and ")
            ))),
        }
    }
}

impl Scenario {
    /// Reads a scenario file.
    ///
    /// # Errors
    /// Unknown keys, bad units, values out of range, each by name.
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        let mut file: TomlTable =
            text.parse().map_err(|error: toml::de::Error| SetupError::Syntax(error.to_string()))?;
        let setup = Setup::take(&mut file, &Setup::default())?;
        let rest = in_si("", Value::Table(file)).map_err(ScenarioError::Key)?;
        let File { seconds, dt_s, start, input, loads, options } = rest
            .try_into()
            // The text ends in the path of the key that it is about.
            .map_err(|error: toml::de::Error| ScenarioError::Key(error.to_string()))?;
        let scenario =
            Self { setup, seconds, dt_s, start, input: Input::take(input)?, loads, options };
        scenario.validate()?;
        Ok(scenario)
    }

    /// Checks everything that a run relies on.
    ///
    /// # Errors
    /// The first value out of range, by name, or parts that do not go together.
    pub fn validate(&self) -> Result<(), ScenarioError> {
        self.setup.validate()?;
        let rows = self.seconds / self.dt_s;
        if !(self.dt_s > 0.0 && (1.0 - 1e-9..=MOST_ROWS).contains(&rows)) {
            return Err(ScenarioError::Key(format!(
                "seconds = {} every dt_s = {} is not between one and five million rows",
                self.seconds, self.dt_s
            )));
        }
        finite(&[
            ("pitch_rad", self.start.pitch_rad),
            ("crank_rad", self.start.crank_rad.unwrap_or(0.0)),
            ("pitch_rate_rad_s", self.start.pitch_rate_rad_s),
            ("crank_rate_rad_s", self.start.crank_rate_rad_s),
        ])
        .map_err(ScenarioError::in_table("start"))?;
        if let Some(stop) = self.options.crank_stop {
            positive(&named!(stop; angle_rad, stiffness_n_m_rad))
                .and_then(|()| not_negative(&named!(stop; damping_n_m_s)))
                .map_err(ScenarioError::in_table("options"))?;
        }
        if let Some(thrust) = &self.loads.thrust_n {
            check_signal("[loads] thrust_n", thrust)?;
        }
        check_signal("[loads] pitch_moment_n_m", &self.loads.pitch_moment_n_m)?;
        self.validate_input()
    }

    fn validate_input(&self) -> Result<(), ScenarioError> {
        match &self.input {
            Input::TorqueNM(signal) => check_signal("[input] torque_n_m", signal),
            Input::VoltageV(signal) => check_signal("[input] voltage_v", signal),
            Input::CrankRad(signal) => {
                check_signal("[input] crank_rad", signal)?;
                if self.start.crank_rad.is_some() || self.start.crank_rate_rad_s != 0.0 {
                    return Err(ScenarioError::Key(
                        "[start] crank_rad and crank_rate_rad_s do not go with a prescribed crank, \
                         which starts where [input] crank_rad says"
                            .into(),
                    ));
                }
                Ok(())
            }
            Input::TorqueLaw(law) => finite(&named!(law; kp, kd, crank_kp, crank_kd))
                .map_err(ScenarioError::in_table("input")),
            Input::IdealServo(servo) => {
                finite(&named!(servo; kp, kd))
                    .and_then(|()| positive(&named!(servo; stiffness)))
                    .and_then(|()| not_negative(&named!(servo; damping)))
                    .map_err(ScenarioError::in_table("input"))?;
                check_signal("[input] ideal_servo.command_rad", &servo.command_rad)
            }
            Input::PulseServo(servo) => {
                finite(&named!(servo; kp, kd)).map_err(ScenarioError::in_table("input"))?;
                check_signal("[input] pulse_servo.command_rad", &servo.command_rad)?;
                self.validate_loop()
            }
        }
    }

    fn validate_loop(&self) -> Result<(), ScenarioError> {
        let step_s = self.setup.timing.step_s;
        let steps = self.dt_s / step_s;
        if (steps - steps.round()).abs() > 1e-6 || steps.round() < 1.0 {
            return Err(ScenarioError::Key(format!(
                "dt_s = {} must be a whole number of [timing] step_s = {step_s} for a pulse_servo",
                self.dt_s
            )));
        }
        let plain = self.start.crank_rad.is_none() && self.start.crank_rate_rad_s == 0.0;
        if !plain || self.options != Options::default() || self.loads != Loads::default() {
            return Err(ScenarioError::Key(
                "a pulse_servo starts at zero rudder with its crank at rest, and takes no [loads] \
                 and no [options]"
                    .into(),
            ));
        }
        Ok(())
    }
}

/// Refuses a signal that cannot be evaluated.
fn check_signal(key: &'static str, signal: &Signal) -> Result<(), ScenarioError> {
    let refuse = |problem| Err(ScenarioError::Key(format!("{key}: {problem}")));
    signal.problem().map_or(Ok(()), refuse)
}
