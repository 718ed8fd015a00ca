//! The image in a rocket: it sees launch and burnout, keeps the axis upright on its gyroscope alone
//! while mass, inertia and air change, and says how uncertain it has become.

use crate::firmware;
use client::StateKind;
use rig::bench::{Since, TimedFault, VehicleConfig, ZERO_RUDDER_US};
use rig::bno055::Fault;
use rig::flight::FlightRecord;
use rig::rocket::{self, Airframe, RocketLaw};
use rig::{ServoKind, Setup, Ticks, prepare};

const SEED: u64 = 5;

/// A rocket on its pad, whose image has `changes` of its parameters.
fn on_pad(airframe: &Airframe, law: RocketLaw, changes: &[(&str, f32)]) -> Setup {
    let mut setup = Setup::with_polarity(ServoKind::S3003, SEED);
    let on_pad = airframe.on_pad(SEED);
    setup.rig.bench.vehicle = VehicleConfig::Rocket(Box::new(on_pad));
    let stored = setup.rig.stored.as_mut().unwrap();
    let per_g_deg_s = setup.rig.hardware.gyro_per_g_deg_s;
    let gyroscope = rocket::calibrated(per_g_deg_s, SEED);
    for (name, value) in rocket::parameters(airframe, law).into_iter().chain(gyroscope) {
        stored.set(&name, value).unwrap();
    }
    for (name, value) in changes {
        stored.set(name, *value).unwrap();
    }
    setup
}

/// Flies it until so long after its ignition, s.
fn fly(setup: &Setup, seconds: f64) -> FlightRecord {
    let ready = prepare(firmware(), setup, &mut |_| {}).unwrap();
    let tilt_rad = Airframe::stable().on_pad(SEED).start_rad;
    ready.launch(tilt_rad, 5.0, seconds, &mut |_| {}).unwrap()
}

fn seconds(flight: &FlightRecord, at: Ticks) -> f64 {
    at.saturating_sub(flight.released).as_secs_f64()
}

/// Root mean square of the axis' angle from the vertical between two times, deg.
fn error_deg(flight: &FlightRecord, between_s: std::ops::Range<f64>) -> f64 {
    let motion = flight.motion.iter();
    let squares = motion
        .filter(|m| between_s.contains(&seconds(flight, m.time)))
        .map(|m| m.tilt_rad[0].powi(2) + m.tilt_rad[1].powi(2));
    let squares: Vec<f64> = squares.collect();
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    mean.sqrt().to_degrees()
}

/// When the state came first, s since ignition.
fn state_at(flight: &FlightRecord, state: StateKind) -> Option<f64> {
    let mut beats = flight.received.heartbeats.iter();
    let beat = beats.find(|beat| beat.at > flight.released && beat.state == Some(state))?;
    Some(seconds(flight, beat.at))
}

#[test]
fn an_unstable_rocket_is_kept_upright_from_launch_to_burnout() {
    let flight = fly(&on_pad(&Airframe::unstable(), RocketLaw::Scheduled, &[]), 92.0);
    let launch_s = state_at(&flight, StateKind::Active).unwrap();
    assert!((0.1..0.2).contains(&launch_s), "{launch_s}");
    let end_s = state_at(&flight, StateKind::Standby).unwrap();
    assert!((90.2..90.4).contains(&end_s), "{end_s}");
    let error_deg = error_deg(&flight, 2.1..90.0);
    assert!(error_deg < 2.0, "{error_deg}");
    // Within the gimbal's 5 deg until then, and neutral after.
    let most_us = 10.0 * Airframe::unstable().mounting.shaft_per_gimbal * 5.0 + 1.0;
    for pulse in flight.pulses.iter().chain(&flight.roll_pulses) {
        let off_us = (pulse.width_us() - ZERO_RUDDER_US).abs();
        let ended = seconds(&flight, pulse.rise) > end_s + 0.05;
        assert!(off_us <= if ended { 1.0 } else { most_us }, "{off_us}");
    }
    // Once a second, growing, beyond what the attitude is off.
    let in_flight = flight.received.tilt_sd_deg.iter().filter(|(at, _)| {
        let at_s = seconds(&flight, *at);
        (launch_s + 0.1..end_s).contains(&at_s)
    });
    let told: Vec<f32> = in_flight.map(|(_, sd_deg)| *sd_deg).collect();
    assert!((88..=91).contains(&told.len()), "{}", told.len());
    assert!(told.windows(2).all(|pair| pair[0] < pair[1]), "{told:?}");
}

/// A shorter part of the burn with a loop of the angle around one of the rate, and with gains that
/// stay.
#[test]
fn cascade_and_constant_gains_fly_too() {
    let gains = Airframe::stable().constant_gains;
    for law in [RocketLaw::Cascade, RocketLaw::Constant(gains)] {
        let flight = fly(&on_pad(&Airframe::stable(), law, &[]), 20.0);
        assert_eq!(flight.final_state, Some(StateKind::Active));
        let error_deg = error_deg(&flight, 2.1..20.0);
        assert!(error_deg < 2.0, "{law:?}: {error_deg}");
    }
}

/// Nobody should turn it on: under thrust the accelerometer shows the rocket's axis as the
/// vertical.
#[test]
fn the_accelerometer_left_in_loses_the_rocket() {
    let left_in = [("FUSE_ACC", 1.0)];
    let flight = fly(&on_pad(&Airframe::stable(), RocketLaw::Scheduled, &left_in), 40.0);
    assert!(error_deg(&flight, 20.0..40.0) > 10.0);
    // By how much the thrust pulls, the estimator knows that it may be wrong.
    let told = flight.received.tilt_sd_deg.last();
    assert!(told.is_some_and(|(_, sd_deg)| *sd_deg > 5.0), "{told:?}");
}

/// A sensor that falls silent in flight is a failsafe: both actuators go to neutral, and stay
/// there.
#[test]
fn a_rocket_without_a_sensor_is_not_steered() {
    let mut setup = on_pad(&Airframe::stable(), RocketLaw::Scheduled, &[]);
    setup.rig.bench.faults = vec![TimedFault {
        fault: Fault::Unplugged,
        since: Since::Release,
        at: Ticks::from_ms(10_000),
        until: Ticks::NEVER,
    }];
    let flight = fly(&setup, 11.0);
    assert_eq!(flight.final_state, Some(StateKind::Failsafe));
    let pulses = flight.pulses.iter().chain(&flight.roll_pulses);
    let late = pulses.filter(|pulse| seconds(&flight, pulse.rise) > 10.1);
    let late: Vec<f64> = late.map(|pulse| pulse.width_us()).collect();
    assert!(late.len() > 60);
    assert!(late.iter().all(|us| (us - ZERO_RUDDER_US).abs() <= 1.0), "{late:?}");
}
