//! Options of `tvc model`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use plant::Parameters;
use rig::ServoKind;

use crate::vehicle::VehicleChoice;
use flights::arguments::parameter;
use report::arguments::{number, numbers};
use report::kind;

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
    /// Make the model linear: poles, zeros, ranks, and the margins of the whole loop.
    Linear(Linear),
    /// How much gain and delay a rocket's loop bears along its burn.
    Margins(Margins),
    /// Fly a log's release again on the model, as it was and with something changed.
    WhatIf(WhatIf),
}

/// Options of `tvc model simulate`.
#[derive(Debug, Args)]
#[command(after_help = SIMULATE_HELP)]
pub struct Simulate {
    /// The scenario, a TOML file (see below).
    pub scenario: PathBuf,

    /// Where to write the trajectory [default: standard output, unless --json is given].
    #[arg(long, value_name = "FILE.csv", value_parser = kind::table)]
    pub out: Option<PathBuf>,

    /// Interval of the rows, in s, in place of the scenario's dt_s.
    #[arg(long, value_name = "S", value_parser = interval)]
    pub dt: Option<f64>,

    /// Print one JSON object about the run on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Options of `tvc model linear`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc model linear                              the recommended drone, upright at zero rudder
  tvc model linear --preset THESIS_TEXT --at 0.2   where 0.2 rad of crank hold the drone
  tvc model linear --servo digital --gains 1.6,0.35 --json
  tvc model linear --vehicle identified.toml    a file with [drone], [servo] and [timing]

The state is (theta0, w0, theta1, w1): pitch, its rate, crank, its rate; the input is the servo's
torque on the crank in N m, the output the pitch. The loop is cut at the crank command; its margins
count the sensor's delay, the rate's filter, half a control period, the hold of the servo frame, the
pulse and the servo's lag. Deadband, backlash and the speed limit have no linear part.
Exit status: 0 done, 1 something failed, 2 unusable input.")]
pub struct Linear {
    /// The drone: drone, or a FILE.toml.
    #[arg(long, default_value = "drone")]
    pub vehicle: VehicleChoice,

    /// Its masses and lengths: PHYS, THESIS_TABLE or THESIS_TEXT [default: PHYS].
    #[arg(long, value_name = "P", conflicts_with = "vehicle", value_parser = preset)]
    pub preset: Option<Box<Parameters>>,

    /// Servo and frame, in place of the file's.
    #[arg(long, value_enum)]
    pub servo: Option<ServoKind>,

    /// Gains in rad of servo per rad of pitch and per rad/s of pitch rate [default: the servo's].
    #[arg(long, value_name = "KP,KD", allow_negative_numbers = true, value_parser = gains)]
    pub gains: Option<(f64, f64)>,

    /// Crank angle to take the model at, in rad, with the pitch at which the drone rests there (or
    /// upright, if its weight cannot hold it) [default: zero rudder, upright, no torque].
    #[arg(long, value_name = "THETA1", allow_negative_numbers = true)]
    pub at: Option<f64>,

    /// Pitch to take the model at, in rad, with the crank angle that holds the drone there.
    #[arg(long, value_name = "THETA0", allow_negative_numbers = true, conflicts_with = "at")]
    pub pitch: Option<f64>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Where to write the HTML report.
    #[arg(long, value_name = "FILE.html", default_value = "report/linear.html", value_parser = kind::page)]
    pub report: PathBuf,
}

/// Options of `tvc model margins`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc model margins                                 Spica, stable and unstable
  tvc model margins --dispersed 500                 and rockets that are not as their image was told
  tvc model margins --vehicle vehicles/spica.toml --json

At ten times of the burn the rocket is kicked in calm air, and followed for 7 s. The gain is changed
by up to 20 dB, or up to 1.2 s of delay are added, until the oscillation keeps half of the kick.
Required are 6 dB and 30 deg, and 4 dB and 20 deg of 99 % of dispersed rockets.
Exit status: 0 all margins are kept, 1 one is not, 2 unusable input.")]
pub struct Margins {
    /// The rocket: rocket, or a FILE.toml.
    #[arg(long, default_value = "rocket")]
    pub vehicle: VehicleChoice,

    /// Also this number of rockets that differ from their figures.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub dispersed: Option<u32>,

    /// Seed of the first of them.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Options of `tvc model what-if`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc model what-if step.tlog --param SFC_GAIN_S=0.4  the release with another gain
  tvc model what-if step.tlog --vehicle drone.toml    on the drone that `tvc identify` found
  tvc model what-if evening.tlog --release 3 --param PITCH_SET_DEG=2 --json

The model starts with the pitch that the log has, and leaves the hand when the log's drone does; the
image's control law, with the log's parameters, flies it. The motion answers to what is changed,
unlike that of `tvc replay`. How far the model is from the log with nothing changed says how far the
rest may be believed.
Exit status: 0 done, 1 something failed, 2 unusable input.")]
pub struct WhatIf {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// The release, counted from 1 [default: the only one].
    #[arg(long, value_name = "N")]
    pub release: Option<usize>,

    /// Fly it with another value of a parameter; may be given more than once.
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = parameter)]
    pub parameters: Vec<(String, f32)>,

    /// The drone: drone, or a FILE.toml such as `tvc identify` writes.
    #[arg(long, default_value = "drone")]
    pub vehicle: VehicleChoice,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Where to write the HTML report.
    #[arg(long, value_name = "FILE.html", default_value = "report/what-if.html", value_parser = kind::page)]
    pub report: PathBuf,
}

fn preset(name: &str) -> Result<Box<Parameters>, String> {
    let known = || "the presets are PHYS, THESIS_TABLE, THESIS_TEXT".into();
    Parameters::preset(name).map(Box::new).ok_or_else(known)
}

fn gains(text: &str) -> Result<(f64, f64), String> {
    numbers(
        text,
        [f64::MIN..=f64::MAX, f64::MIN..=f64::MAX],
        "gains are two numbers, such as 1.0,0.3",
    )
}

fn interval(text: &str) -> Result<f64, String> {
    const WHAT: &str = "an interval is a number of seconds above zero, such as 0.005";
    number(text, f64::MIN_POSITIVE..=f64::MAX, WHAT)
}

const SIMULATE_HELP: &str = "\
The file that is written has the columns t,theta0,theta1,theta2,theta3,w0,w1,w2,w3: time in s;
pitch of the drone, crank, link and rudder in rad; their rates in rad/s. Angles and rates 1 to 3
are relative to body 0. Rows stand every dt from t = 0; numbers are written so that they are read
back exactly.

A scenario in full (only `seconds` must be there; docs/explanation/model.md explains every key):

  seconds = 5.0                  # length of the run
  dt_s = 0.005                   # interval of the rows; --dt takes precedence

  [drone]                        # parameters of the four bodies
  preset = \"PHYS\"                # PHYS, THESIS_TABLE or THESIS_TEXT, then any override:
  body_mass_kg = 2.75            # numbers in the unit of the key's ending,
  crank_length_m = \"20 mm\"       # or a text with another unit of the same kind
  gravity_m_s2 = 0.0             # gravity off
  thrust_n = 0.0                 # propellers off

  [servo]                        # for pulse_servo: preset S3003, S3003_5V or DIGITAL, overrides
  [timing]                       # for pulse_servo: preset ANALOGUE, DIGITAL, NANO_50HZ or
                                 # NANO_300HZ (the firmware's), overrides

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

Over time, a value is a number, a table or a sine. A table has [time in s, value] with times that
increase, straight between points (an angle: smooth). { points = [[...]], between = \"hold\" } says
hold, straight or smooth. A sine is { offset = 0, amplitude = 0.1, period_s = 2, phase_rad = 0 }.

Examples:
  tvc model simulate scenarios/pd_ideal_servo.toml --out pd.csv
  tvc model simulate scenarios/constraint_sweep.toml --out sweep.csv --dt 0.001
  tvc model simulate scenarios/gravity_only_pendulum.toml --json

Exit status: 0 written, 1 the motion could not be followed to its end, 2 unusable input.";
