//! What can be said to `tvc ports`, `tvc arm` and `tvc disarm`.

use clap::Args;

use super::Port;

/// Options of `tvc ports`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc ports                          every serial port, with what is behind it
  cargo tvc ports --json                   for a script

Exit status: 0 done, 1 something failed, 2 unusable input.")]
pub struct Ports {
    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Options of `tvc arm` and `tvc disarm`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc arm                            standby to armed: the rudder still rests
  cargo tvc disarm                         the rudder to neutral, from any state; acknowledges faults
  cargo tvc disarm --port /dev/ttyACM1     a given port

Exit status: 0 obeyed, 1 refused (with the reason) or failed, 2 unusable input.")]
pub struct Operate {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: Port,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}
