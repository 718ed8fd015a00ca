use super::*;
use tokio::sync::oneshot;

use crate::vehicle::port::Port;
use serialport::TTYPort;

/// The vehicle's end of a cable, and a session at the other.
fn session<'a>(model: &'a Model, logs: &'a Path) -> (TTYPort, Session<'a>) {
    let (vehicle, port) = TTYPort::pair().unwrap();
    let link = Link::at(Port::at(Box::new(port), "cable".into()));
    (vehicle, Session::new(link, model, logs))
}

#[test]
fn a_stop_pressed_as_the_cable_goes_is_told_that_the_port_is_gone() {
    let model = Model::default();
    let (vehicle, mut session) = session(&model, Path::new("."));
    drop(vehicle);
    let (reply, mut answer) = oneshot::channel();
    let stop = Request::Order(request::DISARM);
    let gone = session
        .take(Ask::Request(stop, Condition::default(), reply))
        .unwrap_err();
    assert!(gone.to_string().contains("went away"), "{gone}");
    session.close().unwrap();
    let failure = answer.try_recv().unwrap().unwrap_err();
    assert_eq!(failure.to_string(), "disarm: the port went away");
}

#[test]
fn of_two_pages_that_record_one_does_and_it_ends_though_the_vehicle_is_silent() {
    let folder = tempfile::tempdir().unwrap();
    let model = Model::default();
    let (_vehicle, mut session) = session(&model, folder.path());
    let mut record = || {
        let (reply, mut answer) = oneshot::channel();
        session.take(Ask::Record(Recording::Flight, reply)).unwrap();
        answer.try_recv().unwrap()
    };
    let path = record().unwrap();
    let refusal = record().unwrap_err().to_string();
    assert!(refusal.contains("end it first"), "{refusal}");
    let files = std::fs::read_dir(folder.path()).unwrap();
    assert_eq!(files.count(), 1, "a refused recording leaves no file");
    let recording = model.lock().status().recording.clone();
    assert_eq!(recording.as_deref(), path.to_str());
    let (reply, mut answer) = oneshot::channel();
    session.take(Ask::EndRecording(reply)).unwrap();
    answer.try_recv().unwrap().unwrap();
    assert_eq!(model.lock().status().recording, None);
    // What was asked for at its beginning is in it.
    assert!(std::fs::metadata(path).unwrap().len() > 0);
}
