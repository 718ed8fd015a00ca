//! What can be said to `tvc test`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::link::seconds;
use super::{ParamPort, Port};

/// Options of `tvc test`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc test step                      arm, release, three seconds, disarm: the step response
  cargo tvc test step --log step.tlog --report step.html
  cargo tvc test hold --seconds 30         how well it stays upright
  cargo tvc test chirp                     swings the set point faster and faster: bandwidth, delay

Hold the drone still at its start for the first seconds. Ctrl-C disarms at once.
Exit status: 0 every requirement met, 1 one missed, refused or failed, 2 unusable input.")]
pub struct Test {
    /// What to do.
    #[command(subcommand)]
    pub manoeuvre: Manoeuvre,

    /// The port, and the form of the answer.
    #[command(flatten)]
    pub port: ParamPort,

    /// Keep every frame in a new telemetry log.
    #[arg(long, value_name = "FILE", global = true)]
    pub log: Option<PathBuf>,

    /// Write an HTML report.
    #[arg(long, value_name = "FILE.html", global = true)]
    pub report: Option<PathBuf>,
}

impl Test {
    /// As every other command has it.
    pub fn port(&self) -> Port {
        self.port.port()
    }
}

/// What is flown.
#[derive(Debug, Clone, Copy, Subcommand)]
pub enum Manoeuvre {
    /// Release from the tilt at which it is held.
    Step {
        /// Length after the release.
        #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = seconds)]
        seconds: f64,
    },
    /// Release and hold upright.
    Hold {
        /// Length after the release.
        #[arg(long, value_name = "S", default_value_t = 15.0, value_parser = seconds)]
        seconds: f64,
    },
    /// Release and swing the set point through a range of frequencies.
    Chirp {
        /// Length of the sweep.
        #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = seconds)]
        seconds: f64,
        /// Amplitude of the set point, deg.
        #[arg(long, value_name = "DEG", default_value_t = 4.0, value_parser = amplitude)]
        amplitude: f64,
    },
}

fn amplitude(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(deg) if deg > 0.0 && deg <= 15.0 => Ok(deg),
        _ => Err("an amplitude is above 0 and at most 15 deg".into()),
    }
}
