//! Fuzzing: mutated inputs through everything of `tvc` and `lab` that reads a file of unknown
//! origin, frames of a vehicle, or what a program sends it. None may panic, take much more memory
//! than its input is long, or take for ever, and what cannot be used is refused as unusable input.
//!
//! [`readers`] has the table of them, `lab/fuzz_corpus` the stored inputs. A case is a reader
//! and a number: the same two are the same input.

#![allow(unreachable_pub, reason = "nothing of a test is reachable from outside")]

mod complete;
mod corpus;
mod frames;
mod mutate;
mod readers;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use readers::{READERS, Reader};

/// Inputs for each reader in the short run.
const SHORT: u64 = 1500;
/// Time after which an input counts as one that never ends. It says nothing about speed: the
/// machine may be busy with something else.
const ENDLESS: Duration = Duration::from_secs(60);
/// Time between two lines about a run that takes long.
const NEWS: Duration = Duration::from_secs(30);
/// Number of the first stored input.
const STORED: u64 = u64::MAX / 2;
/// Failures of a reader after which the rest is not tried.
const ENOUGH: usize = 20;

/// What a reader did with its inputs.
struct Run {
    reader: &'static Reader,
    stored: Vec<Vec<u8>>,
    done: AtomicU64,
    /// The time that the longest one took, and its number.
    longest: Mutex<(Duration, u64)>,
    /// Most memory beyond the reader's own, as a multiple of the input's length, in thousandths.
    greed: AtomicU64,
    most_bytes: AtomicU64,
    failed: Mutex<Vec<(u64, String)>>,
    failures: AtomicUsize,
    /// What is being read by which thread, and since when.
    under_way: Mutex<BTreeMap<usize, (u64, Instant)>>,
}

impl Run {
    fn new(reader: &'static Reader) -> Self {
        Self {
            reader,
            stored: corpus::stored(reader.corpus),
            done: AtomicU64::new(0),
            longest: Mutex::default(),
            greed: AtomicU64::new(0),
            most_bytes: AtomicU64::new(0),
            failed: Mutex::default(),
            failures: AtomicUsize::new(0),
            under_way: Mutex::default(),
        }
    }

    /// Tries inputs of these numbers.
    fn over(&self, numbers: std::ops::Range<u64>) {
        numbers.into_par_iter().for_each(|number| {
            if self.failures.load(Ordering::Relaxed) < ENOUGH {
                let bytes = mutate::input(number, &self.stored, self.reader.form);
                self.case(number, &bytes);
            }
        });
    }

    /// Tries the stored inputs as they are.
    ///
    /// Their numbers are behind those of all others.
    fn over_stored(&self) {
        for (number, bytes) in (STORED..).zip(&self.stored) {
            self.case(number, bytes);
        }
    }

    fn case(&self, number: u64, bytes: &[u8]) {
        let thread = rayon::current_thread_index().unwrap_or(usize::MAX);
        let begun = Instant::now();
        let mut under_way = self.under_way.lock().unwrap();
        under_way.insert(thread, (number, begun));
        drop(under_way);
        let mut outcome = Ok(());
        let memory = allocation_counter::measure(|| {
            let read = AssertUnwindSafe(|| (self.reader.read)(bytes, number));
            outcome = catch_unwind(read).unwrap_or_else(|_| Err("it panics".into()));
        });
        self.under_way.lock().unwrap().remove(&thread);
        self.done.fetch_add(1, Ordering::Relaxed);
        let took = begun.elapsed();
        let mut longest = self.longest.lock().unwrap();
        *longest = (*longest).max((took, number));
        drop(longest);
        self.most_bytes.fetch_max(memory.bytes_max, Ordering::Relaxed);
        let own = memory.bytes_max.saturating_sub(self.reader.own_bytes);
        let greed = 1000 * own / (bytes.len() as u64).max(1);
        self.greed.fetch_max(greed, Ordering::Relaxed);
        let limit = self.reader.limit(bytes.len());
        let failure = match outcome {
            Err(why) => why,
            Ok(()) if memory.bytes_max > limit => format!(
                "{} bytes of memory for {} of input, above {limit}",
                memory.bytes_max,
                bytes.len()
            ),
            Ok(()) => return,
        };
        self.failures.fetch_add(1, Ordering::Relaxed);
        self.keep(number, bytes);
        self.failed.lock().unwrap().push((number, failure));
    }

    /// Keeps an input that broke something in the folder that `KEEP` names.
    fn keep(&self, number: u64, bytes: &[u8]) {
        if let Ok(folder) = std::env::var("KEEP") {
            let name = format!("{}-{number}", self.reader.name);
            std::fs::write(std::path::Path::new(&folder).join(name), bytes).unwrap();
        }
    }

    /// Ends the program over an input that never ends: nothing else could end that thread.
    fn watch(&self) {
        let under_way = self.under_way.lock().unwrap();
        for (number, since) in under_way.values() {
            if since.elapsed() > ENDLESS {
                self.keep(*number, &mutate::input(*number, &self.stored, self.reader.form));
                eprintln!("{} {number} takes for ever", self.reader.name);
                std::process::abort();
            }
        }
    }

    fn line(&self, begun: Instant) -> String {
        let (done, seconds) = (self.done.load(Ordering::Relaxed), begun.elapsed().as_secs_f64());
        let (longest, number) = *self.longest.lock().unwrap();
        format!(
            "{:<18} {done:>9} inputs in {seconds:6.1} s, {:>7.0} a second; longest {:7.1} ms \
             (number {number}), most {:>5} KiB, {:>6.1} times the input beyond {} KiB",
            self.reader.name,
            done as f64 / seconds.max(1e-9),
            longest.as_secs_f64() * 1e3,
            self.most_bytes.load(Ordering::Relaxed) / 1024,
            self.greed.load(Ordering::Relaxed) as f64 * 1e-3,
            self.reader.own_bytes / 1024,
        )
    }
}

/// Gives a reader its stored inputs and these many others; what went wrong.
fn try_reader(reader: &'static Reader, numbers: std::ops::Range<u64>) -> Vec<String> {
    let run = Run::new(reader);
    let (begun, ended) = (Instant::now(), AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut told = Instant::now();
            while !ended.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(50));
                run.watch();
                if told.elapsed() > NEWS {
                    told = Instant::now();
                    println!("{}", run.line(begun));
                }
            }
        });
        // A panic of the driver itself must end the thread, too.
        let done = catch_unwind(AssertUnwindSafe(|| {
            run.over_stored();
            run.over(numbers);
        }));
        ended.store(true, Ordering::Relaxed);
        done.unwrap();
    });
    println!("{}", run.line(begun));
    let failed = run.failed.into_inner().unwrap();
    let name = reader.name;
    let failed = failed.iter().map(|(number, why)| format!("{name} {number}: {why}"));
    failed.collect()
}

/// Gives every reader, or the one that `READER` names, its inputs.
fn try_all(numbers: &std::ops::Range<u64>) {
    let only = std::env::var("READER").ok();
    let is_wanted = |reader: &&Reader| only.as_ref().is_none_or(|name| name == reader.name);
    let mut wanted = READERS.iter().filter(is_wanted).peekable();
    assert!(wanted.peek().is_some(), "there is no reader {only:?}");
    let failed: Vec<String> =
        wanted.flat_map(|reader| try_reader(reader, numbers.clone())).collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn mutated_inputs_are_read_or_refused() {
    try_all(&(0..SHORT));
}

/// `FUZZ` inputs for each reader from number `FROM` on; `CASE` is one alone. `READER` names one
/// reader, `KEEP` a folder for what breaks something.
#[test]
#[ignore = "takes long: for whoever changes what reads something"]
fn many_mutated_inputs_are_read_or_refused() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse().unwrap());
    let from = number("FROM").unwrap_or(0);
    let numbers = match number("CASE") {
        Some(case) => case..case + 1,
        None => from..from + number("FUZZ").unwrap_or(100_000),
    };
    try_all(&numbers);
}
