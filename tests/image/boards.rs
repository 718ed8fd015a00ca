//! The images for the other boards, each on a rig that is wired as its board is.

use rig::bench::Wiring;
use rig::{ServoKind, Setup, prepare};
use tvc_nano::Axis;

use crate::probe::image;

/// It flies the drone as the Nano's image does.
fn flies(feature: &str, wiring: Wiring) {
    let image = image(&[feature]);
    let mut setup = Setup::with_polarity(ServoKind::S3003, 1);
    setup.rig.bench.wiring = wiring;
    let ready = prepare(&image, &setup, &mut |_| {}).unwrap_or_else(|error| panic!("{error}"));
    let flight = ready.fly(0.4, 0.2, 3.0, &mut |_| {}).unwrap();
    let response = flight.response(Axis::Pitch).unwrap();
    assert!(response.overshoot_pct() <= 5.0, "{feature}");
    let settled = response.settling_s(0.05);
    assert!(settled.is_some_and(|s| s <= 0.6), "{feature}: {settled:?}");
    // The probe pin and the sensor's bus, seen from outside.
    assert!(flight.timing.steps.abs_diff(flight.timing.bursts) <= 1);
    assert!(flight.timing.bursts > 100, "{feature}");
}

#[test]
fn a_xiao_m0_flies() {
    flies("xiao-m0", Wiring::XIAO_M0);
}

#[test]
fn a_qt_py_m0_flies() {
    flies("qt-py-m0", Wiring::QT_PY_M0);
}

/// The wiring is what makes them fly: an image for another board finds no sensor there.
#[test]
fn an_image_for_another_board_finds_no_sensor() {
    let mut setup = Setup::with_polarity(ServoKind::S3003, 1);
    setup.rig.bench.wiring = Wiring::XIAO_M0;
    assert!(prepare(crate::firmware(), &setup, &mut |_| {}).is_err());
}

/// It reads the sensor's 27 C by embedded-hal's traits, the servo's pulses show them for 0.2 s, and
/// the firmware goes on to standby.
#[test]
fn a_driver_by_others_runs_on_the_board() {
    let setup = Setup::with_polarity(ServoKind::S3003, 1);
    let image = image(&["embedded-hal"]);
    let ready = prepare(&image, &setup, &mut |_| {}).unwrap_or_else(|error| panic!("{error}"));
    let pulses = ready.rig.truth().pulses_of(Axis::Pitch).iter();
    let shown = pulses.filter(|pulse| (pulse.width_us() - 1_527.0).abs() < 1.0);
    assert!((9..=11).contains(&shown.count()));
}
