//! What the sensor feels, the clamp, the servo.

use super::*;
use crate::bench::sensor_motion::resting;
use crate::bench::{EarthField, TimedFault, Wiring};
use calibration::poses::Face;
use nalgebra::Vector3;

fn environment(bench: BenchConfig) -> Environment {
    Environment::new(&bench).unwrap()
}

fn on_drone(environment: &Environment, pitch_rad: f64, rate_rad_s: f64) -> Stimulus {
    let mut environment = environment.clone();
    environment.vehicle.clamp([pitch_rad, 0.0]);
    environment.turning.0.y = rate_rad_s;
    environment.felt_on_drone(Ticks::ZERO)
}

fn near(a: [f64; 3], b: [f64; 3]) {
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() < 1e-9, "{a} instead of {b}");
    }
}

#[test]
fn nose_up_the_sensor_feels_what_holds_it() {
    let environment = environment(BenchConfig::default());
    let level = on_drone(&environment, 0.0, 0.0);
    near(level.specific_force_m_s2, [0.0, 0.0, -9.81]);
    let up = on_drone(&environment, std::f64::consts::FRAC_PI_6, 0.2);
    near(up.specific_force_m_s2, [4.905, 0.0, -9.81 * 0.75_f64.sqrt()]);
    near(up.rate_rad_s, [0.0, 0.2, 0.0]);
}

#[test]
fn the_field_is_that_of_copenhagen() {
    let north = environment(BenchConfig {
        heading_rad: EarthField::COPENHAGEN.declination_rad,
        ..BenchConfig::default()
    });
    // Nose to magnetic north, level: nothing to the right, 17.1 uT ahead, 47 uT down.
    near(on_drone(&north, 0.0, 0.0).field_ut, [17.101_007_166, 0.0, 46.984_631_039]);
    // Nose straight up along -down: the strong part lies on -x.
    let up = on_drone(&north, std::f64::consts::FRAC_PI_2, 0.0);
    near(up.field_ut, [-46.984_631_039, 0.0, 17.101_007_166]);
}

/// The attitude takes what the sensor feels back to the earth.
#[test]
fn attitude_agrees_with_the_vectors() {
    let environment = environment(BenchConfig::default());
    for pitch in [-1.0, 0.0, 0.3, 0.8] {
        let felt = on_drone(&environment, pitch, 0.0);
        near(rotate(felt.attitude, felt.specific_force_m_s2), [0.0, 0.0, 9.81]);
        near(rotate(felt.attitude, felt.field_ut), [0.0, 17.101_007_166, -46.984_631_039]);
    }
}

fn rotate([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let q = nalgebra::Quaternion::new(w, x, y, z);
    let r = q * nalgebra::Quaternion::new(0.0, v[0], v[1], v[2]) * q.conjugate();
    [r.i, r.j, r.k]
}

#[test]
fn the_clamp_holds_tilts_and_lets_go() {
    let mut environment = environment(BenchConfig::default());
    environment.advance(Ticks::from_ms(100));
    assert_eq!(environment.vehicle().pitch_rad(), 0.0);
    environment.tilt_clamp_to([0.4, 0.0]);
    environment.advance(Ticks::from_ms(500));
    assert!((environment.truth.motion.last().unwrap().rates_rad_s[0] - 0.5).abs() < 1e-9);
    environment.advance(Ticks::from_ms(1000));
    assert!(environment.clamp_rests());
    assert_eq!(environment.vehicle().pitch_rad(), 0.4);
    environment.release(0.2);
    environment.advance(Ticks::from_ms(1010));
    assert!((environment.vehicle().pitch_rad() - 0.402).abs() < 1e-3);
}

#[test]
fn the_sensor_is_taken_off_turned_and_put_back() {
    let mut environment = environment(BenchConfig { start_rad: 0.3, ..BenchConfig::default() });
    environment.advance(Ticks::from_ms(100));
    let on_the_drone = on_drone(&environment, 0.3, 0.0);
    environment.move_sensor(SensorMotion::To(resting(Face::NoseUp), 0.5));
    environment.advance(Ticks::from_ms(300));
    let (held, _) = environment.held_sensor.as_ref().unwrap();
    assert!(!held.has_arrived());
    environment.advance(Ticks::from_ms(700));
    let (held, _) = environment.held_sensor.as_ref().unwrap();
    let felt =
        stimulus::in_hand(&held.attitude(), Vector3::zeros(), &environment.bench.field, 9.81);
    for (axis, expected) in [9.81, 0.0, 0.0].into_iter().enumerate() {
        assert!((felt.specific_force_m_s2[axis] - expected).abs() < 1e-6);
    }
    environment.put_back();
    environment.advance(Ticks::from_ms(2190));
    let (held, _) = environment.held_sensor.as_ref().unwrap();
    let felt =
        stimulus::in_hand(&held.attitude(), Vector3::zeros(), &environment.bench.field, 9.81);
    for axis in 0..3 {
        let off = felt.field_ut[axis] - on_the_drone.field_ut[axis];
        assert!(off.abs() < 0.5, "{off}");
    }
    environment.advance(Ticks::from_ms(2300));
    assert!(environment.held_sensor.is_none());
}

/// From 20 to 50 ms after each release, and over when the drone is caught.
#[test]
fn faults_come_and_go_after_each_release() {
    let mut environment = environment(BenchConfig {
        faults: vec![TimedFault {
            fault: Fault::SclStuck,
            since: Since::Release,
            at: Ticks::from_ms(20),
            until: Ticks::from_ms(50),
        }],
        ..BenchConfig::default()
    });
    let stuck = |environment: &mut Environment, ms: u64| {
        environment.advance(Ticks::from_ms(ms));
        environment.sensor.held_low(Ticks::from_ms(ms)).scl
    };
    assert!(!stuck(&mut environment, 100), "in the clamp nothing happens");
    environment.release(0.0);
    let seen = [119, 121, 149, 151].map(|ms| stuck(&mut environment, ms));
    assert_eq!(seen, [false, true, true, false]);
    environment.catch();
    assert!(!stuck(&mut environment, 300));
    environment.release(0.0);
    assert!(stuck(&mut environment, 330));
    environment.catch();
    assert!(!stuck(&mut environment, 331));
}

/// It is there from the first step on, and is neither ended by a catch nor forgotten at the next
/// power-on.
#[test]
fn a_fault_without_an_end_comes_with_the_power() {
    let mut environment = environment(BenchConfig {
        faults: vec![TimedFault {
            fault: Fault::SclStuck,
            since: Since::PowerOn,
            at: Ticks::ZERO,
            until: Ticks::NEVER,
        }],
        ..BenchConfig::default()
    });
    let stuck = |environment: &mut Environment, ms: u64| {
        environment.advance(Ticks::from_ms(ms));
        environment.sensor.held_low(Ticks::from_ms(ms)).scl
    };
    assert!(stuck(&mut environment, 1));
    environment.release(0.0);
    environment.catch();
    assert!(stuck(&mut environment, 10));
    environment.clear(Ticks::from_ms(10), Fault::SclStuck);
    assert!(!stuck(&mut environment, 20));
    environment.power_on();
    assert!(stuck(&mut environment, 21));
}

/// 0.2 N m for 0.1 s is an impulse of 20 mN m s, which gives 0.127 kg m2 a rate of 0.157 rad/s.
#[test]
fn a_gust_turns_a_free_drone_and_what_is_off_acts_no_more() {
    let rate = |gust: Option<(f64, f64)>| {
        let mut environment = environment(BenchConfig::default());
        environment.release(0.0);
        if let Some((torque_n_m, seconds)) = gust {
            environment.gust(torque_n_m, seconds);
        }
        environment.advance(Ticks::from_ms(100));
        environment.vehicle().rates_rad_s()[1]
    };
    let gained = rate(Some((0.2, 0.1))) - rate(None);
    assert!((0.15..0.165).contains(&gained), "{gained}");
    let mut environment = environment(BenchConfig::default());
    let thrust = |environment: &Environment| match &environment.vehicle {
        Vehicle::Pivot(drone) => drone.mechanism().parameters().thrust_n,
        other => panic!("{other:?}"),
    };
    let full = thrust(&environment);
    environment.set_disturbances(Disturbances {
        thrust_ramp: "40,0.5".parse().ok(),
        ..Disturbances::default()
    });
    environment.advance(Ticks::from_ms(10));
    assert!((thrust(&environment) - 0.4 * full).abs() < 1e-9);
    environment.set_disturbances(Disturbances::default());
    assert_eq!(thrust(&environment), full);
}

#[test]
fn a_pulse_turns_the_servo_and_pitches_the_drone() {
    let mut environment = environment(BenchConfig::default());
    environment.release(0.0);
    for frame in 0..25 {
        let rise = Ticks::from_ms(20 * frame);
        environment.pin(rise, Wiring::NANO_33_IOT.servos[0], true);
        environment.pin(rise + Ticks::from_us(1723), Wiring::NANO_33_IOT.servos[0], false);
    }
    environment.advance(Ticks::from_ms(500));
    // The wash turns it back a little.
    let servo = &environment.servos[0];
    let short_rad = servo.target_rad() - servo.crank().angle_rad;
    assert!((0.03..0.06).contains(&short_rad), "{short_rad}");
    assert!(environment.vehicle().rudders_rad()[0] > 0.15);
    // Positive rudder, nose down.
    assert!(environment.vehicle().pitch_rad() < -0.1);
    assert_eq!(environment.truth.pulses[0].len(), 25);
}

#[test]
fn the_horn_is_fitted_at_1523_6() {
    let mut environment = environment(BenchConfig::default());
    environment.release(0.0);
    let rise = Ticks::from_ms(1);
    environment.pin(rise, Wiring::NANO_33_IOT.servos[0], true);
    environment.pin(rise + Ticks(73_133), Wiring::NANO_33_IOT.servos[0], false);
    environment.advance(Ticks::from_ms(400));
    // The servo counts whole microseconds: 1524 us, 0.04 deg off, inside its deadband.
    assert!(environment.vehicle().rudders_rad()[0].abs() < 1e-3);
}

/// A sensor 10 cm below the pivot of a drone that turns by hand at 0.5 rad/s feels the start of the
/// motion: the clamp reaches this rate within one step of 0.5 ms, 1000 rad/s2 or 100 m/s2 ahead.
/// Then the rate stays, and 0.025 m/s2 upwards remain.
#[test]
fn a_sensor_off_the_pivot_feels_how_the_drone_moves() {
    let mut environment =
        environment(BenchConfig { lever_m: [0.0, 0.0, 0.1], ..BenchConfig::default() });
    let felt = |environment: &Environment| {
        let mut level = environment.clone();
        level.vehicle.clamp([0.0; 2]);
        level.felt_on_drone(Ticks::ZERO)
    };
    environment.advance(Ticks::from_ms(100));
    near(felt(&environment).specific_force_m_s2, [0.0, 0.0, -9.81]);
    environment.tilt_clamp_to([0.4, 0.0]);
    environment.advance(Ticks::from_us(100_500));
    near(felt(&environment).specific_force_m_s2, [100.0, 0.0, -9.835]);
    environment.advance(Ticks::from_ms(200));
    near(felt(&environment).specific_force_m_s2, [0.0, 0.0, -9.835]);
}
