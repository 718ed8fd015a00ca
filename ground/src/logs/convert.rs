//! `tvc convert`: a log in another form.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use crate::logs::log::{Content, convert};
use report::exit::Verdict;
use report::file::print_json;
use report::kind;

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
    #[arg(value_name = "FILE", value_parser = kind::log_or_table)]
    pub file: PathBuf,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Writes the file that `options` ask for.
pub fn run(options: &Convert) -> Result<Verdict> {
    let written = convert(&options.log, &options.file)?;
    if options.json {
        print_json(&written)?;
    }
    let (count, what) = match written {
        Content::Messages(count) => (count, "messages"),
        Content::Steps(count) => (count, "control steps"),
    };
    eprintln!("wrote {}: {count} {what}", options.file.display());
    Ok(Verdict::Met)
}
