//! What can be said to `tvc web`.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::Port;
use super::link::seconds;

/// Options of `tvc web`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc web --open                     the page of the only Nano that is connected
  cargo tvc web --port ./nano              of the rig that `tvc rig --pty --link ./nano` runs
  cargo tvc web --logs flights             recordings and step tests go to the folder flights

Attitude, strip charts, health, messages, parameters, arm, STOP (Esc), step tests and recordings.
Everything is in the program: no network is needed. When the port goes away the page says so and
waits for it. Exit status: 0 ended, 1 something failed, 2 unusable input.")]
pub struct Web {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: Port,

    /// Where the page is served. Anything but the computer itself lets others on the network in who
    /// have the address with its token.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8650")]
    pub listen: SocketAddr,

    /// Open the page in the browser.
    #[arg(long)]
    pub open: bool,

    /// Folder for recordings; it must exist.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub logs: PathBuf,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}
