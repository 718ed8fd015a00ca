//! Step responses of the ascent beside those of the two-axis model.

use crate::ascent::{Ascent, AscentParameters};
use crate::rocket::{Rocket, RocketParameters};
use nalgebra::{UnitQuaternion, Vector3};

use super::two_axes::{Attitude, STEP_S, fly};

/// How a step response under scheduled gains differs at most from that of `expected`, as a share of
/// the step, in 2 s from `start_s`.
fn worst_against(
    parameters: &AscentParameters,
    start_s: f64,
    axis: usize,
    expected: impl Fn(&Rocket, Attitude, &Law) -> Vec<f64>,
) -> f64 {
    let error = 2_f64.to_radians();
    let table = Rocket::new(&parameters.rocket).unwrap();
    let flight = table.at(start_s);
    let mut angle_rad = [0.0; 2];
    angle_rad[axis] = error;
    let first = Attitude { time_s: start_s, angle_rad, rate_rad_s: [0.0; 2] };
    let law = |attitude: &Attitude| {
        let gains = table.at(attitude.time_s).gains(3.0, 0.8);
        [0, 1].map(|i| gains.kp * attitude.angle_rad[i] + gains.kd * attitude.rate_rad_s[i])
    };
    let expected = expected(&table, first, &law);
    let mut ascent = Ascent::new(parameters, UnitQuaternion::identity()).unwrap();
    let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(angle_rad[1], angle_rad[0], 0.0));
    let position = [0.0, 0.0, -flight.altitude_m];
    let velocity = [0.0, 0.0, -flight.speed_m_s];
    ascent.release(start_s, position, velocity, attitude, [0.0; 3]);
    let mut command = [0.0; 2];
    let mut worst = 0.0_f64;
    for (i, expected) in expected.iter().enumerate() {
        worst = worst.max((ascent.tilt_rad()[axis] - expected).abs());
        assert!(ascent.tilt_rad()[1 - axis].abs() < 1e-9);
        if i % 10 == 0 {
            let [roll_rate, pitch_rate, _] = ascent.rates_rad_s();
            command = law(&Attitude {
                time_s: ascent.time_s().unwrap(),
                angle_rad: ascent.tilt_rad(),
                rate_rad_s: [pitch_rate, roll_rate],
            });
        }
        ascent.step(STEP_S, command);
    }
    worst / error
}

/// A law for gimbal commands, rad.
type Law<'a> = dyn Fn(&Attitude) -> [f64; 2] + 'a;

/// Along a vertical path.
fn without_drift(table: &Rocket, first: Attitude, law: &Law, axis: usize) -> Vec<f64> {
    let samples = fly(table, first, 2.0, |attitude, _| law(attitude));
    samples.iter().map(|(at, _)| at.angle_rad[axis]).collect()
}

/// The same with the speed sideways that the tilt brings, `y'' = (F - D) th / m + F delta / m + N
/// alpha / m` with `alpha = th - y' / V`; for small angles.
fn with_drift(table: &Rocket, first: Attitude, law: &Law, axis: usize) -> Vec<f64> {
    let p = &table.parameters;
    let (mut now, mut gimbal, mut aside) = (first, 0.0, 0.0);
    let mut command = 0.0;
    let mut angles = Vec::new();
    for i in 0..=2000 {
        angles.push(now.angle_rad[axis]);
        let flight = table.at(now.time_s);
        if i % 10 == 0 {
            command = law(&now)[axis];
        }
        let lag = 1.0 - (-std::f64::consts::TAU * p.gimbal_hz * STEP_S).exp();
        let most = p.gimbal_rate_rad_s * STEP_S;
        gimbal += ((command - gimbal) * lag).clamp(-most, most);
        let angle = now.angle_rad[axis];
        let attack = angle - aside / flight.speed_m_s;
        let pressed = flight.pressure_pa * std::f64::consts::FRAC_PI_4 * p.diameter_m.powi(2);
        let push = (p.thrust_n - pressed * p.drag) * angle
            + p.thrust_n * gimbal
            + pressed * p.normal_force_slope * attack;
        aside += push / flight.mass.mass_kg * STEP_S;
        let turning = -flight.mu_c * gimbal - flight.mu_a * attack;
        now.rate_rad_s[axis] += turning * STEP_S;
        now.angle_rad[axis] += now.rate_rad_s[axis] * STEP_S;
        now.time_s = first.time_s + f64::from(i + 1) * STEP_S;
    }
    angles
}

/// Without a normal force the path does not matter, and the two-axis model is followed closely;
/// with one, it is but for the drift, which it leaves out.
#[test]
fn a_small_motion_is_that_of_the_two_axis_model_but_for_the_drift() {
    let no_normal_force = AscentParameters::of(RocketParameters {
        normal_force_slope: 0.0,
        ..RocketParameters::SPICA
    });
    for axis in [0, 1] {
        for start_s in [1.0, 20.0, 37.0, 75.0] {
            let worst = worst_against(&no_normal_force, start_s, axis, |table, first, law| {
                without_drift(table, first, law, axis)
            });
            assert!(worst < 2e-3, "{start_s}: {worst}");
        }
        for parameters in [AscentParameters::SPICA, AscentParameters::SPICA_UNSTABLE] {
            for start_s in [20.0, 37.0, 75.0] {
                let drifting = worst_against(&parameters, start_s, axis, |table, first, law| {
                    with_drift(table, first, law, axis)
                });
                let straight = worst_against(&parameters, start_s, axis, |table, first, law| {
                    without_drift(table, first, law, axis)
                });
                assert!(drifting < 2e-3, "{start_s}: {drifting}");
                assert!(straight < 0.06, "{start_s}: {straight}");
            }
        }
    }
}
