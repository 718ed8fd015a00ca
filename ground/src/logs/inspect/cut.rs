//! `tvc log cut`: a part of a log as a new one.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, bail};
use client::request::text_of;
use client::wire::SYSTEM_AT;
use client::{Wire, text};
use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use serde_json::json;

use super::Cut;
use super::info::releases;
use crate::cli::TOOL;
use flights::log::{self, Frames, Log, Writer};
use report::exit::{BadInput, Verdict};
use report::file::print_json_if;

/// How much before and after a release is written with it, s.
const AROUND_S: f64 = 2.0;
/// Index of the sequence number in a frame.
const SEQUENCE_AT: usize = 4;

/// Writes the part that `options` ask for.
///
/// # Errors
/// [`BadInput`] if there is no such log, release or time in it.
pub fn run(options: &Cut, json: bool) -> Result<Verdict> {
    let bytes = log::tlog(&options.log)?;
    let log = Log::of(&bytes, &options.log)?;
    let (from_s, to_s) = range(options, &log)?;
    let is_inside = |time_us| (from_s..=to_s).contains(&log.time_s(time_us));
    let frames: Vec<(u64, &[u8])> = Frames::of(&bytes).filter(|frame| is_inside(frame.0)).collect();
    let Some((begin_us, _)) = frames.first() else {
        let length_s = log.length_s();
        bail!(BadInput::new(format!(
            "there is nothing from {from_s} s to {to_s} s: {} has {length_s:.1} s",
            options.log.display()
        )));
    };
    write(&options.file, &known(&bytes, *begin_us, &frames), &frames, json)
}

/// Writes frames as a new log, at whose beginning stands what was known before, and says how many
/// they are.
///
/// # Errors
/// The log cannot be written.
pub fn write(
    path: &Path,
    known: &[Vec<u8>],
    frames: &[(u64, &[u8])],
    json: bool,
) -> Result<Verdict> {
    let begin_us = frames.first().map_or(0, |frame| frame.0);
    let known = known.iter().map(|frame| (begin_us, frame.as_slice()));
    let mut writer = Writer::whole(path, TOOL)?;
    for (time_us, frame) in known.chain(frames.iter().copied()) {
        writer.write_at(time_us, frame)?;
    }
    writer.end()?;
    let (messages, seconds) = (frames.len(), Log::read(path)?.length_s());
    print_json_if(json, &json!({ "messages": messages, "seconds": seconds }))?;
    eprintln!("wrote {}: {messages} messages, {seconds:.1} s", path.display());
    Ok(Verdict::Met)
}

/// Beginning and end of the part, s.
fn range(options: &Cut, log: &Log) -> Result<(f64, f64)> {
    let Some(number) = options.release else {
        return match (options.from, options.to) {
            (None, None) => {
                bail!(BadInput::new("no part is named: give --from, --to or --release"))
            }
            (Some(from_s), Some(to_s)) if from_s >= to_s => {
                bail!(BadInput::new("--from must be before --to"))
            }
            (from_s, to_s) => Ok((from_s.unwrap_or(0.0), to_s.unwrap_or(log.length_s()))),
        };
    };
    let releases = releases(log);
    let release = number.checked_sub(1).and_then(|index| releases.get(index));
    let release = release.ok_or_else(|| {
        let count = releases.len();
        BadInput::new(format!(
            "there is no release {number}: {} has {count}, as `tvc log info` counts them",
            options.log.display()
        ))
    })?;
    Ok((release.begin_s - AROUND_S, release.end_s + AROUND_S))
}

/// Frames with what was told before a part and still holds in it: the tool that kept the log, the
/// vehicle's build, its parameters and its state. Those of the vehicle have the sequence numbers
/// before that of the part's first one, so that no message counts as lost.
pub fn known(bytes: &[u8], begin_us: u64, part: &[(u64, &[u8])]) -> Vec<Vec<u8>> {
    let mut tool = None;
    let mut told: BTreeMap<(u8, String), MavMessage> = BTreeMap::new();
    let before = Frames::of(bytes).take_while(|(time_us, frame)| {
        let is_first = part.first().is_some_and(|first| std::ptr::eq(first.1, *frame));
        *time_us <= begin_us && !is_first
    });
    for (_, frame) in before {
        for received in Wire::default().receive_frames(frame) {
            let message = received.message;
            let key = match &message {
                _ if !log::is_from_vehicle(frame) => {
                    let is_tool = text_of(&message).is_some_and(|words| words.starts_with("tvc "));
                    if is_tool {
                        tool.get_or_insert_with(|| frame.to_vec());
                    }
                    continue;
                }
                MavMessage::AUTOPILOT_VERSION(_) => (0, String::new()),
                MavMessage::PARAM_VALUE(row) => (1, text(&row.param_id).to_owned()),
                MavMessage::HEARTBEAT(_) => (2, String::new()),
                _ => continue,
            };
            told.insert(key, message);
        }
    }
    let next = part.iter().map(|part| part.1).find(|frame| log::is_from_vehicle(frame));
    let (system_id, next) = next.map_or((1, 0), |frame| (frame[SYSTEM_AT], frame[SEQUENCE_AT]));
    let first = next.wrapping_sub(told.len() as u8);
    let numbered = told.into_values().enumerate().map(|(index, message)| {
        let mut raw = MAVLinkV2MessageRaw::new();
        let header = MavHeader {
            system_id: system_id.into(),
            component_id: tvc_nano::config::COMPONENT_ID,
            sequence: first.wrapping_add(index as u8),
        };
        raw.serialize_message(header, &message);
        raw.raw_bytes().to_vec()
    });
    tool.into_iter().chain(numbered).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{self, flight};
    use super::*;

    fn cut(log: &Path, file: &Path, from: Option<f64>, release: Option<usize>) -> Result<Log> {
        let options = Cut {
            log: log.to_owned(),
            file: file.to_owned(),
            from,
            to: from.map(|from| from + 2.0),
            release,
        };
        run(&options, false)?;
        Log::read(file)
    }

    #[test]
    fn a_part_knows_what_was_known_and_nothing_counts_as_lost() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        tests::write(&flight(), &path("a.tlog"));
        for name in ["b.tlog", "b.mcap"] {
            let part = cut(&path("a.tlog"), &path(name), Some(3.5), None).unwrap();
            assert_eq!((part.counts.lost, part.counts.stray_bytes), (0, 0));
            assert!((part.length_s() - 1.0).abs() < 1e-9, "{}", part.length_s());
            let flight = log::Flight::of(&part);
            assert_eq!(flight.parameters().pid_kp(), 1.5);
            assert_eq!(flight.steps().count(), 2);
            // Active from its beginning to its end.
            assert_eq!(releases(&part).len(), 1);
            assert!(cut(&path("a.tlog"), &path(name), Some(1.0), None).is_err(), "kept");
        }
        let release = cut(&path("a.tlog"), &path("r.tlog"), None, Some(1)).unwrap();
        assert!((release.length_s() - 7.0).abs() < 1e-9, "{}", release.length_s());
    }

    #[test]
    fn what_is_not_in_the_log_is_refused_and_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        tests::write(&flight(), &path("a.tlog"));
        for (from, release, part) in [
            (Some(20.0), None, "has 9.0 s"),
            (None, Some(3), "has 2"),
            (None, Some(0), "no release 0"),
        ] {
            let refused = cut(&path("a.tlog"), &path("b.tlog"), from, release);
            let said = refused.unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
            assert!(!path("b.tlog").exists());
        }
    }
}
