//! `tvc log info`: date, builds, length, messages by kind, gaps and releases of a log.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use client::StateKind;
use client::state::{state_name, state_of};
use mavlink::Message;
use mavlink::dialects::common::MavMessage;

use flights::log::{Log, Origin};
use report::exit::Verdict;
use report::measure::{Figure, Figures, data, figure, rows, some};

/// A release until control ended, by the log's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release {
    /// Its beginning, s since the log's first message.
    pub begin_s: f64,
    /// Its end.
    pub end_s: f64,
    /// The state that it ended in; `None` if the log ended before.
    ended_in: Option<u32>,
}

/// Prints what is in a log.
pub fn run(path: &Path, json: bool) -> Result<Verdict> {
    let log = Log::read(path)?;
    figures(&log).conclude(json, None)
}

/// What is in a log, as figures.
pub fn figures(log: &Log) -> Figures {
    let count = |key, count: u64, label| figure(key, count).shown(label, "", 0);
    let is_parameter = |message: &MavMessage| matches!(message, MavMessage::PARAM_VALUE(_));
    let parameters = log.entries.iter().filter(|e| is_parameter(&e.message)).count();
    let counts = log.counts;
    Figures::from([
        Origin::of(&log.entries).figures(),
        figure("length_s", log.length_s()).shown("length", "s", 1),
        count("lost", counts.lost, "frames lost"),
        count("damaged", counts.crc_errors, "frames damaged"),
        count("stray_bytes", counts.stray_bytes, "bytes that are no frame"),
        count("parameters", parameters as u64, "values of parameters"),
        rows("releases", releases(log).iter().enumerate().map(release_row)),
        rows("messages", kinds(log)),
        gaps(log),
    ])
}

fn release_row((index, release): (usize, &Release)) -> [Figure; 4] {
    let ended = release.ended_in.map_or("the log's end".into(), state_name);
    [
        figure("release", index as u64 + 1).shown("release", "", 0),
        figure("at_s", release.begin_s).shown("at", "s", 1),
        figure("seconds", release.end_s - release.begin_s).shown("length", "s", 1),
        figure("ended_in", ended).shown("ended in", "", 0),
    ]
}

/// Every kind of message and who sent it.
fn kinds(log: &Log) -> Vec<[Figure; 4]> {
    let mut kinds: BTreeMap<(bool, &str), u64> = BTreeMap::new();
    for entry in &log.entries {
        *kinds.entry((!entry.from_vehicle, entry.message.message_name())).or_default() += 1;
    }
    let length_s = log.length_s();
    let row = |((from_station, name), count): (&(bool, &str), &u64)| {
        let sender = if *from_station { "station" } else { "vehicle" };
        let rate = (length_s > 0.0).then(|| *count as f64 / length_s);
        [
            figure("message", *name).shown("message", "", 0),
            figure("from", sender).shown("from", "", 0),
            figure("count", *count).shown("count", "", 0),
            figure("per_second", rate).shown("a second", "", 1).or("-"),
        ]
    };
    kinds.iter().map(row).collect()
}

/// Where frames of the vehicle are missing: all of them, and some in words.
fn gaps(log: &Log) -> Figure {
    let entries = log.entries.iter();
    let gaps = entries.filter(|entry| entry.from_vehicle && entry.lost_before > 0);
    let gaps: Vec<(f64, u64)> = gaps.map(|e| (log.time_s(e.time_us), e.lost_before)).collect();
    let words = some(gaps.iter().map(|gap| format!("{:.1} s", gap.0)));
    data("gaps", &gaps).said("gaps at", words)
}

/// Every stretch of a log in which control was active; one of less than two steps is none.
pub fn releases(log: &Log) -> Vec<Release> {
    let mut releases = Vec::new();
    let mut begun: Option<(u64, usize)> = None;
    let mut last_us = 0;
    let release = |begin_us, end_us, ended_in| Release {
        begin_s: log.time_s(begin_us),
        end_s: log.time_s(end_us),
        ended_in,
    };
    for entry in log.entries.iter().filter(|entry| entry.from_vehicle) {
        last_us = entry.time_us;
        match &entry.message {
            MavMessage::HEARTBEAT(beat) => {
                let is_active = state_of(beat.custom_mode) == Some(StateKind::Active);
                if is_active {
                    begun.get_or_insert((last_us, 0));
                } else if let Some((begin_us, 2..)) = begun.take() {
                    releases.push(release(begin_us, last_us, Some(beat.custom_mode)));
                }
            }
            MavMessage::SERVO_OUTPUT_RAW(_) => {
                if let Some((_, steps)) = &mut begun {
                    *steps += 1;
                }
            }
            _ => {}
        }
    }
    if let Some((begin_us, 2..)) = begun {
        releases.push(release(begin_us, last_us, None));
    }
    releases
}

#[cfg(test)]
mod tests {
    use super::super::tests::{flight, seconds};
    use super::*;

    #[test]
    fn releases_gaps_and_kinds_are_those_of_the_log() {
        let mut log = flight();
        log.entries[7].lost_before = 3;
        assert!((log.length_s() - 9.0).abs() < 1e-9);
        let found = releases(&log);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!((found[0].begin_s, found[0].end_s), (3.0, 6.0));
        assert_eq!(found[1].ended_in, None);
        let object = serde_json::json!(figures(&log));
        assert_eq!(object["releases"][0]["ended_in"], "standby");
        assert_eq!(object["gaps"][0], serde_json::json!([seconds(&log, 7), 3]));
        let kinds = object["messages"].as_array().unwrap();
        let servo = kinds.iter().find(|row| row["message"] == "SERVO_OUTPUT_RAW");
        assert_eq!(servo.unwrap()["count"], 10);
        assert!(serde_json::json!(figures(&Log::default()))["length_s"] == 0.0);
    }
}
