//! Tests from the page: as `tvc test`, with a STOP that ends them at any moment.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::{Result, ensure};
use serde_json::{Value, json};

use super::handle::Handle;
use super::model::{Model, Test};
use super::relay;
use crate::logs::report;
use crate::vehicle::link::Vehicle;
use crate::vehicle::test::{Manoeuvre, Stage, fly};
use crate::vehicle::watch::Watched;
use flights::log::Flight;
use tvc_nano::Axis;

/// Arms, releases, disarms, and leaves the figures in `model`.
pub fn run(manoeuvre: Manoeuvre, vehicle: &Handle, model: &Model, stop: &'static AtomicBool) {
    let mut log = String::new();
    let show = |running, log: &str, stage: &str, result| {
        *model.lock().test = Test {
            manoeuvre: manoeuvre.name(),
            running,
            stage: stage.to_owned(),
            log: log.to_owned(),
            result,
        };
    };
    let recording = vehicle.record(Some(manoeuvre.name())).wait();
    let result = recording.and_then(|path| {
        log = path.display().to_string();
        let mut shown = String::new();
        let flown = flown(manoeuvre, vehicle, stop, &mut |stage| {
            let words = words(stage);
            if words != shown {
                show(true, &log, &words, Value::Null);
                shown = words;
            }
        });
        let ended = vehicle.end_recording().wait();
        flown.and(ended)?;
        figures(manoeuvre, &path)
    });
    let (stage, result) = match result {
        Ok(result) => (String::new(), result),
        Err(error) => (format!("{error:#}"), Value::Null),
    };
    show(false, &log, &stage, result);
}

/// Flies the manoeuvre; however it ends, the vehicle is disarmed.
fn flown(
    manoeuvre: Manoeuvre,
    vehicle: &Handle,
    stop: &'static AtomicBool,
    show: &mut dyn FnMut(Stage<'_>),
) -> Result<()> {
    let vehicle = Vehicle::at(relay::link(vehicle.clone()))?;
    let mut vehicle = Watched::new(vehicle);
    vehicle.begin(stop);
    let flown = fly(&mut vehicle, manoeuvre, Axis::Pitch, show);
    vehicle.leave(flown)
}

/// What the page says of a stage. Its time is in the charts.
fn words(stage: Stage<'_>) -> String {
    match stage {
        Stage::Still(Some(refusal)) => format!("{}: {refusal}", stage.words()),
        _ => stage.words().to_owned(),
    }
}

/// The figures of the log's release, and what was missed.
fn figures(manoeuvre: Manoeuvre, path: &Path) -> Result<Value> {
    let flight = Flight::read(path)?;
    let figures = report::figures(&flight);
    let object = json!(figures);
    ensure!(!flight.releases().is_empty(), "the log holds no release");
    let sweep = &object["sweep"][0];
    if let Manoeuvre::Chirp { .. } = manoeuvre {
        ensure!(!sweep.is_null(), "the log holds no swing of the set point");
    }
    Ok(json!({
        "run": object["runs"][0],
        "hold": object["hold"][0],
        "sweep": sweep,
        "loop": object["loop"],
        "telemetry": object["telemetry"],
        "missed": figures.missed(),
    }))
}
