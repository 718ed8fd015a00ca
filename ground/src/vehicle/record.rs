//! `tvc record`: every frame, both ways, into a telemetry log; with `--last`, the steps around the
//! last release from the vehicle's own memory.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use client::state::state_of;
use client::{StateKind, request};
use serde_json::json;

use crate::cli::TOOL;
use crate::signals;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::VehicleOptions;
use crate::vehicle::recorder;
use flights::log::{Event, Flight, write_csv, write_flight};
use report::arguments::seconds;
use report::exit::{BadInput, Verdict};
use report::file::print_json_if;
use report::kind;
use report::progress::spinner;

/// Options of `tvc record`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc record flight.tlog             until Ctrl-C; opens in MAVProxy, QGroundControl, pymavlink
  tvc record flight.mcap             opens in Foxglove and PlotJuggler; `tvc log convert` makes one of the other
  tvc record flight.tlog --csv flight.csv --seconds 60
  tvc record release.csv --last      every step around the last release, out of the vehicle's memory
  tvc report flight.tlog             what came of it

At its beginning the parameters are asked for and, unless the vehicle is armed, its estimate begins
anew (hold it still for three seconds), so that `tvc replay` reproduces the flight bit for bit.

The vehicle keeps 20 steps before a release and 170 from it on in its own memory, whatever the link
loses, until it is armed again or loses power. Other ground stations download the same as log 0.
Exit status: 0 ended, 1 the vehicle went away or something failed, 2 unusable input or nothing to fetch.")]
pub struct Record {
    /// The log to write (.tlog, .mcap; with --last also .csv); a log must not be there yet.
    #[arg(value_name = "FILE", value_parser = kind::log_or_table)]
    pub log: PathBuf,

    /// Fetch the steps around the last release from the vehicle's own memory instead.
    #[arg(long, conflicts_with_all = ["csv", "seconds"])]
    pub last: bool,

    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,

    /// Write the control steps as a table, too, when the recording ends.
    #[arg(long, value_name = "FILE.csv", value_parser = kind::table)]
    pub csv: Option<PathBuf>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}

/// Records until Ctrl-C.
///
/// # Errors
/// The log cannot be written, there is no vehicle, or it went away.
pub fn run(options: &Record) -> Result<Verdict> {
    if options.last {
        return fetch(options);
    }
    let name = options.log.to_string_lossy();
    kind::new_log(&name).map_err(|why| BadInput::new(format!("{name}: {why}")))?;
    let stop = signals::on_signal()?;
    let mut vehicle = Vehicle::connect(&options.vehicle.port)?;
    vehicle.keep_log(&options.log)?;
    if let Err(refusal) = vehicle.command(request::CALIBRATE) {
        eprintln!(
            "the log begins in mid-flight, a replay cannot be compared bit for bit: {refusal}"
        );
    }
    let bar = spinner("{spinner} recording {elapsed}  {msg}");
    let begun = vehicle.now();
    let mut gone = None;
    while !signals::asked(stop, vehicle.now() - begun, options.seconds) {
        if let Err(error) = vehicle.receive() {
            // What has been recorded is kept.
            gone = Some(error);
            break;
        }
        let counts = vehicle.link().client().counts();
        bar.set_message(format!("{} messages, {} lost", counts.messages, counts.lost));
        bar.tick();
    }
    bar.finish_and_clear();
    vehicle.link().end_log()?;
    let flight = Flight::read(&options.log)?;
    let (steps, missed, lost) = (flight.steps().count(), flight.missed(), flight.lost());
    let json = json!({ "steps": steps, "missed": missed, "lost": lost });
    print_json_if(options.vehicle.json, &json)?;
    eprintln!(
        "wrote {}: {steps} control steps, {missed} samples missed, {lost} frames lost",
        options.log.display()
    );
    if let Some(path) = &options.csv {
        write_csv(&flight, path)?;
        eprintln!("wrote {}", path.display());
    }
    gone.map_or(Ok(Verdict::Met), Err)
}

/// Downloads the steps around the last release and writes them.
///
/// # Errors
/// No vehicle, no release in its memory, or a file that cannot be written.
fn fetch(options: &Record) -> Result<Verdict> {
    let mut vehicle = Vehicle::connect(&options.vehicle.port)?;
    let bytes = vehicle.recording()?;
    if bytes.is_empty() {
        bail!(BadInput::new(
            "the vehicle holds no release: it keeps one from a second after it until it is armed again or loses power",
        ));
    }
    let flight = recorder::flight(&bytes, vehicle.parameters()?)?;
    write_flight(&flight, &options.log, TOOL)?;
    let (steps, missed) = (flight.steps().count(), flight.missed());
    let before = flight
        .events
        .iter()
        .take_while(|event| !matches!(event, Event::State(code) if state_of(*code) == Some(StateKind::Active)))
        .filter(|event| matches!(event, Event::Step(_)))
        .count();
    let json = json!({ "steps": steps, "before_release": before, "missed": missed });
    print_json_if(options.vehicle.json, &json)?;
    eprintln!(
        "wrote {}: {steps} control steps, {before} of them before the release, {missed} without a sample",
        options.log.display()
    );
    Ok(Verdict::Met)
}
