//! The step test from the page: as `tvc test step`, with a STOP that ends it at any moment.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rig::request::{self, Order};
use serde_json::{Value, json};

use super::shared::{Shared, Trial};
use super::station::{Answer, Station, What};
use super::{logs, shared::State};
use crate::logs::log::{Flight, Log, Step};
use crate::logs::replay::parameters;
use crate::logs::report;
use crate::vehicle::test::{ARM_PATIENCE, ARM_RETRY, is_worth_waiting};

/// Length after the release.
const LENGTH: Duration = Duration::from_secs(3);
/// Between two looks at the vehicle's state.
const LOOK: Duration = Duration::from_millis(20);
/// Points of a trace that the page draws.
const POINTS: usize = 300;

/// Arms, releases, disarms, and leaves the figures in `shared`.
pub fn run(station: &Station, shared: &Shared, folder: &Path, stop: &Arc<AtomicBool>) {
    let (writer, path) = match logs::create(folder, "step") {
        Ok(log) => log,
        Err(error) => return end(shared, "", &Err(format!("{error:#}"))),
    };
    let log = path.display().to_string();
    stage(shared, &log, "hold the drone still");
    let flown = station
        .ask(What::Record(writer, path.clone()))
        .and_then(|()| fly(station, shared, &log, stop));
    // Whatever happened: the rudder to neutral.
    let disarmed = station.ask(What::Order("disarm", request::DISARM));
    let ended = station.ask(What::EndRecord);
    let result = flown.and(disarmed).and(ended).and_then(|()| figures(&path));
    end(shared, &log, &result);
}

fn fly(station: &Station, shared: &Shared, log: &str, stop: &Arc<AtomicBool>) -> Answer {
    let order = |name, order: Order| station.ask(What::Unless(stop.clone(), name, order));
    order("calibrate", request::CALIBRATE)?;
    let begun = Instant::now();
    while let Err(refusal) = order("arm", request::ARM) {
        if begun.elapsed() > ARM_PATIENCE
            || stop.load(Ordering::SeqCst)
            || !is_worth_waiting(&refusal)
        {
            return Err(refusal);
        }
        stage(shared, log, &format!("hold the drone still: {refusal}"));
        std::thread::sleep(ARM_RETRY);
    }
    order("release", request::RELEASE)?;
    stage(shared, log, "released");
    let begun = Instant::now();
    while begun.elapsed() < LENGTH {
        std::thread::sleep(LOOK);
        if stop.load(Ordering::SeqCst) {
            return Err("stopped by the operator".into());
        }
        let state = shared.lock();
        let condition = state.condition();
        if !condition.connected {
            return Err(condition.problem.clone());
        }
        if condition.state == "failsafe" {
            return Err(format!("the vehicle gave up: {}", condition.reason));
        }
    }
    Ok(())
}

fn stage(shared: &Shared, log: &str, stage: &str) {
    shared.lock().set_trial(Trial {
        running: true,
        stage: stage.to_owned(),
        log: log.to_owned(),
        result: Value::Null,
    });
}

fn end(shared: &Shared, log: &str, result: &Result<Value, String>) {
    let state: &mut State = &mut shared.lock();
    state.set_trial(Trial {
        running: false,
        stage: result.as_ref().err().cloned().unwrap_or_default(),
        log: log.to_owned(),
        result: result.as_ref().cloned().unwrap_or_default(),
    });
}

/// The figures of the log's release, its trace to draw, and what was missed.
fn figures(path: &Path) -> Result<Value, String> {
    let log = Log::read(path).map_err(|error| format!("{error:#}"))?;
    let flight = Flight::of(&log);
    let params = parameters(&flight);
    let figures = report::figures(&flight);
    let servo = report::servo_map(&params);
    let trace: Vec<[f64; 3]> = report::releases(&flight)
        .first()
        .map_or(Vec::new(), |release| {
            let pitch = release.trace(Step::pitch_rad);
            let rudder = release.trace(|step| servo.angle_rad(step.pulse_us));
            let every = pitch.len().div_ceil(POINTS).max(1);
            let both = pitch.iter().zip(&rudder).step_by(every);
            both.map(|((time, pitch), (_, rudder))| {
                [*time, pitch.to_degrees(), rudder.to_degrees()]
            })
            .collect()
        });
    let object = json!(figures);
    Ok(json!({
        "run": object["runs"][0],
        "loop": object["loop"],
        "telemetry": object["telemetry"],
        "missed": figures.missed(),
        "trace": trace,
    }))
}
