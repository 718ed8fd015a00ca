//! The recorder's content over MAVLink's log protocol.

use super::*;
use crate::recorder::{Recorder, STEP_BYTES, STEPS, STEPS_AFTER};

/// A flight that has been released, and its recording.
fn released() -> (Link, Recorder) {
    let mut link = Link::new(Desk::in_standby(0.3));
    let mut recorder = Recorder::new();
    for (command, steps) in [(Command::Arm, 60), (Command::Release, STEPS_AFTER)] {
        let now = Micros(link.desk.now_us);
        link.desk.flight.command(now, command).unwrap();
        for _ in 0..steps {
            let snapshot = link.desk.step();
            recorder.record(&snapshot, &link.desk.flight);
        }
    }
    assert_eq!(recorder.len(), STEPS * STEP_BYTES);
    (link, recorder)
}

/// Parts as they come, until none comes any more: offset and bytes.
fn fetch(link: &mut Link, recorder: &Recorder, request: &[u8]) -> Vec<(usize, Vec<u8>)> {
    assert!(link.tell(request).is_empty());
    let mut parts = Vec::new();
    loop {
        link.telemetry.serve_recorder(recorder);
        let messages = take(&mut link.telemetry);
        let Some(MavMessage::LOG_DATA(part)) = messages.first() else {
            return parts;
        };
        assert_eq!((messages.len(), part.id), (1, 0));
        let bytes = part.data[..part.count.into()].to_vec();
        parts.push((part.ofs as usize, bytes));
    }
}

fn request(ofs: u32, count: u32) -> Vec<u8> {
    from_host(&LOG_REQUEST_DATA_DATA {
        ofs,
        count,
        target_system: 1,
        target_component: 1,
        ..LOG_REQUEST_DATA_DATA::DEFAULT
    })
}

#[test]
fn the_one_log_is_listed_byte_for_byte_as_pymavlink_has_it() {
    let (mut link, recorder) = released();
    link.telemetry.sequence = 5;
    link.telemetry.receive(Micros(0), &golden("log_request_list"), &mut link.desk.flight);
    link.telemetry.serve_recorder(&recorder);
    assert_eq!(link.telemetry.pending(), golden("log_entry"));
}

#[test]
fn without_a_release_there_is_no_log() {
    let mut link = Link::new(Desk::in_standby(0.3));
    link.tell(&golden("log_request_list"));
    link.telemetry.serve_recorder(&Recorder::new());
    let messages = take(&mut link.telemetry);
    assert!(
        matches!(
            messages[..],
            [MavMessage::LOG_ENTRY(LOG_ENTRY_DATA { num_logs: 0, size: 0, .. })]
        ),
        "{messages:?}"
    );
    let parts = fetch(&mut link, &Recorder::new(), &request(0, 90));
    assert_eq!(parts, [(0, Vec::new())], "an end at once");
}

#[test]
fn all_of_it_comes_a_part_a_step_and_any_part_alone() {
    let (mut link, recorder) = released();
    let mut expected = std::vec![0; recorder.len()];
    recorder.read(0, &mut expected);
    let parts = fetch(&mut link, &recorder, &request(0, u32::MAX));
    assert_eq!(parts.len(), expected.len().div_ceil(90));
    let mut found = Vec::new();
    for (offset, bytes) in parts {
        assert_eq!(offset, found.len());
        found.extend(bytes);
    }
    assert_eq!(found, expected);
    let parts = fetch(&mut link, &recorder, &golden("log_request_data"));
    let part = |from: usize, to: usize| (from, expected[from..to].to_vec());
    assert_eq!(parts, [part(90, 180), part(180, 190)]);
}

#[test]
fn it_ends_when_told_and_waits_for_room() {
    let (mut link, recorder) = released();
    link.tell(&request(0, u32::MAX));
    for _ in 0..100 {
        link.telemetry.serve_recorder(&recorder);
    }
    assert_eq!(link.telemetry.dropped(), 0);
    let first = take(&mut link.telemetry).len();
    assert!((5..30).contains(&first), "{first}");
    link.tell(&golden("log_request_end"));
    link.telemetry.serve_recorder(&recorder);
    assert!(take(&mut link.telemetry).is_empty());
}

#[test]
fn a_request_for_another_vehicle_or_another_log_is_not_ours() {
    let (mut link, recorder) = released();
    for (target_system, id) in [(2, 0), (1, 1)] {
        let request = from_host(&LOG_REQUEST_DATA_DATA {
            count: 90,
            target_system,
            target_component: 1,
            id,
            ..LOG_REQUEST_DATA_DATA::DEFAULT
        });
        assert!(fetch(&mut link, &recorder, &request).is_empty());
    }
}
