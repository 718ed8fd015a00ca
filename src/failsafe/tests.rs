//! Every state that the [`Supervisor`] can reach, and every event in each of them.
//!
//! The search is on the type itself: a state is a supervisor, and two of them count as one where
//! all that their future depends on is the same ([`Key`]), so that the search ends when there is
//! nothing new. Steps come every 10 ms. Only how far a self-test has come is left out of the key:
//! what it makes of samples is tested in [`crate::self_test`].

use core::cmp::Ordering;
use std::collections::BTreeSet;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use super::*;
use crate::axis::Axis;
use crate::servo::PulseUs;

mod invariants;
mod table;

const TICK_US: u64 = 10_000;

/// What is wrong with an attitude, one thing at a time: the conditions of arming are a conjunction.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Flaw {
    None,
    Invalid,
    Unsettled,
    OffsetUnknown,
    OffsetRefused,
    Uncertain,
}

/// How far the vehicle is tilted.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Tilt {
    Little,
    /// Beyond what is armed, short of what is given up.
    Much,
    Fallen,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    /// A step with a good sample of this age, us.
    Sample(Flaw, Tilt, u64),
    /// A second of samples at rest, which is a self-test.
    Rest,
    /// A second of samples of a vehicle that moves.
    Motion,
    /// A second of samples at rest that are not 1 g.
    Light,
    /// A step without a sample.
    Miss(SensorFault),
    /// Three seconds of samples without a word of the host.
    Silence,
    Heartbeat,
    /// It is so long since the host was heard that one more step makes it silent.
    Waiting,
    RequireHost(bool),
    Calibrate,
    AttitudeLost,
    Order(Command),
}

impl Event {
    fn all() -> Vec<Self> {
        const FLAWS: [Flaw; 6] = [
            Flaw::None,
            Flaw::Invalid,
            Flaw::Unsettled,
            Flaw::OffsetUnknown,
            Flaw::OffsetRefused,
            Flaw::Uncertain,
        ];
        let attitudes = [Tilt::Little, Tilt::Much, Tilt::Fallen]
            .into_iter()
            .flat_map(|tilt| FLAWS.map(|flaw| Event::Sample(flaw, tilt, 0)));
        attitudes
            .chain([
                Event::Sample(Flaw::None, Tilt::Little, 70_000),
                Event::Rest,
                Event::Motion,
                Event::Light,
                Event::Miss(SensorFault::Nak),
                Event::Miss(SensorFault::Reset),
                Event::Silence,
                Event::Heartbeat,
                Event::Waiting,
                Event::RequireHost(true),
                Event::RequireHost(false),
                Event::Calibrate,
                Event::AttitudeLost,
                Event::Order(Command::Arm),
                Event::Order(Command::Release),
                Event::Order(Command::Disarm),
                Event::Order(Command::TestPulse(Axis::Pitch, PulseUs(1600))),
            ])
            .collect()
    }

    /// As the table has it.
    fn name(&self) -> String {
        let sample = |flaw: &Flaw, tilt: &Tilt| match (flaw, tilt) {
            (Flaw::None, Tilt::Little) => "sample".to_string(),
            (Flaw::None, Tilt::Much) => "sample, tilted 55 deg".to_string(),
            (Flaw::None, Tilt::Fallen) => "sample, tilted 65 deg".to_string(),
            (Flaw::Invalid, _) => "sample, attitude invalid".to_string(),
            (Flaw::Unsettled, _) => "sample, attitude settling".to_string(),
            (Flaw::OffsetUnknown, _) => "sample, offset unknown".to_string(),
            (Flaw::OffsetRefused, _) => "sample, offset too large".to_string(),
            (Flaw::Uncertain, _) => "sample, tilt uncertain".to_string(),
        };
        match self {
            Event::Sample(flaw, tilt, 0) => sample(flaw, tilt),
            Event::Sample(..) => "sample, 70 ms old".to_string(),
            Event::Rest => "a second of rest".to_string(),
            Event::Motion => "a second of motion".to_string(),
            Event::Light => "a second at 0.9 g".to_string(),
            Event::Miss(fault) => format!("no sample: {fault}"),
            Event::Silence => "3 s without heartbeat".to_string(),
            Event::Heartbeat => "heartbeat".to_string(),
            Event::Waiting => "heartbeat 2.95 s ago".to_string(),
            Event::RequireHost(required) => format!("FS_HOST {}", u8::from(*required)),
            Event::Calibrate => "calibrate".to_string(),
            Event::AttitudeLost => "estimate starts over".to_string(),
            Event::Order(command) => command.to_string(),
        }
    }
}

fn health(flaw: Flaw, tilt: Tilt) -> Health {
    Health {
        valid: flaw != Flaw::Invalid,
        settled: flaw != Flaw::Unsettled,
        bias: match flaw {
            Flaw::OffsetUnknown => BiasState::Unknown,
            Flaw::OffsetRefused => BiasState::Refused,
            _ => BiasState::Known,
        },
        certain: flaw != Flaw::Uncertain,
        cos_tilt_q30: match tilt {
            Tilt::Little => 1 << 30,
            Tilt::Much => COS_ARM_TILT_Q30 - 1,
            Tilt::Fallen => COS_FAILSAFE_TILT_Q30 - 1,
        },
    }
}

const GOOD: Health = Health {
    valid: true,
    settled: true,
    bias: BiasState::Known,
    certain: true,
    cos_tilt_q30: 1 << 30,
};

/// A supervisor and its clock.
#[derive(Clone, Debug)]
struct Seat {
    supervisor: Supervisor,
    now: Micros,
}

/// All that the future of a [`Seat`] depends on.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    state: u32,
    report: (Option<LatchKind>, bool),
    health: (bool, bool, u8, bool, i32),
    good_run: u8,
    is_lossy: bool,
    /// In steps, up to where it is too old.
    age: Option<u64>,
    is_missing: Option<bool>,
    /// Its silence against the limit, and whether it is asked for.
    host: (Ordering, bool),
    /// In steps.
    over_tilt: Option<u64>,
}

/// What an order was answered; nothing for any other event.
type Reply = Option<Result<(), Refusal>>;

impl Seat {
    fn new(report: BootReport) -> Self {
        Self { supervisor: Supervisor::new(report), now: Micros(10_000_000) }
    }

    fn state(&self) -> State {
        self.supervisor.state()
    }

    fn key(&self) -> Key {
        let Supervisor {
            state,
            report,
            health,
            fresh,
            good_run,
            fault,
            missed: _,
            lost: _,
            lost_at: _,
            host_seen,
            host_required,
        } = &self.supervisor;
        let silence = |seen| self.now.since(seen).cmp(&HOST_SILENCE_US);
        let steps = |since: Micros| (self.now.since(since) / TICK_US).min(20);
        Key {
            state: state.code(),
            report: (report.crash.map(|crash| crash.kind()), report.stored == Loaded::Corrupt),
            health: (
                health.valid,
                health.settled,
                health.bias as u8,
                health.certain,
                health.cos_tilt_q30,
            ),
            good_run: *good_run,
            is_lossy: self.supervisor.keeps_losing(self.now),
            age: fresh.map(steps).map(|age| age.min(7)),
            is_missing: fault.map(|fault| fault.ends_trust()),
            host: (host_seen.map_or(Ordering::Greater, silence), *host_required),
            over_tilt: match state {
                State::Active { over_tilt_since } => over_tilt_since.map(steps),
                _ => None,
            },
        }
    }

    /// A step with a sample, as [`Flight::estimate`](crate::Flight::estimate) takes it.
    fn sample(&mut self, health: Health, age_us: u64) {
        self.sample_of(health, age_us, [0, -981]);
    }

    /// The same with this rate about y and this acceleration along z, counts.
    fn sample_of(&mut self, health: Health, age_us: u64, [rate, acceleration]: [i16; 2]) {
        self.now = self.now.after(TICK_US);
        if self.supervisor.is_testing() {
            self.supervisor.test(&RawSample {
                time: self.now,
                acc: [0, 0, acceleration],
                gyr: [0, rate, 0],
                mag: [1; 3],
            });
        }
        let time = Micros(self.now.0 - age_us);
        self.supervisor.sample(self.now, time, health);
    }

    /// A second of good samples, and a little more.
    fn second(&mut self, counts: [i16; 2]) {
        (0..102).for_each(|_| self.sample_of(GOOD, 0, counts));
    }

    fn miss(&mut self, fault: SensorFault) {
        self.now = self.now.after(TICK_US);
        self.supervisor.miss(self.now, fault);
    }

    fn order(&mut self, command: Command) -> Result<(), Refusal> {
        self.supervisor.command(self.now, command)
    }

    fn undergo(&mut self, event: &Event) -> Reply {
        match *event {
            Event::Sample(flaw, tilt, age_us) => self.sample(health(flaw, tilt), age_us),
            Event::Rest => self.second([0, -981]),
            Event::Motion => self.second([100, -981]),
            Event::Light => self.second([0, -883]),
            Event::Miss(fault) => self.miss(fault),
            Event::Silence => (0..300).for_each(|_| self.sample(GOOD, 0)),
            Event::Heartbeat => self.supervisor.host_heard(self.now),
            Event::Waiting => {
                let seen = &mut self.supervisor.host_seen;
                *seen = seen.map(|seen| seen.min(Micros(self.now.0 - HOST_SILENCE_US)));
            }
            Event::RequireHost(required) => self.supervisor.require_host(required),
            Event::Calibrate => return Some(self.supervisor.restart()),
            Event::AttitudeLost => self.supervisor.attitude_lost(),
            Event::Order(command) => return Some(self.order(command)),
        }
        None
    }
}

/// Everything that a start-up may find.
fn reports() -> Vec<BootReport> {
    let crashes = [
        None,
        Some(Crash::Watchdog),
        Some(Crash::BrownOut),
        Some(Crash::SelfCheck(SelfCheck::Stack)),
        Some(Crash::HardFault { pc: 0 }),
    ];
    let stores = [Loaded::Nothing, Loaded::Corrupt];
    crashes
        .into_iter()
        .flat_map(|crash| stores.map(|stored| BootReport { crash, stored }))
        .collect()
}

/// Every state that can be reached, each handed to `state` once and each of its edges to `edge`.
fn explore(
    mut state: impl FnMut(&Seat),
    mut edge: impl FnMut(&Seat, &Event, &Reply, &Seat),
) -> usize {
    let events = Event::all();
    let mut known = BTreeSet::new();
    let mut open: Vec<Seat> = Vec::new();
    for report in reports() {
        let seat = Seat::new(report);
        known.insert(seat.key());
        open.push(seat);
    }
    while let Some(seat) = open.pop() {
        state(&seat);
        for event in &events {
            let mut next = seat.clone();
            let reply = next.undergo(event);
            edge(&seat, event, &reply, &next);
            if known.insert(next.key()) {
                open.push(next);
            }
        }
    }
    known.len()
}
