//! Telemetry logs.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use client::Wire;

use super::{Outcome, expect, recordings, usable, with_file};
use flights::log::{self, Flight, Frames, Log, Writer};
use ground::logs::inspect::{cut, info, recover};
use ground::logs::{replay, report};

/// What takes longer than the rest is done with one log in this many.
const SOME: u64 = 8;
/// How a log is called in errors.
const NAME: &str = "input";

/// Passes a log through `tvc log`, the report and the replay, and some logs through the report's
/// page, the table or the other form of a log.
pub fn report(bytes: &[u8], number: u64) -> Outcome {
    let name = Path::new(NAME);
    let found = log::salvaged(bytes);
    let recovered = recover::frames(&found);
    let is_whole = |frame: &[u8]| Wire::frame_length(frame) == Some(frame.len());
    let whole = recovered.iter().all(|(_, frame)| is_whole(frame));
    expect(whole, "what was recovered is no frame")?;
    let Some((bytes, _)) = usable(log::unpacked(bytes.to_vec(), name))? else {
        return Ok(());
    };
    let Some(log) = usable(Log::of(&bytes, name))? else {
        return Ok(());
    };
    let _ = info::figures(&log).text();
    let flight = Flight::of(&log);
    let figures = report::figures(&flight);
    let json = serde_json::to_string(&figures).map_err(|error| error.to_string())?;
    serde_json::from_str::<serde_json::Value>(&json).map_err(|error| error.to_string())?;
    let _ = figures.text();
    if let Some((pairs, _)) = usable(replay::replay(&flight, &BTreeMap::new()))? {
        let steps = flight.steps().count();
        expect(pairs.len() == steps, "the replay has other steps")?;
    }
    match number % (3 * SOME) {
        0 => drop(report::page::render(name, &flight, &figures).map_err(|e| format!("{e:#}"))?),
        8 => with_file(&[], "csv", |path| {
            log::write_csv(&flight, path).map_err(|error| format!("{error:#}"))?;
            recordings::as_table(path)
        })?,
        12 => {
            let read = with_file(&bytes, "tlog", Flight::read);
            let read = read.map_err(|error| format!("{error:#}"))?;
            // Not a number is not itself.
            let text = |flight: &Flight| format!("{:?} {:?}", flight.events, flight.counts);
            let same = text(&read) == text(&flight);
            expect(same, "a log that is read in pieces is another one")?;
        }
        16 => as_mcap(&bytes, &log)?,
        _ => {}
    }
    Ok(())
}

/// Writes the log in its other form, and reads that.
fn as_mcap(bytes: &[u8], log: &Log) -> Outcome {
    let path = with_file(&[], "mcap", |path| path.to_owned());
    let _ = fs::remove_file(&path);
    let written = || -> anyhow::Result<Log> {
        let mut writer = Writer::create(&path, "tvc")?;
        for (time_us, frame) in Frames::of(bytes) {
            writer.write_at(time_us, frame)?;
        }
        writer.end()?;
        Log::read(&path)
    };
    let back = written().map_err(|error| format!("{error:#}"))?;
    let entries = back.entries.len();
    expect(entries == log.entries.len(), "the other form has other messages")
}

/// When a log begins and ends, its releases and its parts, and the samples in it.
pub fn parts(bytes: &[u8], number: u64) -> Outcome {
    let name = Path::new(NAME);
    with_file(bytes, "tlog", log::span_us);
    let Some(log) = usable(Log::of(bytes, name))? else {
        return Ok(());
    };
    let flight = Flight::of(&log);
    for number in [None, Some(1), Some(number as usize % 4)] {
        if let Ok(release) = flight.release(number) {
            let _ = release.axes();
        }
    }
    let _ = info::releases(&log);
    let frames: Vec<_> = Frames::of(bytes).collect();
    let part = &frames[number as usize % (frames.len() + 1)..];
    let begin_us = part.first().map_or(0, |frame| frame.0);
    let whole = |frame: &Vec<u8>| Wire::frame_length(frame) == Some(frame.len());
    let known = cut::known(bytes, begin_us, part);
    expect(known.iter().all(whole), "what stands before a part is no frame")?;
    with_file(bytes, "tlog", recordings::as_table)
}
