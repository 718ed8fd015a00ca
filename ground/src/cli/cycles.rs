//! What can be said to `tvc cycles`.

use clap::{Args, ValueEnum};

/// Options of `tvc cycles`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc cycles                         every filter, beside the crates of the field
  cargo tvc cycles --filter mahony         those with mahony in their name only: quicker
  cargo tvc cycles --library tvc-fusion    this project's own only
  cargo tvc cycles --markdown              the table for a README
  cargo tvc cycles --json > cycles.json    figures for a script, nothing else on standard output

What is measured, on an emulated Cortex-M0+ at exact instruction timing, of one update from a sample
in memory to an orientation in memory:
  mean       over a recording of real sensors with a magnetometer sample each time, start-up included
  max        over that and over hard inputs: clipped, free fall, no field, random, gaps in time
  1ws        the same with one flash wait state
  code       flash of the update and all it calls, constants included: an image that holds nothing
             else, less one whose update is empty
  RAM        the filter's state
  stack      depth from the call, measured by painting

Exit status: 0 measured, 1 something failed, 2 unusable input.")]
pub struct Cycles {
    /// Only filters with this in their name; may be given more than once.
    #[arg(long, value_name = "NAME")]
    pub filter: Vec<String>,

    /// Only filters of this library; may be given more than once.
    #[arg(long, value_name = "CRATE")]
    pub library: Vec<String>,

    /// What the compiler optimises for, in all images alike.
    #[arg(long, value_enum, default_value_t = Optimise::Speed)]
    pub optimise: Optimise,

    /// Print the table as Markdown.
    #[arg(long, conflicts_with = "json")]
    pub markdown: bool,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// What the compiler optimises for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Optimise {
    /// Opt-level 3.
    Speed,
    /// Opt-level s, as the firmware.
    Size,
}
