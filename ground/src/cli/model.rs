//! What can be said to `tvc model`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// The model: physics that can be checked, and what follows from it.
#[derive(Debug, Args)]
pub struct Model {
    /// What to do with it.
    #[command(subcommand)]
    pub command: ModelCommand,
}

/// What can be done with the model.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// Simulate a scenario file and write the trajectory as CSV.
    Simulate(Simulate),
}

/// Options of `tvc model simulate`.
#[derive(Debug, Args)]
#[command(after_help = SIMULATE_HELP)]
pub struct Simulate {
    /// The scenario, a TOML file (see below).
    pub scenario: PathBuf,

    /// Where to write the trajectory [default: standard output, unless --json is given].
    #[arg(long, value_name = "FILE.csv")]
    pub out: Option<PathBuf>,

    /// Interval of the rows, in s, in place of the scenario's dt_s.
    #[arg(long, value_name = "S", value_parser = interval)]
    pub dt: Option<f64>,

    /// Print one JSON object about the run on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

fn interval(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("an interval is a number of seconds above zero, such as 0.005".into()),
    }
}

const SIMULATE_HELP: &str = "\
The file that is written has the columns t,theta0,theta1,theta2,theta3,w0,w1,w2,w3: time in s;
pitch of the drone, crank, link and rudder in rad; their rates in rad/s. Angles and rates 1 to 3
are relative to body 0. Rows stand every dt from t = 0; numbers are written so that they are read
back exactly.

A scenario in full (only `seconds` must be there; docs/model.md explains every key):

  seconds = 5.0                  # length of the run
  dt_s = 0.005                   # interval of the rows; --dt takes precedence

  [drone]                        # parameters of the four bodies
  preset = \"PHYS\"                # PHYS, THESIS_TABLE or THESIS_TEXT, then any override:
  body_mass_kg = 2.75            # numbers in the unit of the key's ending,
  crank_length_m = \"20 mm\"       # or a text with another unit of the same kind
  gravity_m_s2 = 0.0             # gravity off
  thrust_n = 0.0                 # propellers off

  [servo]                        # for pulse_servo: preset S3003, S3003_5V or DIGITAL, overrides
  [timing]                       # for pulse_servo: preset ANALOGUE or DIGITAL, overrides

  [start]                        # all zero if left out; the crank at zero rudder
  pitch_rad = 0.2
  crank_rad = 0.0
  pitch_rate_rad_s = 0.2
  crank_rate_rad_s = 0.0

  [input]                        # one of these; none is a free crank without torque
  torque_n_m = 0.1               # torque on the crank: a number, a table or a sine
  voltage_v = 6.0                # the same through the motor constant
  torque_law = { kp = -2, kd = -0.6, crank_kp = 2, crank_kd = 0.06 }  # torque from the state
  crank_rad = [[0, 0], [1, 0.3]] # prescribed crank (the servo is as strong as it needs to be)
  ideal_servo = { kp = 1, kd = 0.3, stiffness = 900, damping = 60 }   # second order, PD law
  pulse_servo = { kp = 1, kd = 0.3 }   # the servo of [servo], its frames and delays, PD law

  [loads]                        # over time: a number, a table or a sine
  thrust_n = 30.0                # in place of the drone's
  pitch_moment_n_m = 0.0         # an external moment on the drone

  [options]
  hold_pitch = false             # true: the drone does not turn
  crank_stop = { angle_rad = 0.8, stiffness_n_m_rad = 50, damping_n_m_s = 0.02 }

Over time, a value is a number; a table of [time in s, value] with times that increase, straight
between points (an angle: smooth); { points = [[...]], between = \"hold\" }, or straight, or smooth;
or a sine { offset = 0, amplitude = 0.1, period_s = 2, phase_rad = 0 }.

Examples:
  cargo tvc model simulate scenarios/pd_ideal_servo.toml --out pd.csv
  cargo tvc model simulate scenarios/constraint_sweep.toml --out sweep.csv --dt 0.001
  cargo tvc model simulate scenarios/gravity_only_pendulum.toml --json

Exit status: 0 written, 1 the motion could not be followed to its end, 2 unusable input.";
