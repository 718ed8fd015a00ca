//! `tvc log`: what a log holds, a part of it as a log of its own, and what is left of a broken one.

pub mod cut;
pub mod info;
pub mod recover;

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, Subcommand};

use crate::cli::TOOL;
use flights::log::{self, Content};
use report::arguments::number;
use report::exit::Verdict;
use report::file::print_json_if;
use report::kind;

/// Options of `tvc log`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc log info flight.tlog                        date, builds, length, messages, gaps, releases
  tvc log cut flight.tlog first.tlog --release 1  two seconds before the first release to two after it
  tvc log cut flight.tlog part.mcap --from 10 --to 25
  tvc log recover broken.mcap whole.tlog          what can still be read
  tvc log convert flight.tlog flight.mcap         the same for Foxglove and PlotJuggler

Times are seconds since the log's first message. A log that is there already is not written over.
Exit status: 0 done, 1 something failed, 2 unusable input.")]
pub struct LogCommand {
    /// What to do.
    #[command(subcommand)]
    pub action: Action,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long, global = true)]
    pub json: bool,
}

/// What to do with a log.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Say what a log holds.
    #[command(after_help = "\
Examples:
  tvc log info flight.tlog
  tvc log info flight.mcap --json | jq .releases

Exit status: 0 done, 1 something failed, 2 unusable input.")]
    Info {
        /// A telemetry log (.tlog, .mcap).
        #[arg(value_name = "LOG")]
        log: PathBuf,
    },
    /// Write a part of a log as a new one, which begins with what was known: builds, parameters,
    /// state.
    #[command(after_help = "\
Examples:
  tvc log cut flight.tlog first.tlog --release 1
  tvc log cut flight.tlog part.mcap --from 10 --to 25    seconds since the log's first message

Exit status: 0 written, 1 something failed, 2 unusable input.")]
    Cut(Cut),
    /// Write what can be read of a broken log as a new one.
    #[command(after_help = "\
Examples:
  tvc log recover broken.mcap whole.mcap
  tvc log recover broken.tlog whole.tlog

Every frame whose checksum is right is kept, wherever it stands. A time that cannot be right becomes
that of the frame before.
Exit status: 0 something was recovered, 1 something failed, 2 unusable input.")]
    Recover {
        /// The broken log (.tlog, .mcap).
        #[arg(value_name = "LOG")]
        log: PathBuf,
        /// The log to write (.tlog, .mcap); it must not be there yet.
        #[arg(value_name = "FILE", value_parser = kind::new_log)]
        file: PathBuf,
    },
    /// Write a log in another form: for Foxglove, for QGroundControl, as a table.
    #[command(after_help = "\
Examples:
  tvc log convert flight.tlog flight.mcap    for Foxglove and PlotJuggler
  tvc log convert flight.mcap flight.tlog    for MAVProxy, QGroundControl, pymavlink
  tvc log convert flight.tlog flight.csv     the control steps as a table

A .tlog and an .mcap hold the same frames; a table cannot be made a log again.
Exit status: 0 written, 1 something failed, 2 unusable input.")]
    Convert {
        /// A telemetry log (.tlog, .mcap).
        #[arg(value_name = "LOG")]
        log: PathBuf,
        /// The file to write (.tlog, .mcap, .csv); a log must not be there yet.
        #[arg(value_name = "FILE", value_parser = kind::log_or_table)]
        file: PathBuf,
    },
}

/// Options of `tvc log cut`.
#[derive(Debug, Args)]
pub struct Cut {
    /// A telemetry log (.tlog, .mcap).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// The log to write (.tlog, .mcap); it must not be there yet.
    #[arg(value_name = "FILE", value_parser = kind::new_log)]
    pub file: PathBuf,

    /// Begin here, s [default: the log's beginning].
    #[arg(long, value_name = "S", value_parser = time)]
    pub from: Option<f64>,

    /// End here, s [default: the log's end].
    #[arg(long, value_name = "S", value_parser = time)]
    pub to: Option<f64>,

    /// The release with this number, as `tvc log info` counts them, with two seconds on both sides.
    #[arg(long, value_name = "N", conflicts_with_all = ["from", "to"])]
    pub release: Option<usize>,
}

/// Parses a time in a log, s.
fn time(text: &str) -> Result<f64, String> {
    number(text, 0.0..=1e9, "a time in a log is a number of seconds since its first message")
}

/// Does what `options` ask for.
pub fn run(options: &LogCommand) -> Result<Verdict> {
    match &options.action {
        Action::Info { log } => info::run(log, options.json),
        Action::Cut(cut) => cut::run(cut, options.json),
        Action::Recover { log, file } => recover::run(log, file, options.json),
        Action::Convert { log, file } => convert(log, file, options.json),
    }
}

/// Writes the log in the form that the name of `file` says.
fn convert(log: &Path, file: &Path, json: bool) -> Result<Verdict> {
    let written = log::convert(log, file, TOOL)?;
    print_json_if(json, &written)?;
    let (count, what) = match written {
        Content::Messages(count) => (count, "messages"),
        Content::Steps(count) => (count, "control steps"),
    };
    eprintln!("wrote {}: {count} {what}", file.display());
    Ok(Verdict::Met)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use flights::log::{Entry, Event, Log, Step, Writer};
    use mavlink::{MAVLinkV2MessageRaw, MavHeader};

    /// A second between two steps: standby at 0 s, active from 3 to 6 s and again from 8 s on.
    pub fn flight() -> Log {
        let mut entries = Vec::new();
        let mut tell = |second: u64, event: Event| {
            entries.extend(event.messages().into_iter().map(|message| Entry {
                time_us: 1_764_000_000_000_000 + second * 1_000_000,
                from_vehicle: true,
                message,
                lost_before: 0,
            }));
        };
        tell(0, Event::Parameter("PID_KP".into(), 1.5));
        for second in 0..10 {
            match second {
                0 | 6 => tell(second, Event::State(2)),
                3 | 8 => tell(second, Event::State(4)),
                _ => {}
            }
            tell(
                second,
                Event::Step(Step {
                    now_us: second * 1_000_000 + 5_000,
                    cranks_rad: [Some(0.0), None],
                    ..Step::level(second * 1_000_000)
                }),
            );
        }
        Log { entries, ..Log::default() }
    }

    /// Time of an entry, s since the first one.
    pub(super) fn seconds(log: &Log, index: usize) -> f64 {
        log.time_s(log.entries[index].time_us)
    }

    /// Writes a log with these messages.
    pub fn write(log: &Log, path: &Path) {
        let mut writer = Writer::create(path, TOOL).unwrap();
        for (index, entry) in log.entries.iter().enumerate() {
            let mut raw = MAVLinkV2MessageRaw::new();
            let header = MavHeader { system_id: 1, component_id: 1, sequence: index as u8 };
            raw.serialize_message(header, &entry.message);
            writer.write_at(entry.time_us, raw.raw_bytes()).unwrap();
        }
        writer.end().unwrap();
    }

    #[test]
    fn a_time_is_a_number_of_seconds() {
        assert_eq!(time("2.5"), Ok(2.5));
        for wrong in ["-1", "NaN", "inf", "x", ""] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
    }
}
