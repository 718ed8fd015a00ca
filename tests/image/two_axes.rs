//! The image with two rudders: it brings both axes upright at once, both pulses are locked to one
//! frame, and both rudders rest at neutral where one would.

use crate::campaign::beyond_the_sensor;
use crate::faults::ms;
use crate::parameters::changes_cost_no_tick;
use crate::{firmware, with_two_axes};
use client::StateKind;
use rig::bno055::Fault;
use rig::flight::Release;
use rig::{GroundStation, Ready, Rig, ServoKind, Setup, Ticks, prepare};
use std::sync::OnceLock;
use tvc_nano::Axis;

/// The two-axis drone in standby, its nose to the east.
fn setup(servo: ServoKind) -> Setup {
    let mut setup = with_two_axes(Setup::with_polarity(servo, 3));
    setup.rig.bench.heading_rad = std::f64::consts::FRAC_PI_2;
    setup
}

fn ready() -> Ready {
    static READY: OnceLock<Ready> = OnceLock::new();
    READY
        .get_or_init(|| prepare(firmware(), &setup(ServoKind::S3003), &mut |_| {}).unwrap())
        .clone()
}

fn tilted(pitch_rad: f64, roll_rad: f64, spin_rad_s: f64) -> Release {
    Release { tilt_rad: [pitch_rad, roll_rad], rate_rad_s: 0.2, spin_rad_s }
}

#[test]
fn both_axes_come_upright_with_and_without_spin() {
    let digital = prepare(firmware(), &setup(ServoKind::Digital), &mut |_| {}).unwrap();
    for (ready, longest_s) in [(ready(), 0.75), (digital, 0.55)] {
        for release in [
            tilted(0.4, 0.0, 0.0),
            tilted(0.0, -0.4, 1.0),
            tilted(-0.6, 0.6, 0.0),
            tilted(0.4, 0.4, 1.0),
        ] {
            let flight = ready.fly_from(&release, 2.0, &mut |_| {}).unwrap();
            assert_eq!(flight.final_state, Some(StateKind::Active), "{release:?}");
            for axis in Axis::ALL {
                if release.tilt_rad[axis.index()] == 0.0 {
                    let motion = flight.motion.iter();
                    let angles = motion.map(|m| m.tilt_rad[axis.index()].abs());
                    // A tenth of the other's start.
                    let largest = angles.fold(0.0, f64::max);
                    assert!(largest < 0.04, "{release:?}: {largest}");
                    continue;
                }
                let response = flight.response(axis).unwrap();
                let overshoot = response.overshoot_pct();
                assert!(overshoot <= 5.0, "{release:?}, {axis:?}: {overshoot} %");
                let settled = response.settling_s(0.05);
                assert!(
                    settled.is_some_and(|s| s <= longest_s),
                    "{release:?}, {axis:?}: {settled:?}"
                );
            }
        }
    }
}

#[test]
fn both_pulses_rise_with_the_frame_and_neither_is_missing() {
    let mut ready = ready();
    let Ready { rig, station, .. } = &mut ready;
    rig.environment.truth.clear();
    station.run(rig, ms(500)).unwrap();
    let truth = rig.truth();
    let [pitch, roll] = Axis::ALL.map(|axis| truth.pulses_of(axis));
    assert!((24..=25).contains(&pitch.len()), "{}", pitch.len());
    assert_eq!(pitch.len(), roll.len());
    for (pitch, roll) in pitch.iter().zip(roll) {
        assert_eq!(pitch.rise, roll.rise);
        for pulse in [pitch, roll] {
            assert!((pulse.width_us() - 1524.0).abs() < 0.1, "{}", pulse.width_us());
        }
    }
}

#[test]
fn a_sensor_that_is_lost_brings_both_rudders_to_neutral() {
    let mut ready = ready();
    let Ready { rig, station, .. } = &mut ready;
    in_flight_off_neutral(rig, station);
    rig.inject(Fault::Unplugged);
    station.run(rig, ms(200)).unwrap();
    assert_eq!(station.state(), Some(StateKind::Failsafe));
    for axis in Axis::ALL {
        assert!((width(axis, rig) - 1524.0).abs() < 0.1, "{axis:?}");
    }
}

/// Without pulses it would stay where control has left it.
#[test]
fn a_rudder_that_is_steered_no_more_is_kept_at_neutral() {
    let mut ready = ready();
    let Ready { rig, station, .. } = &mut ready;
    in_flight_off_neutral(rig, station);
    station.disarm(rig).unwrap();
    station.set_parameter(rig, "AXES", 1.0).unwrap();
    let at = rig.now();
    station.run(rig, ms(500)).unwrap();
    assert_at_neutral(rig, at, ms(500));
    station.set_parameter(rig, "AXES", 2.0).unwrap();
    let at = rig.now();
    station.run(rig, ms(500)).unwrap();
    assert_at_neutral(rig, at, ms(500));
}

/// The vehicle does not know any more that it has two rudders, one of which was in use.
#[test]
fn both_rudders_go_to_neutral_where_the_stored_parameters_are_lost() {
    let mut ready = ready();
    let Ready { rig, station, .. } = &mut ready;
    in_flight_off_neutral(rig, station);
    rig.spoil_store();
    rig.press_reset();
    station.run(rig, ms(2000)).unwrap();
    assert_eq!(station.state(), Some(StateKind::Latched));
    let at = rig.now();
    station.run(rig, ms(500)).unwrap();
    assert_at_neutral(rig, at, ms(500));
}

fn in_flight_off_neutral(rig: &mut Rig, station: &mut GroundStation) {
    rig.environment.tilt_clamp_to([0.4, 0.3]);
    station.run(rig, ms(5000)).unwrap();
    station.arm(rig).unwrap();
    station.release(rig, 0.2).unwrap();
    station.run(rig, ms(150)).unwrap();
    for axis in Axis::ALL {
        assert!((width(axis, rig) - 1524.0).abs() > 20.0, "{axis:?}");
    }
}

/// The newest pulse of a rudder, us.
fn width(axis: Axis, rig: &Rig) -> f64 {
    rig.truth().pulses_of(axis).last().unwrap().width_us()
}

/// Both rudders have had a neutral pulse in every frame for this time.
fn assert_at_neutral(rig: &Rig, from: Ticks, time: Ticks) {
    for axis in Axis::ALL {
        let pulses = rig.truth().pulses_of(axis);
        let since: Vec<_> = pulses.iter().filter(|pulse| pulse.rise >= from).collect();
        let frames = time.as_us_f64() / 20e3;
        assert!((since.len() as f64 - frames).abs() <= 1.0, "{axis:?}");
        assert!(since.iter().all(|p| (p.width_us() - 1524.0).abs() < 0.1), "{axis:?}");
    }
}

/// Two laws take over a parameter in flight one after the other, so that no tick is lost by it.
#[test]
fn a_parameter_that_changes_in_flight_costs_no_tick() {
    changes_cost_no_tick(ready());
}

#[test]
fn faults_beyond_the_sensor_drive_neither_rudder_wrongly_for_long() {
    // Verifications of this vehicle only just fit: any fault shifts the next pulses.
    beyond_the_sensor(&ready(), ServoKind::S3003, 5);
}
