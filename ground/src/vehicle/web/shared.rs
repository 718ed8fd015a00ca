//! What the vehicle's thread knows and the page's threads tell. Everything here is bounded.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use serde_json::Value;

use crate::vehicle::param::Row;

/// Texts that are kept.
const TEXTS: usize = 200;

/// What moves: sent fifty times a second.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Frame {
    /// The vehicle's clock at the newest attitude, s.
    pub time_s: f64,
    /// Attitudes that have come.
    pub count: u64,
    /// Roll, pitch and yaw, deg.
    pub attitude_deg: [f64; 3],
    /// Pitch rate, deg/s.
    pub rate_deg_s: f64,
    /// Servo angle commanded, from the centre, deg.
    pub servo_deg: f64,
    /// Pulse commanded, us.
    pub pulse_us: u16,
    /// Pitch to hold, deg.
    pub set_deg: f64,
    /// From the start of the sample to its control step, ms.
    pub latency_ms: f64,
    /// Share of time for which the processor was awake, percent.
    pub load_pct: f64,
}

/// What changes now and then.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Condition {
    /// The port's name.
    pub port: String,
    /// The vehicle is heard.
    pub connected: bool,
    /// Why it is not.
    pub problem: String,
    /// Where the flight stands.
    pub state: String,
    /// Why it stands there.
    pub reason: String,
    /// The armed flag.
    pub armed: bool,
    /// What is enabled and not healthy.
    pub unhealthy: Vec<String>,
    /// Attitudes a second, by the vehicle's clock.
    pub attitude_hz: f64,
    /// Frames that arrived whole.
    pub messages: u64,
    /// Frames missing by their sequence numbers.
    pub lost: u64,
    /// Frames with a wrong checksum.
    pub crc_errors: u64,
    /// Frames that the vehicle dropped because nobody took them.
    pub dropped: u16,
    /// Steps without a usable sample since start-up.
    pub missed: u16,
    /// Failed transfers on the sensor's bus.
    pub bus_errors: u16,
    /// To the vehicle and back, ms, once known.
    pub round_trip_ms: Option<f64>,
    /// The log that is being written.
    pub recording: Option<String>,
    /// Changes with the parameters.
    pub parameters: u64,
}

/// Something that the vehicle said.
#[derive(Clone, Debug, Serialize)]
pub struct Text {
    /// Counts up.
    pub id: u64,
    /// The vehicle's clock, s.
    pub time_s: f64,
    /// MAVLink's severity, 0 emergency to 7 debug.
    pub severity: u8,
    /// The words.
    pub text: String,
}

/// A parameter with all that is known of it.
#[derive(Debug, Serialize)]
pub struct Listed {
    /// Name, value, unit, meaning.
    #[serde(flatten)]
    pub row: Row,
    /// Least and greatest value, if it has these.
    pub between: Option<[f32; 2]>,
    /// The values it may take, if they are few.
    pub choices: Option<Vec<f32>>,
    /// It can change while armed.
    pub live: bool,
}

/// How a step test goes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Trial {
    /// It is under way.
    pub running: bool,
    /// What happens, or what went wrong.
    pub stage: String,
    /// Its log.
    pub log: String,
    /// What came of it.
    pub result: Value,
}

/// All of it.
#[derive(Debug, Default)]
pub struct State {
    /// What moves.
    pub frame: Frame,
    /// What changes now and then, and how often it did.
    condition: (u64, Condition),
    trial: (u64, Trial),
    texts: VecDeque<Text>,
    last_text: u64,
    /// The parameters.
    pub parameters: Vec<Listed>,
}

/// What a page has been told.
#[derive(Debug, Default)]
pub struct Told {
    condition: u64,
    trial: u64,
    text: u64,
}

/// What a page has not been told yet.
#[derive(Debug)]
pub struct News {
    /// Always.
    pub frame: Frame,
    /// If it changed.
    pub condition: Option<Condition>,
    /// If it changed.
    pub trial: Option<Trial>,
    /// Since the last news.
    pub texts: Vec<Text>,
}

impl State {
    /// What changes now and then.
    pub fn condition(&self) -> &Condition {
        &self.condition.1
    }

    /// Replaces it.
    pub fn set_condition(&mut self, condition: Condition) {
        self.condition = (self.condition.0 + 1, condition);
    }

    /// The last step test.
    pub fn trial(&self) -> &Trial {
        &self.trial.1
    }

    /// Replaces it.
    pub fn set_trial(&mut self, trial: Trial) {
        self.trial = (self.trial.0 + 1, trial);
    }

    /// Keeps a text; the oldest goes.
    pub fn say(&mut self, time_s: f64, severity: u8, text: String) {
        self.last_text += 1;
        self.texts.push_back(Text {
            id: self.last_text,
            time_s,
            severity,
            text,
        });
        if self.texts.len() > TEXTS {
            self.texts.pop_front();
        }
    }

    /// What is new since `told`.
    pub fn news(&self, told: &mut Told) -> News {
        // Numbered from 1, so that a new page is told everything.
        let condition = (told.condition != self.condition.0 + 1).then(|| self.condition.1.clone());
        let trial = (told.trial != self.trial.0 + 1).then(|| self.trial.1.clone());
        let texts = self.texts.iter().filter(|text| text.id > told.text);
        let texts = texts.cloned().collect();
        *told = Told {
            condition: self.condition.0 + 1,
            trial: self.trial.0 + 1,
            text: self.last_text,
        };
        News {
            frame: self.frame.clone(),
            condition,
            trial,
            texts,
        }
    }
}

/// [`State`] for several threads.
#[derive(Debug, Default)]
pub struct Shared(Mutex<State>);

impl Shared {
    /// Looks at it, or changes it. Keep it short.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing is left half done: every change is one assignment.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_told_everything_once_and_texts_stay_few() {
        let mut state = State::default();
        for count in 0..3 * TEXTS {
            state.say(0.0, 6, count.to_string());
        }
        let mut told = Told::default();
        let news = state.news(&mut told);
        assert_eq!(news.texts.len(), TEXTS);
        assert_eq!(news.texts[TEXTS - 1].text, (3 * TEXTS - 1).to_string());
        assert!(news.condition.is_some() && news.trial.is_some());
        let news = state.news(&mut told);
        assert!(news.texts.is_empty() && news.condition.is_none() && news.trial.is_none());
        state.say(1.0, 4, "new".into());
        state.set_condition(Condition::default());
        let news = state.news(&mut told);
        assert_eq!(news.texts.len(), 1);
        assert!(news.condition.is_some() && news.trial.is_none());
    }
}
