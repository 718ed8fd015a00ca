//! What can be said to `tvc tune`.

use std::path::PathBuf;

use clap::Args;

use super::ServoChoice;

/// Options of `tvc tune`.
#[derive(Debug, Args)]
#[command(after_help = "\
The search flies the nonlinear model with the servo's limits and the firmware's timing, from 0.2,
0.4 and 0.8 rad with 0.2 rad/s, at the frame phases and sensor ages that there are, and 90 dispersed
drones besides. Ratios refer to the time-optimal limit: bang-bang with the rudder's rate limited,
without delay and lag, to within 5 % of the start.

Examples:
  tvc tune                                      gains for the analog servo
  tvc tune --servo digital --out digital.param  gains for the digital one, as a parameter file
  tvc tune --params identified.toml --json      gains for a drone that `tvc identify` measured
  tvc param load digital.param                  take them over into a vehicle

Exit status: 0 every requirement met, 1 one missed, 2 unusable input.")]
pub struct Tune {
    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoChoice::S3003)]
    pub servo: ServoChoice,

    /// Drone, servo and timing where they differ from the servo's preset (docs/model.md).
    #[arg(long, value_name = "FILE.toml")]
    pub params: Option<PathBuf>,

    /// Largest overshoot, in percent of the start.
    #[arg(long, value_name = "PCT", default_value_t = 3.0, value_parser = positive)]
    pub overshoot: f64,

    /// Longest 5 % settling, as a multiple of the time-optimal limit [default: 1.7, digital 1.55].
    #[arg(long, value_name = "RATIO", value_parser = positive)]
    pub settling: Option<f64>,

    /// Least phase margin, in deg.
    #[arg(long, value_name = "DEG", default_value_t = 30.0, value_parser = positive)]
    pub margin: f64,

    /// Generations of the search, of 10 candidates each; 0 leaves the analytic start.
    #[arg(long, value_name = "N", default_value_t = 25)]
    pub generations: u32,

    /// Seed of the search and of the dispersed drones.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Where to write the gains: a name and a value a line.
    #[arg(long, value_name = "FILE.param")]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number above zero is needed".into()),
    }
}
