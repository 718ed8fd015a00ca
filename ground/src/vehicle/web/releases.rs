//! The last releases, however they were ordered: their figures, and their traces to draw over each
//! other.

use std::mem;

use client::state::state_of;
use client::{Parameter, ServoMap, StateKind};
use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavMessage};
use serde::Serialize;
use serde_json::{Value, json};

use crate::logs::report;
use crate::vehicle::param::is_measured;
use crate::vehicle::watch::FS_HOST;
use flights::log::{Entry, Event, Flight, Log, Step};
use tvc_nano::Axis;

/// Releases that are kept.
const KEPT: usize = 8;
/// Messages of a release that count: some ten seconds.
const MESSAGES: usize = 6000;
/// Points of a trace.
const POINTS: usize = 500;

/// A release, as the page compares it with others.
#[derive(Clone, Debug, Serialize)]
pub struct Release {
    /// Its number, from 1.
    pub number: usize,
    /// The vehicle's clock when it began, s.
    time_s: f64,
    /// The page's test that it belonged to, if to any.
    test: Option<&'static str>,
    /// The log that was being written.
    log: Option<String>,
    /// Pitch to hold when it began, deg.
    set_deg: f64,
    /// Pitch at the release, from the set point, deg.
    start_deg: f64,
    /// Figures of the response, as `tvc report --json` has them; null where the set point moved.
    run: Value,
    /// The vehicle stayed in control until the operator ended it.
    stayed: bool,
    /// Parameters that differ from the release before: name, value then, value now.
    changes: Vec<(String, f32, f32)>,
    /// Time since the release, s, pitch and servo angle, deg.
    trace: Vec<[f64; 3]>,
}

/// What is known beside the vehicle's messages when a release begins.
pub struct Circumstances {
    /// The vehicle's parameters.
    pub parameters: Vec<Parameter>,
    /// The page's test under way.
    pub test: Option<&'static str>,
    /// The log that is being written.
    pub log: Option<String>,
}

/// Collects them.
#[derive(Default)]
pub struct Releases {
    state: Option<StateKind>,
    /// The release under way.
    now: Option<(Vec<Entry>, Circumstances)>,
    count: usize,
    /// The parameters of the last one.
    parameters: Vec<Parameter>,
    last: Vec<Release>,
}

impl Releases {
    /// Takes in a message of the vehicle; the last releases, oldest first, if one is complete now.
    pub fn take(
        &mut self,
        message: &MavMessage,
        circumstances: impl FnOnce() -> Circumstances,
    ) -> Option<&[Release]> {
        let mut complete = false;
        if let Some((entries, _)) = &mut self.now {
            entries.push(entry(message.clone()));
            complete = entries.len() > MESSAGES;
        }
        if let MavMessage::HEARTBEAT(beat) = message
            && beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
        {
            let state = state_of(beat.custom_mode);
            let before = mem::replace(&mut self.state, state);
            if state != Some(StateKind::Active) {
                complete = self.now.is_some();
            } else if before == Some(StateKind::Armed) {
                self.begin(beat, circumstances());
            }
        }
        if !complete {
            return None;
        }
        let (entries, circumstances) = self.now.take()?;
        let release = self.release(entries, circumstances)?;
        self.last.push(release);
        let surplus = self.last.len().saturating_sub(KEPT);
        self.last.drain(..surplus);
        Some(&self.last)
    }

    /// The log of a release begins with the parameters and the state.
    fn begin(&mut self, beat: &HEARTBEAT_DATA, circumstances: Circumstances) {
        let parameters = circumstances.parameters.iter();
        let parameters = parameters.map(|row| Event::Parameter(row.name.clone(), row.value));
        let mut entries: Vec<_> =
            parameters.flat_map(|event| event.messages()).map(entry).collect();
        entries.push(entry(MavMessage::HEARTBEAT(beat.clone())));
        self.now = Some((entries, circumstances));
    }

    fn release(&mut self, entries: Vec<Entry>, circumstances: Circumstances) -> Option<Release> {
        let flight = Flight::of(&Log { entries, ..Log::default() });
        let releases = flight.releases();
        let release = releases.first()?;
        let servo = ServoMap::of(&flight.parameters(), Axis::Pitch);
        let pitch = release.trace(Step::pitch_rad);
        let rudder = release.trace(|step| servo.angle_rad(step.pulses_us[0]));
        let every = pitch.len().div_ceil(POINTS).max(1);
        let both = pitch.iter().zip(&rudder).step_by(every);
        let point = |((time_s, pitch), (_, rudder)): (&(f64, f64), &(f64, f64))| {
            [*time_s, pitch.to_degrees(), rudder.to_degrees()]
        };
        let set_deg = release.set_rad(Axis::Pitch)[0].to_degrees();
        let before = mem::replace(&mut self.parameters, circumstances.parameters);
        self.count += 1;
        Some(Release {
            number: self.count,
            time_s: release.steps[0].time_s(),
            test: circumstances.test,
            log: circumstances.log,
            set_deg,
            start_deg: pitch[0].1.to_degrees() - set_deg,
            // There is none where the set point moved.
            run: json!(report::figures(&flight))["runs"][0].clone(),
            stayed: release.stayed,
            changes: changes(&before, &self.parameters),
            trace: both.map(point).collect(),
        })
    }
}

fn entry(message: MavMessage) -> Entry {
    Entry { time_us: 0, from_vehicle: true, message, lost_before: 0 }
}

/// What an operator has changed.
fn changes(before: &[Parameter], now: &[Parameter]) -> Vec<(String, f32, f32)> {
    let change = |row: &Parameter| {
        let old = before.iter().find(|old| old.name == row.name)?;
        let is_own = is_measured(&row.name) || row.name == FS_HOST;
        (old.value != row.value && !is_own).then(|| (row.name.clone(), old.value, row.value))
    };
    now.iter().filter_map(change).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(state: StateKind) -> MavMessage {
        Event::State(state as u32).messages().remove(0)
    }

    /// A response from 0.3 rad that is over after a second, in steps of 10 ms.
    fn flown(releases: &mut Releases, kp: f32, from: StateKind) -> Option<Vec<Release>> {
        let circumstances = || Circumstances {
            parameters: [("PID_KP", kp), ("CLK_FINE", kp)]
                .map(|(name, value)| Parameter::new(name, value))
                .into(),
            test: None,
            log: None,
        };
        let steps = (0..200_u64).flat_map(|index| {
            let half = 0.15 * (1.0 - index.min(100) as f64 / 100.0);
            let now_us = 1_000_000 + index * 10_000;
            Event::Step(Step {
                quaternion: [half.cos() as f32, 0.0, half.sin() as f32, 0.0],
                ..Step::level(now_us)
            })
            .messages()
        });
        let messages = [state(from), state(StateKind::Active)]
            .into_iter()
            .chain(steps)
            .chain([state(StateKind::Standby)]);
        let mut last = None;
        for message in messages {
            let complete = releases.take(&message, circumstances);
            last = complete.map(<[_]>::to_vec).or(last);
        }
        last
    }

    #[test]
    fn a_release_has_its_figures_its_trace_and_what_was_changed_before_it() {
        let mut releases = Releases::default();
        let first = flown(&mut releases, 1.0, StateKind::Armed).unwrap();
        assert_eq!(first.len(), 1);
        assert!(first[0].changes.is_empty() && first[0].stayed);
        assert!((first[0].start_deg - 17.19).abs() < 0.01, "{first:?}");
        assert_eq!(first[0].trace.len(), 200);
        // The line reaches a tenth at 0.9 s, a twentieth at 0.95 s.
        let figure = |key: &str| first[0].run[key].as_f64().unwrap();
        assert!((figure("rise_s") - 0.9).abs() < 0.01, "{first:?}");
        assert!((figure("settling_5pct_s") - 0.95).abs() < 0.01, "{first:?}");
        let second = flown(&mut releases, 1.5, StateKind::Armed).unwrap();
        assert_eq!(second[1].number, 2);
        assert_eq!(second[1].changes, [("PID_KP".to_owned(), 1.0, 1.5)]);
    }

    #[test]
    fn only_the_last_ones_are_kept_and_what_began_unseen_is_none() {
        let mut releases = Releases::default();
        assert!(flown(&mut releases, 1.0, StateKind::Active).is_none());
        for _ in 0..KEPT + 2 {
            flown(&mut releases, 1.0, StateKind::Armed);
        }
        assert_eq!(releases.last.len(), KEPT);
        assert_eq!(releases.last[0].number, 3);
    }

    #[test]
    fn of_a_long_release_the_beginning_counts_and_once() {
        let mut releases = Releases::default();
        let circumstances = || Circumstances { parameters: Vec::new(), test: None, log: None };
        let mut take = |message: &MavMessage| releases.take(message, circumstances).is_some();
        take(&state(StateKind::Armed));
        take(&state(StateKind::Active));
        let steps = |index: u64| {
            Event::Step(Step {
                sample: None,
                quaternion: [1.0, 0.0, 0.1, 0.0],
                ..Step::level(index * 6_667)
            })
            .messages()
        };
        let messages = (0..2 * MESSAGES as u64).flat_map(steps);
        let complete = messages.filter(&mut take).count();
        assert_eq!(complete, 1);
        assert!(!take(&state(StateKind::Standby)));
    }
}
