//! What can be said to `tvc rig`.

use std::path::PathBuf;

use clap::Args;

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
  mavproxy.py --master ./nano                    any MAVLink client does

The clamp opens when the firmware goes to active and closes when it is disarmed.
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
