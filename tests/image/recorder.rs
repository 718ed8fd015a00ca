//! The recorder: what the image kept of a release is what it did, step by step.

use crate::faults::ms;
use crate::ready;
use client::StateKind;
use rig::Ready;
use tvc_nano::recorder::{STEP_BYTES, STEPS, STEPS_AFTER, STEPS_BEFORE, Step};

fn steps(bytes: &[u8]) -> Vec<Step> {
    let (steps, rest) = bytes.as_chunks::<STEP_BYTES>();
    assert!(rest.is_empty());
    steps.iter().map(Step::decode).collect()
}

#[test]
fn a_release_is_fetched_as_it_was_streamed() {
    let mut bench = ready();
    let Ready { rig, station, .. } = &mut bench;
    assert!(station.fetch_recording(rig).unwrap().is_empty());
    station.begin_measurement();
    station.arm(rig).unwrap();
    station.run(rig, ms(400)).unwrap();
    station.release(rig, 0.2).unwrap();
    station.run(rig, ms(500)).unwrap();
    assert!(station.fetch_recording(rig).unwrap().is_empty(), "not whole yet");
    station.run(rig, ms(1000)).unwrap();
    // Fetched while control goes on, and nothing else is lost by it.
    let steps = steps(&station.fetch_recording(rig).unwrap());
    assert_eq!(station.state(), Some(StateKind::Active));
    assert_eq!(station.counts().lost, 0);
    assert_eq!(steps.len(), STEPS);

    let received = station.received();
    let first = u64::from(received.servos[0].time_us);
    let mut compared = 0;
    for (index, step) in steps.iter().enumerate() {
        assert_eq!(step.code, if index < STEPS_BEFORE { 3 } else { 4 }, "{index}");
        assert!(step.now.0 > first);
        let servo = received.servos.iter().find(|servo| u64::from(servo.time_us) == step.now.0);
        assert_eq!(servo.unwrap().pulse_us, step.pulses[0].0);
        let sample = step.sample.unwrap();
        let raw = received.samples.iter().find(|raw| raw.time_us == sample.time.0).unwrap();
        assert_eq!((raw.acc, raw.gyr, raw.mag), (sample.acc, sample.gyr, sample.mag));
        let time_ms = (sample.time.0 / 1000) as u32;
        let told = received.attitudes.iter().find(|told| told.time_ms == time_ms).unwrap();
        let q = step.orientation;
        for (kept, told) in [q.w, q.x, q.y, q.z].iter().zip(told.quaternion) {
            assert!((kept - told).abs() < 2e-4, "{step:?} {told:?}");
        }
        assert_eq!(step.rate, told.rate_rad_s);
        compared += usize::from(step.cranks_rad[0] != 0.0);
    }
    assert!(compared > STEPS_AFTER / 2, "{compared} steps with a command");
}
