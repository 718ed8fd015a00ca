//! What can be said to `tvc identify`.

use std::path::PathBuf;

use clap::Args;

use super::ServoChoice;

/// Options of `tvc identify`.
#[derive(Debug, Args)]
#[command(after_help = "\
The log is a table of the free drone's motion from the release on, a release or a chirp, with a head:

  time_s,pitch_rad,rate_rad_s,pulse_us   a pulse by its rising edge; cells may be empty, so that
                                         readings and pulses can have rows of their own
  the columns of `tvc record --csv`      steps of the vehicle: time_us, q_w to q_z,
                                         pitch_rate_rad_s, pulse_us; those in the state active

Standard deviations are of the record's noise, not of what the model leaves out. One that is as
large as before the record was seen says that the record does not show the quantity.

Examples:
  tvc identify release.csv                       estimates with their uncertainty
  tvc identify release.csv --out drone.toml      and as a parameter file
  tvc tune --params drone.toml                   gains for that drone

Exit status: 0 done, 1 no parameters explain the record, 2 unusable input.")]
pub struct Identify {
    /// The recorded run.
    #[arg(value_name = "LOG.csv")]
    pub log: PathBuf,

    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoChoice::S3003)]
    pub servo: ServoChoice,

    /// Nominal drone, servo and timing where they differ from the servo's preset (docs/model.md).
    #[arg(long, value_name = "FILE.toml")]
    pub params: Option<PathBuf>,

    /// Where to write the estimates, as a parameter file.
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}
