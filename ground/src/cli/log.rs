//! What can be said to `tvc replay`, `tvc report` and `tvc convert`.

use std::path::PathBuf;

use clap::Args;
use tvc_nano::Params;

use super::FilterName;

/// Options of `tvc replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc replay flight.tlog                 the firmware's library on the log's counts, bit for bit
  cargo tvc replay flight.tlog --param PID_KD=0.2    what other gains would have commanded
  cargo tvc replay flight.tlog --filter madgwick     another filter's pitch beside the firmware's
  cargo tvc replay flight.tlog --csv both.csv        both runs as a table, side by side

The motion is the log's: it does not answer to what is changed.
Exit status: 0 equal wherever it can be compared, 1 a difference or nothing to compare, 2 unusable input.")]
pub struct Replay {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// Run with another value of a parameter; may be given more than once.
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = parameter)]
    pub parameters: Vec<(String, f32)>,

    /// Run another filter beside.
    #[arg(long, value_enum)]
    pub filter: Option<FilterName>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Write both runs as a table, side by side; `tvc convert` writes the log's own steps.
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,

    /// Write an HTML page with both runs.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
}

/// Options of `tvc report`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc report flight.tlog                 writes flight.html, prints the figures
  cargo tvc report flight.tlog --out step.html
  cargo tvc report flight.tlog --json          figures for a script

Exit status: 0 every requirement met, 1 one missed or something failed, 2 unusable input.")]
pub struct Report {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// Where to write the page [default: the log's name with .html].
    #[arg(long, value_name = "FILE.html")]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Options of `tvc convert`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc convert flight.tlog flight.mcap    for Foxglove and PlotJuggler
  cargo tvc convert flight.mcap flight.tlog    for MAVProxy, QGroundControl, pymavlink
  cargo tvc convert flight.tlog flight.csv     the control steps as a table

A .tlog and an .mcap hold the same frames; a table cannot be made a log again.
Exit status: 0 written, 1 something failed, 2 unusable input.")]
pub struct Convert {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// The file to write (.tlog, .mcap, .csv); a log must not be there yet.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
}

fn parameter(text: &str) -> Result<(String, f32), String> {
    let (name, value) = text
        .split_once('=')
        .ok_or("a parameter is NAME=VALUE, such as PID_KP=1.2")?;
    let value = value.parse().map_err(|_| format!("{value} is no number"))?;
    Params::default()
        .set(name, value)
        .map_err(|error| format!("{name}: {error}"))?;
    Ok((name.to_owned(), value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_known_and_in_range() {
        assert_eq!(parameter("PID_KD=0.2"), Ok(("PID_KD".into(), 0.2)));
        for bad in ["PID_KD", "PID_KD=", "PID_KD=9", "PID_KQ=1"] {
            assert!(parameter(bad).is_err(), "{bad}");
        }
    }
}
