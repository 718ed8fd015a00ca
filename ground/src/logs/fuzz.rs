//! Fuzzing: mutated logs, tables and parameter files through everything that reads them. Nothing
//! may panic or grow without bound, and what cannot be used is refused as unusable input.
//!
//! A case is known by its number: the same number is the same case. Frames are changed in their
//! content with the checksum put right, else nothing behind the checksum would ever be tried.

use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use client::Wire;
use mavlink::dialects::common::{MavMessage, V2_EXTENSION_DATA};
use mavlink::{Message, calculate_crc};
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rayon::prelude::*;

use super::inspect::{info, recover, tests};
use super::log::{self, Entry, Flight, Frames, Log, Writer};
use super::{replay, report};
use crate::model::identify;
use crate::out::exit::BadInput;
use crate::param_file;
use crate::vehicle::calibrate::readings;
use tvc_nano::Axis;
use tvc_nano::telemetry::{MEMORY_TYPE, MEMORY_WORDS, PART_WORDS};

/// Cases in the short run: some of every kind.
const SHORT: u64 = 400;
/// Most that the program may have held in memory, MiB.
const MEMORY_MIB: u64 = 600;

/// First byte of a MAVLink 2 frame.
const START: u8 = 0xFD;
/// Bytes of a frame before its payload.
const HEADER: usize = 10;
/// Bytes of the checksum behind it.
const CHECKSUM: usize = 2;

/// What is mutated: a log in three forms, and a parameter file.
struct Seeds {
    tlog: Vec<u8>,
    mcap: Vec<u8>,
    /// The same file without the checksums of its chunks.
    unchecked: Vec<u8>,
    csv: Vec<u8>,
    parameters: Vec<u8>,
}

impl Seeds {
    fn new(folder: &Path) -> Self {
        let path = |name: &str| folder.join(name);
        let flight = with_memory(tests::flight());
        for name in ["seed.tlog", "seed.mcap"] {
            tests::write(&flight, &path(name));
        }
        log::write_csv(&Flight::of(&tests::flight()), &path("seed.csv")).unwrap();
        let read = |name| fs::read(path(name)).unwrap();
        let mcap = read("seed.mcap");
        Self {
            tlog: read("seed.tlog"),
            unchecked: without_sums(&mcap),
            mcap,
            csv: read("seed.csv"),
            parameters: b"# gains\nPID_KP 1.5\n1 1 PID_KD 0.25 9\nSRV_DIR,-1\nNEW = 3\n".to_vec(),
        }
    }
}

/// The log, with the memory of the flight behind each step, in parts.
fn with_memory(log: Log) -> Log {
    let mut entries = Vec::new();
    for entry in log.entries {
        entries.push(entry.clone());
        let MavMessage::SERVO_OUTPUT_RAW(servo) = &entry.message else {
            continue;
        };
        let words = (0..MEMORY_WORDS as u32).map(|word| servo.time_usec.wrapping_add(word));
        let bytes: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
        for (message_type, part) in (MEMORY_TYPE..).zip(bytes.chunks(4 * PART_WORDS)) {
            let mut payload = [0; 249];
            payload[..part.len()].copy_from_slice(part);
            let told = V2_EXTENSION_DATA {
                message_type,
                payload,
                ..V2_EXTENSION_DATA::default()
            };
            entries.push(Entry {
                message: MavMessage::V2_EXTENSION(told),
                ..entry.clone()
            });
        }
    }
    Log {
        entries,
        ..Log::default()
    }
}

/// An MCAP file whose chunks have 0 for their checksum, which means that there is none.
fn without_sums(mcap: &[u8]) -> Vec<u8> {
    const CHUNK: u8 = 6;
    // Before it: opcode and length, two times, and the size.
    const SUM: std::ops::Range<usize> = 33..37;
    let mut bytes = mcap.to_vec();
    let mut at = log::MCAP_MAGIC.len();
    while let Some(head) = bytes.get(at..at + 9) {
        let length = u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
        if head[0] == CHUNK {
            bytes[at..][SUM].fill(0);
        }
        at += 9 + length;
    }
    bytes
}

/// One change of some bytes.
fn mutate(bytes: &mut Vec<u8>, random: &mut StdRng) {
    let at = random.random_range(0..=bytes.len());
    let length = random.random_range(0..=(bytes.len() - at).min(200));
    match random.random_range(0..7) {
        0 if at < bytes.len() => bytes[at] ^= 1 << random.random_range(0..8),
        1 => bytes.truncate(at),
        2 => drop(bytes.drain(at..at + length)),
        3 => {
            let copy = bytes[at..at + length].to_vec();
            let to = random.random_range(0..=bytes.len());
            bytes.splice(to..to, copy);
        }
        4 => random.fill(&mut bytes[at..at + length]),
        5 => bytes[at..at + length].fill(
            *[0x00, 0xFF, 0x7F, b'9', b',', b'\n']
                .choose(random)
                .unwrap(),
        ),
        _ => {
            let word = u64::MAX >> random.random_range(0..64);
            let word = word.to_le_bytes();
            let length = length.min(8);
            bytes[at..at + length].copy_from_slice(&word[..length]);
        }
    }
}

/// Values that break arithmetic.
fn hostile(random: &mut StdRng) -> [u8; 4] {
    let values = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -0.0,
        1e-40,
    ];
    match random.random_range(0..4) {
        0 => values.choose(random).unwrap().to_le_bytes(),
        1 => [0xFF; 4],
        2 => [0; 4],
        _ => random.random(),
    }
}

/// Frames with other content and order, whose checksums are right.
fn reframe(tlog: &[u8], random: &mut StdRng) -> Vec<u8> {
    let frames = Frames::of(tlog).map(|(time, frame)| (time, frame.to_vec()));
    let mut frames: Vec<(u64, Vec<u8>)> = frames.collect();
    for _ in 0..random.random_range(1..12) {
        let at = random.random_range(0..frames.len());
        let other = random.random_range(0..frames.len());
        let (time, frame) = &mut frames[at];
        let payload = HEADER..frame.len() - CHECKSUM;
        match random.random_range(0..9) {
            0 => {
                *time = *[
                    0,
                    1,
                    u64::MAX,
                    u64::MAX / 1000,
                    time.wrapping_add(1 << 40),
                    time.wrapping_sub(1),
                ]
                .choose(random)
                .unwrap()
            }
            1..4 => {
                let end = payload.end - payload.len().min(4);
                let from = random.random_range(payload.start..=end);
                let value = hostile(random);
                let length = (payload.end - from).min(4);
                frame[from..from + length].copy_from_slice(&value[..length]);
            }
            4 => frame[4] = random.random(),
            5 => frame[random.random_range(5..9)] = random.random_range(0..4),
            6 => frames.swap(at, other),
            7 => drop(frames.remove(at)),
            _ => {
                let copy = frames[at].clone();
                frames.insert(other, copy);
            }
        }
        if frames.is_empty() {
            break;
        }
    }
    let mut bytes = Vec::new();
    for (time, mut frame) in frames {
        let end = frame.len() - CHECKSUM;
        let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
        let sum = calculate_crc(&frame[1..end], MavMessage::extra_crc(id));
        frame[end..].copy_from_slice(&sum.to_le_bytes());
        bytes.extend(time.to_be_bytes());
        bytes.extend(frame);
    }
    bytes
}

/// The value, if the input was not refused as unusable (exit status 2). With any other error the
/// case fails.
fn usable<T>(result: anyhow::Result<T>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            assert!(
                error.chain().any(|cause| cause.is::<BadInput>()),
                "{error:#}"
            );
            None
        }
    }
}

/// Passes a log through `tvc log`, the report and the replay, and some logs through the report's
/// page, the table or the other form of a log.
fn read_log(bytes: Vec<u8>, number: u64, folder: &Path) {
    let path = folder.join(format!("{number}.tlog"));
    let found = log::salvaged(&bytes);
    let recovered = recover::frames(&found);
    assert!(recovered.iter().all(|(_, frame)| frame[0] == START));
    let Some((bytes, _)) = usable(log::unpacked(bytes, &path)) else {
        return;
    };
    let Some(log) = usable(Log::of(&bytes, &path)) else {
        return;
    };
    let _ = info::figures(&log).text();
    let flight = Flight::of(&log);
    let figures = report::figures(&flight);
    let json = serde_json::to_string(&figures).unwrap();
    serde_json::from_str::<serde_json::Value>(&json).unwrap();
    let _ = figures.text();
    if let Some((pairs, _)) = usable(replay::replay(&flight, &BTreeMap::new())) {
        assert_eq!(pairs.len(), flight.steps().count());
    }
    match number / 10 % 8 {
        0 => drop(report::page::render(&path, &flight, &figures).unwrap()),
        1 => read_table_of(&flight, number, folder),
        2 => {
            let path = folder.join(format!("{number}.mcap"));
            let mut writer = Writer::create(&path).unwrap();
            for (time_us, frame) in Frames::of(&bytes) {
                writer.write_at(time_us, frame).unwrap();
            }
            writer.end().unwrap();
            let back = Log::read(&path).unwrap();
            assert_eq!(back.entries.len(), log.entries.len());
            fs::remove_file(path).unwrap();
        }
        _ => {}
    }
}

fn read_table_of(flight: &Flight, number: u64, folder: &Path) {
    let path = folder.join(format!("{number}.csv"));
    log::write_csv(flight, &path).unwrap();
    read_table(&path);
    fs::remove_file(path).unwrap();
}

/// Passes a table through everything that reads one.
fn read_table(path: &Path) {
    let record = identify::read(path, None, Axis::Pitch);
    usable(record);
    usable(readings::read(path));
}

fn case(number: u64, seeds: &Seeds, folder: &Path) {
    let mut random = StdRng::seed_from_u64(number);
    let mutated = |bytes: &[u8], random: &mut StdRng| {
        let mut bytes = bytes.to_vec();
        for _ in 0..random.random_range(1..6) {
            mutate(&mut bytes, random);
        }
        bytes
    };
    match number % 10 {
        0..4 => read_log(reframe(&seeds.tlog, &mut random), number, folder),
        4 => read_log(mutated(&seeds.tlog, &mut random), number, folder),
        5 => read_log(mutated(&seeds.mcap, &mut random), number, folder),
        6 => read_log(mutated(&seeds.unchecked, &mut random), number, folder),
        7 => {
            let path = folder.join(format!("mutated-{number}.csv"));
            fs::write(&path, mutated(&seeds.csv, &mut random)).unwrap();
            read_table(&path);
            fs::remove_file(path).unwrap();
        }
        _ => {
            let bytes = mutated(&seeds.parameters, &mut random);
            if let Ok(text) = str::from_utf8(&bytes)
                && let Ok(rows) = param_file::parse(text)
            {
                assert_eq!(
                    param_file::parse(&param_file::text(&rows)).unwrap().len(),
                    rows.len()
                );
            }
        }
    }
}

/// Runs the cases, and names those that have panicked by their numbers.
fn run(count: u64) {
    let folder = tempfile::tempdir().unwrap();
    let seeds = Seeds::new(folder.path());
    let (begun, longest) = (Instant::now(), AtomicU64::new(0));
    let failed: Vec<u64> = (0..count)
        .into_par_iter()
        .filter(|number| {
            let begun = Instant::now();
            let done = catch_unwind(AssertUnwindSafe(|| case(*number, &seeds, folder.path())));
            longest.fetch_max(begun.elapsed().as_micros() as u64, Ordering::Relaxed);
            done.is_err()
        })
        .collect();
    let (seconds, longest) = (
        begun.elapsed().as_secs(),
        Duration::from_micros(longest.into_inner()),
    );
    let memory = resident_mib();
    println!(
        "{count} cases in {seconds} s, the longest {longest:?}, at most {memory:?} MiB in memory"
    );
    assert!(
        failed.is_empty(),
        "{} cases: {:?} ...",
        failed.len(),
        &failed[..failed.len().min(20)]
    );
    assert!(memory.is_none_or(|mib| mib < MEMORY_MIB), "{memory:?} MiB");
}

/// Most that this program has held in memory, MiB, where the system tells.
fn resident_mib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib / 1024)
}

#[test]
fn mutated_files_are_read_or_refused() {
    run(SHORT);
}

/// `FUZZ=1000000 TVC_IMAGE=none cargo test --profile fuzz -p ground --bin tvc -- --ignored
/// --nocapture many_mutated`
#[test]
#[ignore = "takes minutes: for whoever changes what reads files"]
fn many_mutated_files_are_read_or_refused() {
    run(std::env::var("FUZZ").map_or(100_000, |count| count.parse().unwrap()));
}

/// Frames whose content was changed are still whole: otherwise they would be skipped, and what
/// comes behind the checksum would not be tried.
#[test]
fn frames_with_other_content_have_right_checksums() {
    let folder = tempfile::tempdir().unwrap();
    let seeds = Seeds::new(folder.path());
    let mut random = StdRng::seed_from_u64(1);
    let (mut frames, mut whole) = (0, 0);
    for _ in 0..50 {
        for (_, frame) in Frames::of(&reframe(&seeds.tlog, &mut random)) {
            frames += 1;
            whole += Wire::default().receive_frames(frame).len();
        }
    }
    assert!(whole * 10 > frames * 9, "{whole} of {frames}");
    assert_ne!(seeds.mcap, seeds.unchecked);
    fs::write(folder.path().join("unchecked.mcap"), &seeds.unchecked).unwrap();
    assert!(Log::read(&folder.path().join("unchecked.mcap")).is_ok());
}
