//! Tests from the page: as `tvc test`, with a STOP that ends them at any moment.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use client::{Parameter, Request, StateKind, Wire, request};
use serde_json::{Value, json};

use super::handle::{Answer, Condition, Handle, Recording};
use super::model::{Model, Test};
use crate::logs::log::{Flight, Log};
use crate::logs::report::{self, sweep};
use crate::vehicle::test::{
    ARM_PATIENCE, ARM_RETRY, ARMED, Manoeuvre, SET_PERIOD, SET_POINT, SETTLE, is_worth_waiting,
};

/// Time between two looks at the vehicle's state.
const LOOK: Duration = Duration::from_millis(20);

/// A test under way.
struct Flown<'a> {
    manoeuvre: Manoeuvre,
    vehicle: &'a Handle,
    model: &'a Model,
    stop: &'static AtomicBool,
    log: String,
}

/// Arms, releases, disarms, and leaves the figures in `model`.
pub fn run(manoeuvre: Manoeuvre, vehicle: &Handle, model: &Model, stop: &'static AtomicBool) {
    let recording = vehicle.record(Recording::Test(manoeuvre.name())).wait();
    let mut flown = Flown {
        manoeuvre,
        vehicle,
        model,
        stop,
        log: String::new(),
    };
    let result = recording.and_then(|path| {
        flown.log = path.display().to_string();
        let before = flown.set_point()?;
        let swings = matches!(manoeuvre, Manoeuvre::Chirp { .. });
        if swings {
            // Should this program end before the test does.
            model.lock().put_back = Some(set_to(before));
        }
        let done = flown.fly(before);
        // Disarm whatever happened: the rudder goes to neutral.
        let disarmed = vehicle.order(request::DISARM, Condition::default()).wait();
        if swings {
            flown.set(before, Condition::default()).wait()?;
            model.lock().put_back = None;
        }
        let ended = vehicle.end_recording().wait();
        done.and(disarmed).and(ended)?;
        figures(manoeuvre, &path)
    });
    let (stage, result) = match result {
        Ok(result) => (String::new(), result),
        Err(error) => (format!("{error:#}"), Value::Null),
    };
    flown.show(false, &stage, result);
}

impl Flown<'_> {
    /// The set point before the test, deg.
    fn set_point(&self) -> Result<f32> {
        let state = self.model.lock();
        let found = state.parameters().iter().find(|row| row.is(SET_POINT));
        let known = found.context("the vehicle's set point is not known yet")?;
        Ok(known.row.value)
    }

    fn fly(&self, set_point: f32) -> Result<()> {
        self.stage("hold the drone still");
        let order = |order| self.vehicle.order(order, self.condition()).wait();
        order(request::CALIBRATE)?;
        let begun = Instant::now();
        while let Err(refusal) = order(request::ARM) {
            if begun.elapsed() > ARM_PATIENCE
                || self.stop.load(Ordering::SeqCst)
                || !is_worth_waiting(&refusal)
            {
                return Err(refusal);
            }
            self.stage(&format!("hold the drone still: {refusal}"));
            std::thread::sleep(ARM_RETRY);
        }
        self.watch(ARMED, LOOK, |_| {})?;
        order(request::RELEASE)?;
        self.stage("released");
        match self.manoeuvre {
            Manoeuvre::Step { seconds } | Manoeuvre::Hold { seconds } => {
                self.watch(Duration::from_secs_f64(seconds), LOOK, |_| {})
            }
            Manoeuvre::Chirp { seconds, amplitude } => self.chirp(set_point, seconds, amplitude),
        }
    }

    /// Swings the set point.
    fn chirp(&self, set_point: f32, seconds: f64, amplitude: f64) -> Result<()> {
        self.watch(SETTLE, LOOK, |_| {})?;
        self.stage("the set point swings");
        let mut wire = Wire::default();
        self.watch(Duration::from_secs_f64(seconds), SET_PERIOD, |time| {
            let phase = sweep::phase(time.as_secs_f64(), seconds);
            let set = f64::from(set_point) + amplitude * phase.sin();
            // No answer is waited for, and none repeated: the next one follows.
            let message = request::set_parameter(SET_POINT, set as f32);
            self.vehicle.send(&wire.frame(&message));
        })
    }

    fn set(&self, value: f32, condition: Condition) -> Answer<()> {
        self.vehicle.request(Request::Set(set_to(value)), condition)
    }

    /// Not after a STOP.
    fn condition(&self) -> Condition {
        Condition {
            until: None,
            unless: Some(self.stop),
        }
    }

    /// Looks at the vehicle for a while, and calls `each` with the time since the start.
    fn watch(
        &self,
        length: Duration,
        look: Duration,
        mut each: impl FnMut(Duration),
    ) -> Result<()> {
        let begun = Instant::now();
        while begun.elapsed() < length {
            std::thread::sleep(look);
            if self.stop.load(Ordering::SeqCst) {
                bail!("stopped by the operator");
            }
            let state = self.model.lock();
            let status = state.status();
            if !status.connected {
                bail!("{}", status.problem);
            }
            if status.flight == Some(StateKind::Failsafe) {
                bail!("the vehicle gave up: {}", status.reason);
            }
            drop(state);
            each(begun.elapsed());
        }
        Ok(())
    }

    fn stage(&self, stage: &str) {
        self.show(true, stage, Value::Null);
    }

    fn show(&self, running: bool, stage: &str, result: Value) {
        self.model.lock().set_test(Test {
            manoeuvre: self.manoeuvre.name(),
            running,
            stage: stage.to_owned(),
            log: self.log.clone(),
            result,
        });
    }
}

fn set_to(value: f32) -> Parameter {
    let name = SET_POINT.to_owned();
    Parameter { name, value }
}

/// The figures of the log's release, and what was missed.
fn figures(manoeuvre: Manoeuvre, path: &Path) -> Result<Value> {
    let flight = Flight::of(&Log::read(path)?);
    let figures = report::figures(&flight);
    let object = json!(figures);
    let releases = report::releases(&flight);
    let release = releases.first().context("the log holds no release")?;
    let sweep = sweep::Sweep::of(release);
    if let Manoeuvre::Chirp { .. } = manoeuvre {
        ensure!(sweep.is_some(), "the log holds no swing of the set point");
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
