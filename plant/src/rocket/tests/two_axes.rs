//! Pitch and yaw of the rocket along a vertical path: `th'' = -mu_c delta - mu_a th`.

use crate::StepResponse;
use crate::integrate::rk4_step;
use crate::rocket::{Flight, Gains, Rocket, RocketParameters};

/// Step of the attitude, in s, and of the control law in these.
pub(super) const STEP_S: f64 = 1e-3;
const CONTROL_STEPS: u64 = 10;

/// Attitude of both axes as a law gets it.
#[derive(Clone, Copy)]
pub(super) struct Attitude {
    /// Time since ignition, in s.
    pub(super) time_s: f64,
    /// Pitch and yaw, in rad.
    pub(super) angle_rad: [f64; 2],
    /// Their rates, in rad/s.
    pub(super) rate_rad_s: [f64; 2],
}

/// Attitudes and gimbal angles (rad) of a flight from `start` for `seconds`, the law giving gimbal
/// commands (rad).
pub(super) fn fly(
    rocket: &Rocket,
    start: Attitude,
    seconds: f64,
    mut law: impl FnMut(&Attitude, &Flight) -> [f64; 2],
) -> Vec<(Attitude, [f64; 2])> {
    let p = &rocket.parameters;
    let (mut now, mut gimbal, mut command) = (start, [0.0; 2], [0.0; 2]);
    let mut samples = vec![(now, gimbal)];
    // The lag over one step, exactly.
    let approach = 1.0 - (-std::f64::consts::TAU * p.gimbal_hz * STEP_S).exp();
    let most = p.gimbal_rate_rad_s * STEP_S;
    for i in 0..(seconds / STEP_S).round() as u64 {
        let flight = rocket.at(now.time_s);
        if i % CONTROL_STEPS == 0 {
            let limit = p.gimbal_limit_rad;
            command = law(&now, &flight).map(|c| c.clamp(-limit, limit));
        }
        for axis in [0, 1] {
            gimbal[axis] += ((command[axis] - gimbal[axis]) * approach).clamp(-most, most);
            let turned = -flight.mu_c * gimbal[axis];
            let slope = |_: f64, x: &[f64; 2]| [x[1], turned - flight.mu_a * x[0]];
            let state = [now.angle_rad[axis], now.rate_rad_s[axis]];
            [now.angle_rad[axis], now.rate_rad_s[axis]] = rk4_step(slope, 0.0, &state, STEP_S);
        }
        now.time_s = start.time_s + (i + 1) as f64 * STEP_S;
        samples.push((now, gimbal));
    }
    samples
}

/// The gimbal's command by gains on angle and rate.
fn command(gains: Gains, attitude: &Attitude) -> [f64; 2] {
    [0, 1].map(|i| gains.kp * attitude.angle_rad[i] + gains.kd * attitude.rate_rad_s[i])
}

/// The response of one axis to an error (rad) at a time of the burn, for 4 s, with gains that may
/// change with the flight.
fn respond(
    rocket: &Rocket,
    time_s: f64,
    error_rad: f64,
    gains: impl Fn(&Flight) -> Gains,
) -> StepResponse {
    let start = Attitude { time_s, angle_rad: [error_rad, 0.0], rate_rad_s: [0.0; 2] };
    let samples = fly(rocket, start, 4.0, |at, flight| command(gains(flight), at));
    let trace = samples.iter().map(|(at, _)| (at.time_s, at.angle_rad[0]));
    StepResponse::new(trace, 0.0).unwrap()
}

/// The schedule keeps the response through the burn; the gains of lift-off do not.
#[test]
fn responses_through_the_burn() {
    let error = 5_f64.to_radians();
    let spica = Rocket::new(&RocketParameters::SPICA).unwrap();
    let unstable = Rocket::new(&RocketParameters::SPICA_UNSTABLE).unwrap();
    let fixed = spica.at(0.0).gains(3.0, 0.8);
    let mut fixed_settling = Vec::new();
    let mut fixed_overshoot = 0.0_f64;
    for time in [0.0, 20.0, 37.0, 60.0, 84.0] {
        let response = respond(&spica, time, error, |f| f.gains(3.0, 0.8));
        let settling = response.settling_s(0.05).unwrap();
        assert!(response.overshoot_pct() <= 1.2, "{time}");
        assert!((1.09..1.155).contains(&settling), "{time}: {settling}");
        let response = respond(&unstable, time, error, |f| f.gains(3.0, 0.8));
        let settling = response.settling_s(0.05).unwrap();
        assert!((1.09..1.155).contains(&settling), "{time}: {settling}");
        let response = respond(&spica, time, error, |_| fixed);
        fixed_settling.push(response.settling_s(0.05).unwrap());
        fixed_overshoot = fixed_overshoot.max(response.overshoot_pct());
    }
    fixed_settling.sort_by(f64::total_cmp);
    let (least, most) = (fixed_settling[0], fixed_settling[4]);
    assert!((fixed_overshoot - 8.5).abs() < 0.1, "{fixed_overshoot}");
    assert!((least - 0.88).abs() < 0.01, "{least}");
    assert!((most - 1.37).abs() < 0.01, "{most}");
}

/// Both axes are the same and do not mix; the gimbal keeps its limits.
#[test]
fn axes_are_independent_and_limited() {
    let start = Attitude { time_s: 10.0, angle_rad: [0.3, -0.3], rate_rad_s: [0.0; 2] };
    let p = RocketParameters::SPICA;
    let rocket = Rocket::new(&p).unwrap();
    let samples = fly(&rocket, start, 3.0, |at, f| command(f.gains(3.0, 0.8), at));
    for pair in samples.windows(2) {
        let ((_, [before, _]), (now, [after, _])) = (&pair[0], &pair[1]);
        let [pitch, yaw] = now.angle_rad;
        assert!((pitch + yaw).abs() < 1e-12);
        assert!((after - before).abs() <= p.gimbal_rate_rad_s * STEP_S * (1.0 + 1e-9));
        assert!(after.abs() <= p.gimbal_limit_rad);
    }
    let turned = samples.iter().map(|(_, [pitch, _])| *pitch);
    assert!(turned.fold(0.0, f64::max) > 0.9 * p.gimbal_limit_rad);
}
