//! `tvc record`: everything that passes, into a telemetry log.

use std::time::{Duration, Instant};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use rig::request;

use crate::cli::Record;
use crate::failure::Verdict;
use crate::link::Vehicle;
use crate::log::{Flight, Log, Writer, write_csv};
use crate::stop;

/// Records until Ctrl-C.
pub fn run(options: &Record) -> Result<Verdict> {
    let stop = stop::on_signal()?;
    let log = Writer::create(&options.log)?;
    let mut vehicle = Vehicle::connect(&options.port)?;
    vehicle.link().log_to(log);
    vehicle.parameters()?;
    if let Err(refusal) = vehicle.command("calibrate", request::CALIBRATE) {
        eprintln!(
            "the log begins in mid-flight, a replay cannot be compared bit for bit: {refusal}"
        );
    }
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} recording {elapsed}  {msg}") {
        bar.set_style(style);
    }
    let begun = Instant::now();
    let longest = options.seconds.map(Duration::from_secs_f64);
    let mut gone = None;
    while !stop::asked(stop, begun, longest) {
        if let Err(error) = vehicle.receive() {
            // What has been recorded is worth keeping.
            gone = Some(error);
            break;
        }
        let counts = vehicle.link().counts();
        bar.set_message(format!(
            "{} messages, {} lost",
            counts.messages, counts.lost
        ));
        bar.tick();
    }
    bar.finish_and_clear();
    vehicle.link().end_log()?;
    let flight = Flight::of(&Log::read(&options.log)?);
    eprintln!(
        "wrote {}: {} control steps, {} samples missed, {} frames lost",
        options.log.display(),
        flight.steps().count(),
        flight.missed(),
        flight.lost()
    );
    if let Some(path) = &options.csv {
        write_csv(&flight, path)?;
        eprintln!("wrote {}", path.display());
    }
    gone.map_or(Ok(Verdict::Met), Err)
}
