//! The step test from the page: as `tvc test step`, with a STOP that ends it at any moment.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};
use client::{StateKind, request};
use serde_json::{Value, json};

use super::handle::{Condition, Handle, Recording};
use super::model::{Model, StepTest};
use crate::logs::log::{Flight, Log};
use crate::logs::report;
use crate::vehicle::test::{ARM_PATIENCE, ARM_RETRY, is_worth_waiting};

/// Length after the release.
const LENGTH: Duration = Duration::from_secs(3);
/// Time between two looks at the vehicle's state.
const LOOK: Duration = Duration::from_millis(20);

/// Arms, releases, disarms, and leaves the figures in `model`.
pub fn run(vehicle: &Handle, model: &Model, stop: &'static AtomicBool) {
    let path = match vehicle.record(Recording::Step).wait() {
        Ok(path) => path,
        Err(error) => return end(model, "", &Err(error)),
    };
    let log = path.display().to_string();
    stage(model, &log, "hold the drone still");
    let flown = fly(vehicle, model, &log, stop);
    // Disarm whatever happened: the rudder goes to neutral.
    let disarmed = vehicle.order(request::DISARM, Condition::default()).wait();
    let ended = vehicle.end_recording().wait();
    let result = flown.and(disarmed).and(ended).and_then(|()| figures(&path));
    end(model, &log, &result);
}

fn fly(vehicle: &Handle, model: &Model, log: &str, stop: &'static AtomicBool) -> Result<()> {
    let condition = Condition {
        until: None,
        unless: Some(stop),
    };
    let order = |order| vehicle.order(order, condition).wait();
    order(request::CALIBRATE)?;
    let begun = Instant::now();
    while let Err(refusal) = order(request::ARM) {
        if begun.elapsed() > ARM_PATIENCE
            || stop.load(Ordering::SeqCst)
            || !is_worth_waiting(&refusal)
        {
            return Err(refusal);
        }
        stage(model, log, &format!("hold the drone still: {refusal}"));
        std::thread::sleep(ARM_RETRY);
    }
    order(request::RELEASE)?;
    stage(model, log, "released");
    let begun = Instant::now();
    while begun.elapsed() < LENGTH {
        std::thread::sleep(LOOK);
        if stop.load(Ordering::SeqCst) {
            bail!("stopped by the operator");
        }
        let state = model.lock();
        let status = state.status();
        if !status.connected {
            bail!("{}", status.problem);
        }
        if status.flight == Some(StateKind::Failsafe) {
            bail!("the vehicle gave up: {}", status.reason);
        }
    }
    Ok(())
}

fn stage(model: &Model, log: &str, stage: &str) {
    model.lock().set_step_test(StepTest {
        running: true,
        stage: stage.to_owned(),
        log: log.to_owned(),
        result: Value::Null,
    });
}

fn end(model: &Model, log: &str, result: &Result<Value>) {
    let problem = |error: &anyhow::Error| format!("{error:#}");
    model.lock().set_step_test(StepTest {
        running: false,
        stage: result.as_ref().err().map(problem).unwrap_or_default(),
        log: log.to_owned(),
        result: result.as_ref().ok().cloned().unwrap_or_default(),
    });
}

/// The figures of the log's release, and what was missed.
fn figures(path: &Path) -> Result<Value> {
    let flight = Flight::of(&Log::read(path)?);
    let figures = report::figures(&flight);
    let object = json!(figures);
    ensure!(object["runs"][0].is_object(), "the log holds no release");
    Ok(json!({
        "run": object["runs"][0],
        "loop": object["loop"],
        "telemetry": object["telemetry"],
        "missed": figures.missed(),
    }))
}
