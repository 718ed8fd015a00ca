//! What can be said to `tvc monitor`, `tvc record` and `tvc forward`.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::Port;
use super::link::seconds;

/// Options of `tvc monitor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc monitor                        attitude, servo, state, losses, live; Ctrl-C ends it
  cargo tvc monitor --json | jq .state     one JSON object a line
  cargo tvc monitor --seconds 10 --log f.tlog    and keep everything

Exit status: 0 ended, 1 the vehicle went away or something failed, 2 unusable input.")]
pub struct Monitor {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: Port,

    /// Print JSON objects on standard output, one a line, and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Time between two lines [default: 0.1 on a terminal, else 1].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub every: Option<f64>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,

    /// Keep every frame in a new telemetry log (.tlog, .mcap).
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
}

/// Options of `tvc record`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc record flight.tlog             until Ctrl-C; opens in MAVProxy, QGroundControl, pymavlink
  cargo tvc record flight.mcap             opens in Foxglove and PlotJuggler; `tvc convert` makes one of the other
  cargo tvc record flight.tlog --csv flight.csv --seconds 60
  cargo tvc report flight.tlog             what came of it

At its beginning the parameters are asked for and, unless the vehicle is armed, its estimate begins
anew (hold it still for three seconds), so that `tvc replay` reproduces the flight bit for bit.
Exit status: 0 ended, 1 the vehicle went away or something failed, 2 unusable input.")]
pub struct Record {
    /// The log to write (.tlog, .mcap); it must not be there yet.
    #[arg(value_name = "FILE")]
    pub log: PathBuf,

    /// Where the vehicle is.
    #[command(flatten)]
    pub port: Port,

    /// Write the control steps as a table, too, when the recording ends.
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}

/// Options of `tvc forward`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc forward                        QGroundControl and PlotJuggler on this computer find it
  cargo tvc forward --to 192.168.1.20:14550    a ground station elsewhere
  cargo tvc forward --log flight.tlog      and keep every frame, both ways

What comes back from the ground station goes to the vehicle.
Exit status: 0 ended, 1 the vehicle went away or something failed, 2 unusable input.")]
pub struct Forward {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: Port,

    /// Where MAVLink goes, by UDP.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:14550")]
    pub to: SocketAddr,

    /// Where JSON for PlotJuggler goes, by UDP.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:9870")]
    pub plot: SocketAddr,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,

    /// Keep every frame, both ways, in a new telemetry log (.tlog, .mcap).
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
}
