//! Options of `tvc param`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::vehicle::port::VehicleOptions;
use report::kind;

/// Options of `tvc param`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc param list                     every parameter: value, unit, range, meaning
  tvc param set SFC_GAIN_S 0.5       live, also in flight; out of range is refused
  tvc param reset SFC_GAIN_S SFC_NEAR    these to their defaults; without names, every one
  tvc param reset --stored           every one to what was saved last
  tvc param dump gains.parm          a file that MAVProxy reads
  tvc param dump gains.params        a file that QGroundControl reads
  tvc param diff gains.parm          what differs from a file (without one: from the defaults)
  tvc param load gains.parm          sets what differs

Exit status: 0 done (diff: no difference), 1 something failed (diff: a difference), 2 unusable input.")]
pub struct Param {
    /// What to do.
    #[command(subcommand)]
    pub action: ParamAction,

    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,
}

/// What to do with parameters.
#[derive(Debug, Subcommand)]
pub enum ParamAction {
    /// Show every parameter.
    List,
    /// Show the values of some.
    Get {
        /// Their names.
        #[arg(required = true, value_name = "NAME")]
        names: Vec<String>,
    },
    /// Change one.
    Set {
        /// Its name.
        #[arg(value_name = "NAME")]
        name: String,
        /// Its new value.
        #[arg(value_name = "VALUE", allow_negative_numbers = true)]
        value: f32,
    },
    /// Keep the present values over a loss of power.
    Save,
    /// Go back to the defaults, of some or of all; what is stored stays until the next save.
    Reset {
        /// Their names [default: all].
        #[arg(value_name = "NAME", conflicts_with = "stored")]
        names: Vec<String>,
        /// Go back to what is stored instead.
        #[arg(long)]
        stored: bool,
    },
    /// Show what differs from a file, or from the defaults, without what the vehicle measures by
    /// itself.
    Diff {
        /// The file.
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,
    },
    /// Set every parameter of a file that differs.
    Load {
        /// The file: a name and a value a line, or QGroundControl's form.
        #[arg(value_name = "FILE")]
        file: PathBuf,

        /// Pass over names that the vehicle does not know, such as those of another version.
        #[arg(long)]
        skip_unknown: bool,
    },
    /// Print every name and value, or write them to a file.
    Dump {
        /// The file; `.params` in QGroundControl's form, anything else in MAVProxy's.
        #[arg(value_name = "FILE", value_parser = kind::parameters)]
        file: Option<PathBuf>,
    },
}
