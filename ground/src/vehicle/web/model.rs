//! What the vehicle's thread publishes and the pages' tasks send. Everything here is bounded.

pub mod set_up;

use std::collections::{BTreeMap, VecDeque};
use std::mem;
use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Result, ensure};
use client::LinkHealth;
use serde::Serialize;
use serde_json::Value;
use serde_json::value::{RawValue, to_raw_value};
use tvc_nano::Params;
use tvc_nano::params::{Change, Range};

use super::releases::Release;
use crate::vehicle::param::{Row, is_measured};
use set_up::SetUp;

/// Texts that are kept.
const TEXTS: usize = 200;

/// The vehicle's motion: sent fifty times a second.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Motion {
    /// The vehicle's clock at the newest attitude, s.
    pub time_s: f64,
    /// Number of attitudes that have come.
    pub count: u64,
    /// Roll, pitch and yaw, deg.
    pub attitude_deg: [f64; 3],
    /// The first axis.
    #[serde(flatten)]
    pub pitch: AxisMotion,
    /// The second axis; none of a vehicle with one.
    pub roll: Option<AxisMotion>,
    /// Standard deviation of the tilt, deg.
    pub tilt_sd_deg: Option<f64>,
    /// The same of the heading.
    pub heading_sd_deg: Option<f64>,
    /// From the start of the sample to its control step, ms.
    pub latency_ms: f64,
    /// Share of time for which the processor was awake, percent.
    pub load_pct: f64,
    /// The estimate has begun anew and has not settled.
    pub settling: bool,
}

/// What [`Motion`] has of an axis besides its angle.
#[derive(Clone, Debug, Default, Serialize)]
pub struct AxisMotion {
    /// Its rate, deg/s.
    pub rate_deg_s: f64,
    /// Angle commanded of its servo, from the centre, deg.
    pub servo_deg: f64,
    /// Pulse commanded, us.
    pub pulse_us: u16,
    /// Angle to hold, deg.
    pub set_deg: f64,
}

/// The vehicle's status: sent when it changes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct VehicleStatus {
    /// The port's name.
    pub port: String,
    /// The vehicle is heard.
    pub connected: bool,
    /// Why it is not.
    pub problem: String,
    /// The state in words.
    pub state: String,
    /// The vehicle's words about it.
    pub reason: String,
    /// Armed or in control.
    pub armed: bool,
    /// Armed, in control or in failsafe: an order to disarm alone leads back to standby.
    pub in_operation: bool,
    /// Armed, and not yet in control.
    pub can_release: bool,
    /// What is enabled and not healthy.
    pub unhealthy: Vec<String>,
    /// Rates, losses and load.
    #[serde(flatten)]
    pub health: LinkHealth,
    /// Time of a message to the vehicle and back, ms, once measured.
    pub round_trip_ms: Option<f64>,
    /// An order to arm would be obeyed.
    pub can_arm: bool,
    /// Why it would not, as the vehicle says; empty where it would, or where that is unknown.
    pub refusal: String,
    /// The log that is being written.
    pub recording: Option<String>,
    /// Why the last one ended before its time, until the next one begins.
    pub recording_failure: Option<String>,
}

/// A text of the vehicle.
#[derive(Clone, Debug, Serialize)]
pub struct Text {
    /// Number of the text, from 1.
    pub id: u64,
    /// The vehicle's clock, s.
    pub time_s: f64,
    /// MAVLink's severity, 0 emergency to 7 debug.
    pub severity: u8,
    /// Its words.
    pub text: String,
}

/// A parameter as the page's table shows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterRow {
    /// Name, value, unit, meaning.
    #[serde(flatten)]
    pub row: Row,
    /// Least and greatest value, where it has a range.
    pub between: Option<[f32; 2]>,
    /// The values it may take, where they are listed.
    pub choices: Option<Vec<f32>>,
    /// It can change while armed.
    pub live: bool,
    /// The vehicle sets it by itself.
    pub measured: bool,
    /// What it belongs to.
    pub group: String,
    /// Its value in the vehicle's flash, where that is known.
    pub stored: Option<f32>,
}

impl ParameterRow {
    /// A parameter by this tool's own table, and what is stored of it.
    pub fn of(row: Row, stored: Option<f32>) -> Self {
        let info = Params::info(&row.name);
        let (between, choices) = match info.map(|info| &info.range) {
            Some(Range::Between(low, high)) => (Some([*low, *high]), None),
            Some(Range::OneOf(choices)) => (None, Some(choices.to_vec())),
            None => (None, None),
        };
        Self {
            between,
            choices,
            live: info.is_none_or(|info| info.change == Change::Live),
            measured: is_measured(&row.name),
            group: row.group(),
            stored,
            row,
        }
    }

    /// Lets a value through that the parameter can have.
    ///
    /// # Errors
    /// The value is out of range or no number.
    pub fn admit(&self, value: f32) -> Result<()> {
        let Row { name, range, .. } = &self.row;
        let is_allowed = Params::info(name).is_none_or(|info| info.range.contains(value));
        ensure!(value.is_finite() && is_allowed, "{name} must be {range}");
        Ok(())
    }
}

/// A test: under way, or its result.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Test {
    /// What is flown: `step`, `hold` or `chirp`.
    pub manoeuvre: &'static str,
    /// It is under way.
    pub running: bool,
    /// What it does now, or why it failed.
    pub stage: String,
    /// Its log.
    pub log: String,
    /// Its figures.
    pub result: Value,
}

impl Test {
    /// The manoeuvre, while it is under way.
    pub fn under_way(&self) -> Option<&'static str> {
        self.running.then_some(self.manoeuvre)
    }
}

/// A part of what the page shows, and how often it may have changed.
#[derive(Debug, Default)]
pub struct Part<T> {
    count: u64,
    value: T,
}

impl<T: Serialize> Part<T> {
    /// The part as JSON, if it is not what was `seen`.
    fn news(&self, seen: &mut u64) -> Option<Box<RawValue>> {
        // Numbered from 1, so that a new page gets everything.
        let count = self.count + 1;
        (mem::replace(seen, count) != count).then(|| json(&self.value))
    }
}

impl<T: PartialEq> Part<T> {
    /// Replaces it by another value; the same one is no news.
    pub fn renew(&mut self, value: T) {
        if self.value != value {
            **self = value;
        }
    }
}

impl<T> Deref for Part<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> DerefMut for Part<T> {
    fn deref_mut(&mut self) -> &mut T {
        self.count += 1;
        &mut self.value
    }
}

/// Everything that the page shows.
#[derive(Debug, Default)]
pub struct State {
    /// The newest motion.
    pub motion: Motion,
    /// The vehicle's status.
    pub status: Part<VehicleStatus>,
    /// The last test.
    pub test: Part<Test>,
    /// The last step of the set-up.
    pub set_up: Part<SetUp>,
    /// The parameters.
    pub parameters: Part<Vec<ParameterRow>>,
    /// The last releases, oldest first.
    pub releases: Part<Vec<Release>>,
    /// How the virtual rig is; null where there is none.
    pub rig: Part<Value>,
    texts: VecDeque<Text>,
    last_text: u64,
}

/// How much of it a page has seen.
#[derive(Debug, Default)]
pub struct Seen {
    status: u64,
    test: u64,
    set_up: u64,
    text: u64,
    parameters: u64,
    releases: u64,
    rig: u64,
}

impl State {
    /// Keeps a text of this program.
    pub fn say(&mut self, severity: u8, text: &str) {
        self.add_text(self.motion.time_s, severity, text.to_owned());
    }

    /// Keeps a text, and drops the oldest beyond the limit.
    pub fn add_text(&mut self, time_s: f64, severity: u8, text: String) {
        self.last_text += 1;
        self.texts.push_back(Text { id: self.last_text, time_s, severity, text });
        if self.texts.len() > TEXTS {
            self.texts.pop_front();
        }
    }

    /// What is new since `seen`, which is brought up to date: time and motion always, texts since
    /// the last update, and each part that has changed, by the names that the page has for them.
    pub fn update(&self, now_ms: u64, seen: &mut Seen) -> Update {
        let last_text = mem::replace(&mut seen.text, self.last_text);
        let texts: Vec<_> = self.texts.iter().filter(|text| text.id > last_text).collect();
        let parts = [
            ("now_ms", Some(json(&now_ms))),
            ("frame", Some(json(&self.motion))),
            ("condition", self.status.news(&mut seen.status)),
            ("trial", self.test.news(&mut seen.test)),
            ("set_up", self.set_up.news(&mut seen.set_up)),
            ("texts", (!texts.is_empty()).then(|| json(&texts))),
            ("parameters", self.parameters.news(&mut seen.parameters)),
            ("releases", self.releases.news(&mut seen.releases)),
            ("rig", self.rig.news(&mut seen.rig)),
        ];
        parts.into_iter().filter_map(|(name, news)| Some((name, news?))).collect()
    }
}

/// What a page has not seen yet.
pub type Update = BTreeMap<&'static str, Box<RawValue>>;

fn json(value: &impl Serialize) -> Box<RawValue> {
    // The parts are structures of names, numbers and texts: they serialise.
    to_raw_value(value).unwrap_or_default()
}

/// [`State`] for several threads.
#[derive(Debug, Default)]
pub struct Model(Mutex<State>);

impl Model {
    /// Locks it for reading or writing, which must be short.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every change is one assignment.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn news(state: &State, seen: &mut Seen) -> Value {
        serde_json::to_value(state.update(0, seen)).unwrap()
    }

    fn names(update: &Value) -> Vec<&String> {
        update.as_object().unwrap().keys().collect()
    }

    #[test]
    fn a_page_gets_everything_once_and_texts_stay_few() {
        let mut state = State::default();
        for count in 0..3 * TEXTS {
            state.add_text(0.0, 6, count.to_string());
        }
        let mut seen = Seen::default();
        let update = news(&state, &mut seen);
        assert_eq!(update["texts"].as_array().unwrap().len(), TEXTS);
        assert_eq!(update["texts"][TEXTS - 1]["text"], (3 * TEXTS - 1).to_string());
        assert!(update["condition"].is_object() && update["trial"].is_object());
        assert!(update["parameters"].is_array());
        assert_eq!(names(&news(&state, &mut seen)), ["frame", "now_ms"]);
        state.add_text(1.0, 4, "new".into());
        *state.status = VehicleStatus::default();
        let update = news(&state, &mut seen);
        assert_eq!(names(&update), ["condition", "frame", "now_ms", "texts"]);
        assert_eq!(update["texts"].as_array().unwrap().len(), 1);
    }
}
