//! The drone's controller (`tvc-pid`) on the two axes of the rocket that the drone stands for, with
//! gains that follow the burn.

use tvc_pid::{Config, Controller, Gains, Law as _, Pid, Schedule};

use super::two_axes;
use crate::StepResponse;
use crate::rocket::{Rocket, RocketParameters};

/// Natural frequency (rad/s) and damping that the gains are to give.
const NATURAL_RAD_S: f64 = 3.0;
const DAMPING: f64 = 0.8;
/// Times of the schedule, in s, and of the steps.
const TABLE_S: [f64; 10] = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0];
const STEPS_S: [f64; 5] = [0.0, 20.0, 37.0, 60.0, 84.0];
/// Errors of pitch and yaw at a step, in rad: unequal, so that the axes can be told apart.
const ERRORS_RAD: [f64; 2] =
    [5.0 * std::f64::consts::PI / 180.0, -3.0 * std::f64::consts::PI / 180.0];
/// Length of a step response, in s.
const SECONDS: f64 = 4.0;
/// Period of the controller, in s.
const PERIOD_S: f32 = 0.01;

/// The controller's configuration at a time of the burn (s).
fn config(rocket: &Rocket, time_s: f64) -> Config {
    let gains = rocket.at(time_s).gains(NATURAL_RAD_S, DAMPING);
    let limit = rocket.parameters.gimbal_limit_rad as f32;
    Config {
        gains: Gains { kp: gains.kp as f32, ki: 0.0, kd: gains.kd as f32 },
        limit: -limit..=limit,
        ..Config::new(PERIOD_S)
    }
}

/// Responses of pitch and yaw to a step at a time of the burn (s), with the schedule or with the
/// gains of lift-off.
fn step(rocket: &Rocket, time_s: f64, scheduled: bool) -> [StepResponse; 2] {
    let table = TABLE_S.map(|at| (at as f32, config(rocket, at)));
    let schedule = Schedule::<f32, 10>::new(table).unwrap();
    let lift_off = config(rocket, 0.0);
    let pid = Controller::<f32, Pid<f32>>::new(&lift_off).unwrap();
    let mut axes = [pid.clone(), pid];
    let start = two_axes::Attitude { time_s, angle_rad: ERRORS_RAD, rate_rad_s: [0.0; 2] };
    let samples = two_axes::fly(rocket, start, SECONDS, |attitude, _| {
        if let (true, Some(coefficients)) = (scheduled, schedule.at(attitude.time_s as f32)) {
            for pid in &mut axes {
                pid.law.set_gains(&coefficients);
            }
        }
        // A positive gimbal angle turns the rocket the other way.
        [0, 1].map(|axis| {
            let (angle, rate) = (attitude.angle_rad[axis], attitude.rate_rad_s[axis]);
            -f64::from(axes[axis].update(0.0, angle as f32, rate as f32))
        })
    });
    [0, 1].map(|axis| {
        let trace = samples.iter().map(|(attitude, _)| attitude);
        let trace = trace.map(|at| (at.time_s, at.angle_rad[axis]));
        StepResponse::new(trace, 0.0).unwrap()
    })
}

#[test]
fn the_schedule_keeps_the_response_through_the_burn() {
    for (parameters, most_pct) in
        [(RocketParameters::SPICA, 1.25), (RocketParameters::SPICA_UNSTABLE, 1.7)]
    {
        let rocket = Rocket::new(&parameters).unwrap();
        for time_s in STEPS_S {
            // Pitch and yaw, from errors of unlike size and sign, respond alike.
            for response in step(&rocket, time_s, true) {
                assert!(response.overshoot_pct() < most_pct, "{time_s} s");
                let settling_s = response.settling_s(0.05).unwrap();
                assert!((settling_s - 1.11).abs() < 0.04, "{time_s} s: {settling_s} s");
            }
        }
        // The gains of lift-off are not good for the whole burn.
        let of_lift_off = STEPS_S.map(|time_s| {
            let [pitch, _] = step(&rocket, time_s, false);
            pitch.settling_s(0.05).unwrap_or(f64::INFINITY)
        });
        assert!(of_lift_off.into_iter().fold(0.0, f64::max) > 1.3, "{of_lift_off:?}");
    }
}

/// 100 kN from 2600 kg in 90 s are more than oxygen and ethanol give, and a vertical run on them
/// does not end where the thesis says.
#[test]
fn the_stated_figures_do_not_fit_one_another() {
    let rocket = Rocket::new(&RocketParameters::SPICA).unwrap();
    let stated = rocket.parameters;
    let weight_n = stated.propellant_kg * 9.81;
    let implied_impulse_s = stated.thrust_n * stated.burn_s / weight_n;
    assert!((implied_impulse_s - 353.0).abs() < 0.5);
    assert!((250.0 * weight_n / stated.thrust_n - 64.0).abs() < 0.5);
    let end = rocket.at(stated.burn_s);
    assert!((end.mu_c - 30.9).abs() < 0.05 && (end.mass.mass_kg - 1400.0).abs() < 0.5);
    assert!((end.speed_m_s - 2533.0).abs() < 5.0 && (end.altitude_m - 84e3).abs() < 500.0);
    assert!((rocket.at(32.0).pressure_pa - 57e3).abs() < 500.0);
    // The speed of sound, 335 m/s, is stated to be passed at 20 s.
    let (before, after) = (rocket.at(20.5).speed_m_s, rocket.at(21.5).speed_m_s);
    assert!((before..after).contains(&335.0));
}
