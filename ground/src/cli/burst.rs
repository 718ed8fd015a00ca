//! What can be said to `tvc burst`.

use std::path::PathBuf;

use clap::Args;

use super::Port;

/// Options of `tvc burst`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc burst release.csv              every step around the last release as a table
  cargo tvc burst release.tlog             as a log, for `tvc report`, MAVProxy, QGroundControl
  cargo tvc burst release.mcap             for Foxglove and PlotJuggler

The vehicle keeps 30 steps before a release and 170 from it on in its own memory, whatever the link
loses, until it is armed again or loses power. Other ground stations download the same as log 0.
Exit status: 0 written, 1 something failed, 2 unusable input or nothing to fetch.")]
pub struct Burst {
    /// The file to write (.csv, .tlog, .mcap); a log must not be there yet.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Where the vehicle is.
    #[command(flatten)]
    pub port: Port,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}
