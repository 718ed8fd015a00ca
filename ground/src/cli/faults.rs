//! What can be said to `tvc faults`.

use std::path::PathBuf;

use clap::Args;
use rig::faults::Kind;

/// Options of `tvc faults`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc faults                                    every fault, 50 instants each
  cargo tvc faults --kind sda-stuck --kind spikes     two of them
  cargo tvc faults --runs 5 --json > faults.json      a quick look, for a script

A run is safe if the drone is back on course with control active (recovered), or if the firmware is
in failsafe (neutral); in both cases without a missing or wild pulse, without a reset, and with the
rudder never off neutral for more than 150 ms without sound data. Everything else is unsafe. The
same seed gives the same runs.

Exit status: 0 no unsafe run, 1 at least one or something failed, 2 unusable input.")]
pub struct Faults {
    /// Instants of the flight at which each fault is injected.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,

    /// Only this fault; can be given several times [default: all].
    #[arg(long, value_name = "KIND", num_args = 1..)]
    pub kind: Vec<Kind>,

    /// Seed of all that is random: the sensor, and every run's instant, length and strength.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Runs at a time [default: one for each processor core].
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,

    /// Where to write the HTML report: every run, how it ended and how long it was blind.
    #[arg(long, value_name = "FILE.html", default_value = "report/faults.html")]
    pub report: PathBuf,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}
