//! A command that panics, fails or is told to stop, at a vehicle that notes what it is told.

use std::io::{Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::bail;
use client::Wire;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, HEARTBEAT_DATA, MavMessage, MavResult, PARAM_VALUE_DATA,
};
use serialport::{SerialPort, TTYPort};
use tvc_nano::failsafe::{LatchKind, StateCode};

use super::*;
use crate::vehicle::link::Link;
use crate::vehicle::port::Port;

/// A vehicle in standby at the other end of a cable, which obeys everything; at the end it gives
/// what it was told, in turn.
fn vehicle() -> (Watched, JoinHandle<Vec<String>>) {
    vehicle_in(StateCode::Standby, true)
}

/// The same in another state, or one that answers nothing.
fn vehicle_in(state: StateCode, answers: bool) -> (Watched, JoinHandle<Vec<String>>) {
    let is_deaf = !answers;
    let (mut end, port) = TTYPort::pair().unwrap();
    let told = std::thread::spawn(move || {
        let (mut wire, mut told) = (Wire::default(), Vec::new());
        let mut bytes = [0; 1024];
        end.set_timeout(Duration::from_millis(20)).unwrap();
        loop {
            let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                custom_mode: state.number(),
                ..HEARTBEAT_DATA::default()
            });
            let mut answers = vec![beat];
            match end.read(&mut bytes) {
                Err(error) if error.kind() == std::io::ErrorKind::TimedOut => {}
                Ok(count @ 1..) => {
                    for message in wire.receive(&bytes[..count]) {
                        let answer = answer(&message, &mut told);
                        answers.extend(answer.filter(|_| !is_deaf));
                    }
                }
                _ => return told,
            }
            for answer in answers {
                let frame = wire.frame(&answer);
                // The other end may have been closed by now.
                let _ = end.write_all(&frame);
            }
        }
    });
    let link = Link::at(Port::at(Box::new(port), "cable".into()));
    (Watched::new(Vehicle::at(link).unwrap()), told)
}

fn answer(message: &MavMessage, told: &mut Vec<String>) -> Option<MavMessage> {
    let value = |param_id, param_value| {
        Some(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id,
            param_value,
            param_count: 1,
            ..PARAM_VALUE_DATA::default()
        }))
    };
    match message {
        MavMessage::PARAM_REQUEST_READ(read) => value(read.param_id, 0.0),
        MavMessage::PARAM_SET(set) => {
            told.push(format!("{} {}", client::text(&set.param_id), set.param_value));
            value(set.param_id, set.param_value)
        }
        MavMessage::COMMAND_LONG(order) => {
            let orders = [request::ARM, request::RELEASE, request::DISARM];
            let named = orders.iter().find(|known| match known.message() {
                MavMessage::COMMAND_LONG(known) => {
                    (known.command, known.param1) == (order.command, order.param1)
                }
                _ => false,
            });
            told.push(named.map_or("?", |order| order.name).to_owned());
            Some(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command: order.command,
                result: MavResult::MAV_RESULT_ACCEPTED,
            }))
        }
        _ => None,
    }
}

static NEVER: AtomicBool = AtomicBool::new(false);

fn release(vehicle: &mut Watched) -> Result<()> {
    vehicle.begin(&NEVER);
    vehicle.watch_host()?;
    vehicle.command(request::ARM)?;
    vehicle.put_back_later("PITCH_SET_DEG", 2.0);
    vehicle.command(request::RELEASE)
}

const FLOWN: [&str; 6] = ["FS_HOST 1", "arm", "release", "disarm", "PITCH_SET_DEG 2", "FS_HOST 0"];

#[test]
fn a_command_that_panics_or_fails_disarms_and_puts_back_what_it_changed() {
    let (mut watched, told) = vehicle();
    let panicked = catch_unwind(AssertUnwindSafe(move || {
        release(&mut watched).unwrap();
        panic!("in flight");
    }));
    assert!(panicked.is_err());
    assert_eq!(told.join().unwrap(), FLOWN);

    let (mut watched, told) = vehicle();
    let flown = release(&mut watched).and_then(|()| -> Result<()> { bail!("in flight") });
    let flown = watched.leave(flown);
    assert_eq!(flown.unwrap_err().to_string(), "in flight");
    drop(watched);
    assert_eq!(told.join().unwrap(), FLOWN, "once");
}

#[test]
fn a_signal_ends_a_wait_for_the_vehicle_and_not_the_order_to_disarm() {
    static STOP: AtomicBool = AtomicBool::new(false);
    let (mut watched, told) = vehicle();
    watched.begin(&STOP);
    watched.command(request::ARM).unwrap();
    STOP.store(true, Ordering::Relaxed);
    let flown = watched.command(request::RELEASE);
    let flown = watched.leave(flown);
    assert_eq!(flown.unwrap_err().to_string(), "stopped by the operator");
    drop(watched);
    let told = told.join().unwrap();
    assert_eq!(told.last().map(String::as_str), Some("disarm"), "{told:?}");
}

#[test]
fn a_vehicle_that_nothing_was_done_to_is_left_alone() {
    let (watched, told) = vehicle();
    drop(watched);
    assert_eq!(told.join().unwrap(), Vec::<String>::new());
}

/// It is told once, for as long as one answer takes, and the person what to do.
#[test]
fn a_vehicle_that_answers_nothing_is_to_be_cut_from_its_power() {
    let (mut watched, told) = vehicle_in(StateCode::Active, false);
    watched.begin(&NEVER);
    let begun = Instant::now();
    let left = format!("{:#}", watched.leave(Ok(())).unwrap_err());
    assert!(left.starts_with(CUT_POWER), "{left}");
    assert!(begun.elapsed() < client::client::ANSWER + Duration::from_secs(2));
    drop(watched);
    let told = told.join().unwrap();
    assert!(told.len() > 10 && told.iter().all(|told| told == "disarm"), "{told:?}");
}

#[test]
fn a_latched_fault_is_not_acknowledged() {
    let latched = StateCode::Latched(LatchKind::BrownOut);
    let (mut watched, told) = vehicle_in(latched, true);
    watched.begin(&NEVER);
    watched.put_back_later("SRV_POLARITY", 0.0);
    watched.leave(Ok(())).unwrap();
    drop(watched);
    assert_eq!(told.join().unwrap(), ["SRV_POLARITY 0"]);
}
