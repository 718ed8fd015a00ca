//! What the host is told and what the rudder does, searched by states.
//!
//! The [`Application`] with its driver, flight, telemetry and store is run as the chip runs it, on
//! a sensor that rests on a body, with a host behind a port. Vehicles that look the same from
//! outside ([`Key`](vehicle::Key)) count as one state, of which the first that was found stands for
//! all.
//!
//! Each search goes on with the events of its subject until nothing new is found, and tries *every*
//! event in every state. Each [promise](promises) is judged on every step. The supervisor alone,
//! whose states are known exactly, is searched in `src/failsafe/tests.rs`.

mod events;
mod promises;
mod table;
mod vehicle;
mod world;

use std::collections::{BTreeMap, VecDeque};
use std::thread;

use super::*;
use crate::application;
use crate::failsafe::{Command, Crash};
use crate::flight::Flight;
use events::Event;
use promises::Exchange;
use vehicle::{Key, Past, Said, Vehicle};

type OfExchange = fn(&Exchange<'_>) -> bool;
type OfState = fn(&Vehicle) -> bool;

const OF_EXCHANGES: [(&str, OfExchange); 6] = [
    ("answered once", promises::is_answered_once),
    ("done if accepted", promises::is_done_if_accepted),
    ("accepted if done", promises::is_accepted_if_done),
    ("told as it is", promises::is_told_as_it_is),
    ("moved by order", promises::is_moved_by_order),
    ("armed checked", promises::is_armed_checked),
];

const OF_STATES: [(&str, OfState); 3] = [
    ("ends by a sensor's reset", promises::ends_by_sensor_reset),
    ("ends by tilt", promises::ends_by_tilt),
    ("ends by silence", promises::ends_by_silence),
];

/// An event happens to a copy of the vehicle; every promise is looked after on the way.
fn undergo(before: &Vehicle, event: &Event) -> Vehicle {
    let mut vehicle = before.clone();
    vehicle.said.clear();
    if let Some(packet) = event.packet() {
        let mut past = vehicle.clone();
        if let Event::Order(ordered) = event {
            past.note(*ordered);
            vehicle.note(*ordered);
        }
        vehicle.receive(packet);
        vehicle.take_note(event);
        let exchange = Exchange { before: &past, event, after: &vehicle, said: &vehicle.said };
        for (name, holds) in OF_EXCHANGES {
            let said = &vehicle.said;
            assert!(
                holds(&exchange),
                "{name}: {event:?} {said:?}\n{}\n{}",
                promises::shown(&past),
                promises::shown(&vehicle)
            );
        }
        let stored = {
            let old = past.stored().0;
            promises::is_stored_as_told(past.storing, old, &vehicle, &vehicle.said)
        };
        assert!(stored, "stored as told: {event:?} {}", promises::shown(&past));
    }
    vehicle.undergo(event, &mut |past: &Past, after: &Vehicle| {
        let shown = || promises::shown(after);
        let neutral = promises::is_neutral_unless_active(after);
        assert!(neutral, "neutral: {event:?} {}", shown());
        let moved = promises::is_moved_by_launch_alone(event, past.state, after);
        assert!(moved, "moved: {event:?} {}", shown());
        if let Some((order, old)) = &past.storing {
            let said = &after.said[past.said..];
            let stored = promises::is_stored_as_told(Some(*order), old, after, said);
            assert!(stored, "stored as told: {event:?} {said:?} {}", shown());
        }
    });
    vehicle
}

/// What a search has found.
struct Found {
    name: &'static str,
    states: BTreeMap<Key, Vehicle>,
    edges: Vec<Edge>,
}

/// What comes of an event, by the codes of the states.
struct Edge {
    from: u32,
    event: Event,
    said: Vec<Said>,
    to: u32,
}

/// From `starts` on by `events`, to the end.
fn search(name: &'static str, starts: Vec<Vehicle>, events: &[Event]) -> Found {
    let mut states = BTreeMap::new();
    let mut open: VecDeque<Vehicle> = VecDeque::new();
    let mut edges = Vec::new();
    for start in starts {
        if states.insert(start.key(), start.clone()).is_none() {
            open.push_back(start);
        }
    }
    let all = Event::all();
    while let Some(vehicle) = open.pop_front() {
        for event in &all {
            let next = undergo(&vehicle, event);
            edges.push(Edge {
                from: vehicle.state().code(),
                event: *event,
                said: next.said.clone(),
                to: next.state().code(),
            });

            if events.contains(event) && states.insert(next.key(), next.clone()).is_none() {
                open.push_back(next);
            }
        }
    }
    Found { name, states, edges }
}

/// A search with every promise kept; every drill in every state.
fn explore(name: &'static str, starts: Vec<Vehicle>, subject: Vec<Event>) -> Found {
    let mut events = Event::common();
    events.extend(subject);
    let found = search(name, starts, &events);
    for vehicle in found.states.values() {
        let shown = || promises::shown(vehicle);
        let answered = promises::is_answered_later(vehicle);
        assert!(answered, "answered later: {}", shown());
        if !promises::may_move(vehicle) {
            continue;
        }
        for (name, holds) in OF_STATES {
            assert!(holds(vehicle), "{name}: {}", shown());
        }
        for drill in &promises::DRILLS {
            let holds = promises::ends_in_time(vehicle, drill);
            assert!(holds, "{}: {}", drill.name, shown());
        }
    }
    found
}

/// All searches, and the table of all that they have found.
#[test]
fn every_promise_is_kept_in_every_state_and_the_table_of_edges_is_the_kept_one() {
    let set_up = || Vehicle::start(Vehicle::set_up(), None);
    let mut spoilt = Vehicle::set_up();
    spoilt.spoil();
    let lost = || Vehicle::start(spoilt.clone(), Some(Crash::BrownOut));
    let new = || Vehicle::start(Mock::new(), None);
    let rocket = [("PID_LAW", 0.0), ("GS_ROWS", 2.0)];
    let rocket = || Vehicle::start(Vehicle::set_up_with(&rocket), None);
    let found = thread::scope(|scope| {
        [
            scope.spawn(|| explore("rudder and host", vec![set_up()], Event::of_rudder())),
            scope.spawn(|| explore("sensor and estimate", vec![set_up()], Event::of_sensor())),
            scope.spawn(|| explore("rocket", vec![rocket()], Event::of_rocket())),
            scope.spawn(|| explore("stored parameters", vec![set_up()], Event::of_storage())),
            scope.spawn(|| {
                explore("link and start", vec![set_up(), lost(), new()], Event::of_link())
            }),
        ]
        .map(|search| search.join().unwrap())
    });
    table::assert_is_kept(&found);
}
