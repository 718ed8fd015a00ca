//! What the chip is asked besides its samples, and who gets the answer.

mod fake;

use bno055_driver::config::Mode;
use bno055_driver::{
    Answer, BusError, Bytes, Config, Imu, Micros, Next, Profile, Request, SensorFault, SoftIron,
    SystemError, Transfer,
};
use fake::Rig;

const PROFILE: Profile = Profile {
    acc_offset: [-24, 13, 5],
    mag_offset: [-301, 640, 77],
    gyr_offset: [-1, 0, 2],
    acc_radius: 1000,
    mag_radius: 712,
};

#[test]
fn requests_in_config_mode_are_answered_and_sampling_resumes() {
    let config = Config { mode: Mode::Ndof, profile: Some(PROFILE), ..Config::default() };
    let mut rig = Rig::sampling(config);
    let ask = |rig: &mut Rig, request| {
        rig.driver.request(request);
        assert!(!rig.driver.is_sampling());
        rig.run_until_sampling(1_500_000);
        let answer = rig.driver.answer();
        assert_eq!(rig.driver.answer(), None, "given once");
        assert!(rig.chip.holds(&config));
        answer
    };
    assert_eq!(ask(&mut rig, Request::Profile), Some(Answer::Profile(PROFILE)));
    assert_eq!(ask(&mut rig, Request::SoftIron), Some(Answer::SoftIron(SoftIron::IDENTITY)));
    let before = rig.chip.now;
    let Some(Answer::SelfTest(result)) = ask(&mut rig, Request::SelfTest) else {
        panic!("no result")
    };
    assert!(result.passed() && result.acc() && result.mag() && result.gyr() && result.controller());
    assert_eq!(result.error, SystemError::None);
    assert!(rig.chip.now - before > 400_000);
    let start = Transfer::Write { register: 0x3F, bytes: Bytes::new([0x01]) };
    assert!(rig.chip.log.contains(&start));
}

#[test]
fn requests_between_samples_do_not_disturb_them() {
    let mut rig = Rig::sampling(Config::default());
    rig.chip.pages[0][0x35] = 0b11_10_01_00;
    rig.driver.request(Request::Temperature);
    rig.turn();
    assert_eq!(rig.driver.answer(), Some(Answer::Temperature(25)));
    rig.driver.request(Request::CalibrationStatus);
    rig.turn();
    let Some(Answer::CalibrationStatus(status)) = rig.driver.answer() else { panic!("no status") };
    assert_eq!((status.system, status.gyr, status.acc, status.mag), (3, 2, 1, 0));
    assert!(rig.driver.is_sampling());
    assert!(rig.bursts(20).iter().all(Result::is_ok));
}

/// A rig whose driver has given out the transfer of `request`, which is still on the wire.
fn on_the_wire(request: Request) -> (Rig, Transfer) {
    let mut rig = Rig::sampling(Config::default());
    rig.chip.pages[0][0x35] = 0b11_10_01_00;
    rig.driver.request(request);
    let Next::Transfer(transfer) = rig.driver.next(Micros(rig.chip.now)) else {
        panic!("the request is due")
    };
    (rig, transfer)
}

/// Completes the transfer that was on the wire.
fn arrive(rig: &mut Rig, transfer: &Transfer) {
    let outcome = rig.chip.perform(transfer);
    let now = Micros(rig.chip.now);
    rig.driver.complete(now, outcome.as_deref().map_err(|error| *error));
}

#[test]
fn an_answer_on_the_wire_does_not_answer_a_newer_request() {
    let (mut rig, transfer) = on_the_wire(Request::Temperature);
    rig.driver.request(Request::CalibrationStatus);
    arrive(&mut rig, &transfer);
    assert_eq!(rig.driver.answer(), None);
    assert!(rig.driver.is_asking(), "the newer request stands");
    rig.bursts(1);
    let answer = rig.driver.answer();
    assert!(matches!(answer, Some(Answer::CalibrationStatus(status)) if status.gyr == 2));
    assert!(!rig.driver.is_asking());
}

#[test]
fn a_cancelled_request_is_not_answered() {
    let (mut rig, transfer) = on_the_wire(Request::Temperature);
    rig.driver.cancel();
    arrive(&mut rig, &transfer);
    assert_eq!(rig.driver.answer(), None);
    rig.bursts(3);
    assert_eq!((rig.driver.answer(), rig.driver.is_asking()), (None, false));
}

#[test]
fn a_lost_answer_that_nobody_waits_for_still_counts_as_a_bus_error() {
    let (mut rig, _) = on_the_wire(Request::Temperature);
    let naks = rig.driver.health().nak;
    rig.driver.cancel();
    rig.driver.complete(Micros(rig.chip.now), Err(BusError::Nak));
    assert_eq!(rig.driver.health().nak, naks + 1);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Nak));
    assert!(rig.bursts(1)[0].is_ok());
}

/// The profile and the self-test are asked during a set-up, in several transfers: at each of them
/// the request may be replaced or dropped.
#[test]
fn a_set_up_does_not_answer_a_request_that_was_replaced_or_dropped() {
    for old in [Request::Profile, Request::SelfTest] {
        for newer in [Some(Request::Temperature), None] {
            for turns in 0..12 {
                let mut rig = Rig::sampling(Config::default());
                rig.driver.request(old);
                for _ in 0..turns {
                    rig.turn();
                }
                rig.driver.cancel();
                // It may have been answered by now.
                let early = rig.driver.answer();
                if let Some(request) = newer {
                    rig.driver.request(request);
                }
                rig.run_until_sampling(1_500_000);
                let late = rig.driver.answer();
                assert_eq!(late, None, "{old:?} after {turns} turns and {early:?}");
                rig.bursts(1);
                let expected = newer.map(|_| Answer::Temperature(25));
                assert_eq!(rig.driver.answer(), expected);
            }
        }
    }
}

#[test]
fn a_request_made_during_a_set_up_for_another_is_answered_after_it() {
    for turns in 0..12 {
        let mut rig = Rig::sampling(Config::default());
        rig.driver.request(Request::Profile);
        for _ in 0..turns {
            rig.turn();
        }
        rig.driver.request(Request::Temperature);
        rig.run_until_sampling(1_500_000);
        assert_eq!(rig.driver.answer(), None);
        assert!(rig.driver.is_asking(), "after {turns} turns");
        rig.bursts(1);
        assert_eq!(rig.driver.answer(), Some(Answer::Temperature(25)));
    }
}
