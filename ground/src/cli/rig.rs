//! What can be said to `tvc rig`.

use std::path::PathBuf;

use ::rig::bno055::ImuErrors;
use ::rig::hand::Manner;
use clap::{Args, ValueEnum};

use super::Disturb;
use super::fly::{ServoChoice, start_angle};
use super::link::seconds;

/// Options of `tvc rig`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc rig --pty                            prints the path of the port, runs until Ctrl-C
  cargo tvc rig --pty --link ./nano              and makes ./nano a link to it
  cargo tvc monitor --port ./nano                in a second terminal: every command works there
  cargo tvc test step --port ./nano              arms, releases, prints the figures
  cargo tvc rig --pty --vibration 5,180          with an unbalanced propeller, see --help
  cargo tvc rig --pty --faults scenarios/faults.toml   with faults of the sensor in every flight
  mavproxy.py --master ./nano                    any MAVLink client does
  cargo tvc rig --pty --link ./nano --blank --sensor worst   something to calibrate, with
  cargo tvc calibrate --port ./nano                  in a second terminal

The hand at the rig does with sensor and drone what `tvc calibrate` asks for. The clamp opens when the firmware goes to active and closes when it is disarmed.
Exit status: 0 ended, 1 something failed, 2 unusable input.")]
pub struct Rig {
    /// Put the rig's USB port behind a pseudo-terminal, in real time.
    #[arg(long, required = true)]
    pub pty: bool,

    /// The servo on the rig; the firmware's SRV_RATE_HZ stays at 50 until it is set.
    #[arg(long, value_enum, default_value_t = ServoChoice::S3003)]
    pub servo: ServoChoice,

    /// Seed of all that is random: sensor noise and bias, clock phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Tilt at which the clamp holds the drone, in rad (0 to 0.87).
    #[arg(long, value_name = "RAD", default_value_t = 0.4, allow_negative_numbers = true, value_parser = start_angle)]
    pub tilt: f64,

    /// A Nano fresh from its box: nothing in its flash, polarity unchecked, so that it cannot be armed yet.
    #[arg(long)]
    pub blank: bool,

    /// The sensor on the rig.
    #[arg(long, value_enum, default_value_t = SensorChoice::Typical)]
    pub sensor: SensorChoice,

    /// How well the hand does what `tvc calibrate` asks for.
    #[arg(long, value_enum, default_value_t = HandChoice::Steady)]
    pub hand: HandChoice,

    /// How many times as fast as the clock on the wall (0.1 to 20).
    #[arg(long, value_name = "TIMES", default_value_t = 1.0, value_parser = speed)]
    pub speed: f64,

    /// Lateral offset of the drone's mass, forward, in mm (-30 to 30).
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true, value_parser = offset)]
    pub cm_offset: f64,

    /// A scenario that begins with every release, as for `tvc fly --faults` (docs/faults.md).
    #[arg(long, value_name = "FILE.toml")]
    pub faults: Option<PathBuf>,

    /// What disturbs a flight.
    #[command(flatten)]
    pub disturb: Disturb,

    /// Make this path a symbolic link to the pseudo-terminal, removed at the end.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}

/// A sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SensorChoice {
    /// Noise and a gyroscope's bias of up to 1 deg/s.
    Typical,
    /// The largest errors of a healthy one: 80 mg, 3 deg/s, 40 uT, soft iron with 20 % of skew.
    Worst,
}

impl SensorChoice {
    /// Its errors.
    pub fn errors(self) -> ImuErrors {
        match self {
            Self::Typical => ImuErrors::TYPICAL,
            Self::Worst => ImuErrors::LARGEST,
        }
    }
}

/// A hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum HandChoice {
    /// Does what it is asked.
    Steady,
    /// Never lets go of the sensor.
    Trembling,
    /// Turns the sensor about one axis alone.
    Lazy,
}

impl HandChoice {
    /// Its manner.
    pub fn manner(self) -> Manner {
        match self {
            Self::Steady => Manner::Steady,
            Self::Trembling => Manner::Trembling,
            Self::Lazy => Manner::Lazy,
        }
    }
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(times) if (0.1..=20.0).contains(&times) => Ok(times),
        _ => Err("a speed is 0.1 to 20 times the clock on the wall".into()),
    }
}

fn offset(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(mm) if mm.abs() <= 30.0 => Ok(mm),
        _ => Err("an offset of the mass is -30 to 30 mm".into()),
    }
}
