//! docs/guides/troubleshooting.md at the virtual rig: what its tables say about the rig is done,
//! and leads to the texts of the row.
//!
//! The column *at the rig* has code spans, done in their order: actions of `tvc rig tell`, orders
//! (`arm`, `release`, `disarm`), parameters with a value. `in flight` means released before. The
//! code spans of the first column must be seen then, as a text of the vehicle or a refusal; `N`
//! stands for a number. What cannot be tried here begins with one of [`ELSEWHERE`].

use std::sync::OnceLock;

use client::{StateKind, request};
use rig::action::Action;
use rig::ground_station::{GroundStation, GroundStationError};
use rig::pilot::{Manner, Pilot};
use rig::{Image, Ready, ServoKind, Setup, Ticks, image, prepare};

const PAGE: &str = include_str!("../../../docs/guides/troubleshooting.md");
/// What a row says that this test does not try.
const ELSEWHERE: [&str; 4] = ["not to be had", "as above", "started with", "with the tool"];
/// Time for a row's texts.
const PATIENCE: Ticks = Ticks::from_ms(12_000);
/// Time between two looks, and between two orders to arm.
const LOOK: Ticks = Ticks::from_ms(100);

fn ms(ms: u64) -> Ticks {
    Ticks::from_ms(ms)
}

/// A vehicle in standby.
fn ready() -> Ready {
    static READY: OnceLock<Ready> = OnceLock::new();
    let boot = || {
        let image: Image = image::build(&mut |line| eprintln!("{line}")).unwrap();
        let setup = Setup::with_polarity(ServoKind::S3003, 1);
        let mut ready = prepare(&image, &setup, &mut |_| {}).unwrap();
        // Stored, so that there is something to lose.
        ready.station.order(&mut ready.rig, request::SAVE).unwrap();
        // The save has cost samples, which is told for a second.
        ready.station.run(&mut ready.rig, ms(1500)).unwrap();
        ready
    };
    READY.get_or_init(boot).clone()
}

/// A row of a table whose last column is *at the rig*.
struct Row {
    seen: &'static str,
    at_the_rig: &'static str,
}

fn rows() -> Vec<Row> {
    let mut rows = Vec::new();
    let mut at_the_rig = false;
    for line in PAGE.lines() {
        let Some(cells) = line.strip_prefix("| ") else {
            at_the_rig &= line.starts_with('|');
            continue;
        };
        let cells: Vec<&str> = cells.trim_end_matches(" |").split(" | ").collect();
        let last = cells[cells.len() - 1];
        if last == "at the rig" {
            at_the_rig = true;
        } else if at_the_rig {
            rows.push(Row { seen: cells[0], at_the_rig: last });
        }
    }
    rows
}

fn code_spans(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

/// Someone at the rig who keeps everything that is said.
struct Bench {
    ready: Ready,
    pilot: Pilot,
    said: Vec<String>,
    texts: usize,
}

impl Bench {
    fn new() -> Self {
        let ready = ready();
        let texts = ready.station.received().texts.len();
        Self { pilot: Pilot::new([0.3, 0.0], 0.2, Manner::Steady), said: Vec::new(), texts, ready }
    }

    fn run(&mut self, time: Ticks) {
        let Ready { rig, station, .. } = &mut self.ready;
        station.run(rig, time).unwrap();
        let texts = &station.received().texts[self.texts..];
        self.said.extend(texts.iter().cloned());
        self.texts += texts.len();
    }

    fn order(
        &mut self,
        order: impl Fn(&mut GroundStation, &mut rig::Rig) -> Result<(), GroundStationError>,
    ) -> bool {
        let Ready { rig, station, .. } = &mut self.ready;
        match order(station, rig) {
            Ok(()) => true,
            Err(GroundStationError::Request { failure, .. }) => {
                self.said.push(failure.to_string());
                false
            }
            Err(_) => false,
        }
    }

    fn arm(&mut self) -> bool {
        self.order(|station, rig| station.arm(rig))
    }

    fn fly(&mut self) {
        let end = self.ready.rig.now() + PATIENCE;
        while !self.arm() {
            assert!(self.ready.rig.now() < end, "{:?}", self.said);
            self.run(LOOK);
        }
        assert!(self.order(|station, rig| station.order(rig, request::RELEASE)));
        self.act("clamp open");
        self.run(ms(300));
        assert_eq!(self.ready.station.state(), Some(StateKind::Active));
        self.said.clear();
    }

    fn act(&mut self, action: &str) {
        let action: Action = action.parse().unwrap();
        self.pilot.act(&mut self.ready.rig, &action).unwrap();
    }

    /// Does what a code span says; whether it is the order to arm.
    fn step(&mut self, words: &str) {
        let parts: Vec<&str> = words.split(' ').collect();
        match parts.as_slice() {
            ["arm"] => drop(self.arm()),
            ["release"] => drop(self.order(|station, rig| station.order(rig, request::RELEASE))),
            ["disarm"] => drop(self.order(|station, rig| station.disarm(rig))),
            [name, value] if tvc_nano::Params::index_of(name).is_some() => {
                let value = value.parse().unwrap();
                self.order(|station, rig| station.set_parameter(rig, name, value));
            }
            _ => {
                self.act(words);
                self.run(ms(50));
                while parts[0] == "tilt" && !self.ready.rig.environment.clamp_rests() {
                    self.run(LOOK);
                }
            }
        }
    }

    /// Does the steps, and waits until all that is expected has been said.
    fn follow(&mut self, steps: &[&str], expected: &[&str]) {
        for step in steps {
            self.step(step);
        }
        let end = self.ready.rig.now() + PATIENCE;
        self.run(ms(200));
        while !expected.iter().all(|words| self.has(words)) && self.ready.rig.now() < end {
            self.run(LOOK);
            if steps.last() == Some(&"arm") {
                self.arm();
            }
        }
    }

    fn has(&self, expected: &str) -> bool {
        self.said.iter().any(|said| is_said(said, expected))
    }
}

/// Whether the words are in what was said; `N` stands for a number.
fn is_said(said: &str, expected: &str) -> bool {
    let mut rest = said;
    expected.split(" N ").all(|part| {
        let found = rest.find(part);
        rest = found.map_or("", |at| &rest[at + part.len()..]);
        found.is_some()
    })
}

#[test]
fn every_row_tells_how_to_have_it_and_the_vehicle_says_so() {
    let rows = rows();
    assert!(rows.len() > 30, "{} rows", rows.len());
    let mut failed = Vec::new();
    let mut tried = 0;
    for Row { seen, at_the_rig } in rows {
        if ELSEWHERE.iter().any(|words| at_the_rig.starts_with(words)) {
            continue;
        }
        let expected = code_spans(seen);
        let steps = code_spans(at_the_rig);
        assert!(!steps.is_empty(), "{seen} | {at_the_rig}");
        tried += 1;
        let is_in_flight = at_the_rig.starts_with("in flight");
        let mut said = Vec::new();
        // What notices a fault first, and what one does that comes now and then, depends on the
        // instant.
        let is_seen = [0, 3, 8].into_iter().any(|later| {
            let mut bench = Bench::new();
            if is_in_flight {
                bench.fly();
            }
            bench.run(ms(later));
            bench.follow(&steps, &expected);
            said.extend_from_slice(&bench.said);
            expected.iter().all(|words| bench.has(words))
        });
        if !is_seen {
            said.dedup();
            failed.push(format!("{seen} <- {at_the_rig}: {said:#?}"));
        }
    }
    assert!(tried > 25, "{tried} tried");
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
