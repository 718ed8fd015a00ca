use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag};
use serialport::TTYPort;
use std::io::{Read, Write};
use tokio::sync::oneshot;

use super::*;
use crate::vehicle::port::Port;
use client::Wire;

/// The vehicle's end of a cable, and a session at the other.
fn session<'a>(model: &'a Model, logs: &'a Path) -> (TTYPort, Session<'a>) {
    let (vehicle, port) = TTYPort::pair().unwrap();
    let link = Link::at(Port::at(Box::new(port), "cable".into()));
    (vehicle, Session::new(link, model, logs))
}

/// Asks for an order that may be sent until a time from now.
fn ask(
    session: &mut Session,
    order: request::Order,
    until: Duration,
) -> oneshot::Receiver<Result<()>> {
    let condition = Condition { until: Some(Instant::now() + until), unless: None };
    let (reply, answer) = oneshot::channel();
    let ask = Ask::Request(Request::Order(order), condition, reply);
    session.take(ask).unwrap();
    answer
}

/// First parameters of the orders to arm or disarm that have come to the vehicle.
fn orders(vehicle: &mut TTYPort) -> Vec<f32> {
    let mut bytes = vec![0; 4096];
    let count = vehicle.read(&mut bytes).unwrap_or(0);
    let frames = Wire::default().receive_frames(&bytes[..count]);
    let orders = frames.into_iter().filter_map(|frame| match frame.message {
        MavMessage::COMMAND_LONG(long) => {
            assert_eq!(long.command, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
            Some(long.param1)
        }
        _ => None,
    });
    orders.collect()
}

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn a_stop_pressed_as_the_cable_goes_is_told_that_the_port_is_gone() {
    let model = Model::default();
    let (vehicle, mut session) = session(&model, Path::new("."));
    drop(vehicle);
    let (reply, mut answer) = oneshot::channel();
    let stop = Request::Order(DISARM);
    let ask = Ask::Request(stop, Condition::default(), reply);
    let gone = session.take(ask).unwrap_err();
    assert!(gone.to_string().contains("went away"), "{gone}");
    session.close().unwrap();
    let failure = answer.try_recv().unwrap().unwrap_err();
    assert_eq!(failure.to_string(), "disarm: the port went away");
}

#[test]
fn an_order_whose_time_is_over_is_not_sent_nor_sent_again() {
    let model = Model::default();
    let (mut vehicle, mut session) = session(&model, Path::new("."));
    let mut late = ask(&mut session, request::ARM, Duration::ZERO);
    let refusal = late.try_recv().unwrap().unwrap_err().to_string();
    assert!(refusal.contains("waited too long"), "{refusal}");
    let _waits = ask(&mut session, request::ARM, SECOND / 10);
    assert_eq!(orders(&mut vehicle), [1.0]);
    // The client would send it again after a second.
    let end = Instant::now() + SECOND * 3 / 2;
    while Instant::now() < end {
        session.link.receive().unwrap();
        session.answer();
    }
    assert_eq!(orders(&mut vehicle), [0.0; 0]);
}

#[test]
fn nothing_is_ordered_while_a_stop_waits_and_many_stops_are_one() {
    let model = Model::default();
    let (mut vehicle, mut session) = session(&model, Path::new("."));
    let mut stops: Vec<_> = (0..3).map(|_| ask(&mut session, DISARM, SECOND)).collect();
    let mut arm = ask(&mut session, request::ARM, SECOND);
    let refusal = arm.try_recv().unwrap().unwrap_err().to_string();
    assert!(refusal.contains("a STOP waits"), "{refusal}");
    assert_eq!(orders(&mut vehicle), [0.0]);
    session.close().unwrap();
    for stop in &mut stops {
        assert!(stop.try_recv().unwrap().is_err(), "each is told");
    }
}

#[test]
fn a_thread_that_panics_disarms_first() {
    let model = Model::default();
    let (mut vehicle, mut session) = session(&model, Path::new("."));
    let armed = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
        base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
        custom_mode: StateKind::Armed as u32,
        ..HEARTBEAT_DATA::default()
    });
    vehicle.write_all(&Wire::default().frame(&armed)).unwrap();
    session.link.receive().unwrap();
    assert!(session.is_in_operation());
    std::thread::scope(|scope| {
        let thread = scope.spawn(move || {
            let _session = session;
            panic!("on purpose");
        });
        let mut sent = Vec::new();
        while !thread.is_finished() {
            sent.extend(orders(&mut vehicle));
        }
        assert!(thread.join().is_err());
        assert_eq!(sent.first(), Some(&0.0));
    });
}

#[test]
fn of_two_pages_that_record_one_does_and_it_ends_though_the_vehicle_is_silent() {
    let folder = tempfile::tempdir().unwrap();
    let model = Model::default();
    let (_vehicle, mut session) = session(&model, folder.path());
    let mut record = || {
        let (reply, mut answer) = oneshot::channel();
        let ask = Ask::Record(None, reply);
        session.take(ask).unwrap();
        answer.try_recv().unwrap()
    };
    let path = record().unwrap();
    let refusal = record().unwrap_err().to_string();
    assert!(refusal.contains("end it first"), "{refusal}");
    let files = std::fs::read_dir(folder.path()).unwrap();
    assert_eq!(files.count(), 1, "a refused recording leaves no file");
    let recording = model.lock().status.recording.clone();
    assert_eq!(recording.as_deref(), path.to_str());
    let (reply, mut answer) = oneshot::channel();
    session.take(Ask::EndRecording(reply)).unwrap();
    answer.try_recv().unwrap().unwrap();
    assert_eq!(model.lock().status.recording, None);
    // What was asked for at its beginning is in it.
    assert!(std::fs::metadata(path).unwrap().len() > 0);
}
