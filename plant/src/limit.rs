//! The time-optimal limit: how fast any controller could bring the drone upright.
//!
//! The crank is limited in rate and angle, without delay and lag. Then the fastest way to rest is
//! bang-bang in the crank's rate: away with full rate (and wait at the limit), back with full rate
//! to the other side, and home. Three arcs, two unknown switching times, found by nested root
//! search on the nonlinear model so that pitch and rate vanish together when the crank comes home.

use crate::drone::{Crank, Drone};
use crate::parameters::{ParameterError, Parameters, finite, named, positive};
use crate::response::{ResponseError, StepResponse};
use crate::root;

/// Step of the trajectories that are searched, in s; arcs end on their own times.
const SEARCH_STEP_S: f64 = 4e-3;
/// Step of the trajectory that is reported, in s.
const REPORT_STEP_S: f64 = 0.5e-3;
/// Longest arc tried, in s.
const LONGEST_ARC_S: f64 = 5.0;
/// Arc with which a search begins, in s.
const SHORT_ARC_S: f64 = 0.1;
/// Tolerance of the switching times, in s.
const TOLERANCE_S: f64 = 1e-11;

/// What the actuator can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuator {
    /// Largest crank rate, in rad/s.
    pub rate_rad_s: f64,
    /// Largest crank angle either side, in rad.
    pub limit_rad: f64,
}

/// The fastest way to rest.
#[derive(Clone, Debug)]
pub struct Limit {
    /// Time to rest, in s.
    pub to_rest_s: f64,
    /// The trajectory, with the drone at rest at its end.
    pub response: StepResponse,
    /// Samples `(time_s, pitch_rad, crank_rad)` of the trajectory.
    pub trajectory: Vec<[f64; 3]>,
}

/// Why there is no limit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LimitError {
    /// A parameter or start is out of range.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The drone already is where it should go.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// The rudder cannot bring the drone to rest with three arcs.
    #[error("the rudder cannot bring the drone to rest from there")]
    OutOfReach,
}

/// The fastest way from a pitch and rate, crank at zero rudder, to rest at `goal_rad`.
///
/// A goal other than zero serves a band: aiming at its far edge enters it soonest.
///
/// # Errors
/// See [`LimitError`].
pub fn time_optimal(
    parameters: &Parameters,
    actuator: Actuator,
    pitch_rad: f64,
    rate_rad_s: f64,
    goal_rad: f64,
) -> Result<Limit, LimitError> {
    positive(&named!(actuator; rate_rad_s, limit_rad))?;
    finite(&named!(pitch_rad, rate_rad_s, goal_rad))?;
    let start = Drone::new(parameters, pitch_rad, rate_rad_s)?.with_tether_stop(f64::INFINITY);
    let chase = Chase {
        home_rad: start.crank().angle_rad,
        side: (pitch_rad - goal_rad).signum(),
        start,
        actuator,
    };
    // The longer the push, the farther the drone ends on the other side; after too long a push no
    // braking brings it to rest.
    let miss = |first: f64| {
        chase.second_arc(first).map_or(-1.0, |second| {
            let end = chase.fly([first, second], SEARCH_STEP_S, |_| ());
            chase.side * (end.pitch_rad() - goal_rad)
        })
    };
    let first = bracketed(miss).ok_or(LimitError::OutOfReach)?;
    let second = chase.second_arc(first).ok_or(LimitError::OutOfReach)?;
    if miss(first).abs() > 1e-6 {
        return Err(LimitError::OutOfReach);
    }
    let mut trajectory = vec![[0.0, pitch_rad, chase.home_rad]];
    let mut now = 0.0;
    chase.fly([first, second], REPORT_STEP_S, |(dt, drone)| {
        now += dt;
        trajectory.push([now, drone.pitch_rad(), drone.crank().angle_rad]);
    });
    // The crank rests at home, and so the drone, a little longer: settling needs a tail.
    trajectory.push([now + REPORT_STEP_S, goal_rad, chase.home_rad]);
    let response = StepResponse::new(trajectory.iter().map(|s| (s[0], s[1])), 0.0)?;
    Ok(Limit { to_rest_s: now, response, trajectory })
}

/// The root of a monotonic function of an arc's duration: the bracket grows from a short arc, so
/// that long arcs, which tumble the drone, are tried only where they are needed.
fn bracketed(mut f: impl FnMut(f64) -> f64) -> Option<f64> {
    let mut high = SHORT_ARC_S;
    let sign = f(0.0).signum();
    while f(high).signum() == sign {
        high *= 1.5;
        if high > LONGEST_ARC_S {
            return None;
        }
    }
    root::between(f, 0.0, high, TOLERANCE_S)
}

struct Chase {
    start: Drone,
    home_rad: f64,
    side: f64,
    actuator: Actuator,
}

impl Chase {
    /// The second arc that leaves no rate when the crank comes home after the given first arc.
    fn second_arc(&self, first: f64) -> Option<f64> {
        // The longer it brakes, the more the rate turns towards the start's side.
        let rate_left = |second: f64| {
            let end = self.fly([first, second], SEARCH_STEP_S, |_| ());
            self.side * end.rate_rad_s()
        };
        // A push that has not turned the drone round needs no braking.
        if rate_left(0.0) >= 0.0 {
            return Some(0.0);
        }
        bracketed(rate_left)
    }

    /// Flies two arcs and home; `watch` gets every step and the drone after it.
    fn fly(
        &self,
        [first, second]: [f64; 2],
        step_s: f64,
        mut watch: impl FnMut((f64, &Drone)),
    ) -> Drone {
        let mut drone = self.start.clone();
        let limit = self.actuator.limit_rad;
        self.arc(&mut drone, self.side * limit, first, step_s, &mut watch);
        self.arc(&mut drone, -self.side * limit, second, step_s, &mut watch);
        let way = (self.home_rad - drone.crank().angle_rad).abs();
        self.arc(&mut drone, self.home_rad, way / self.actuator.rate_rad_s, step_s, &mut watch);
        drone.step(1e-9, Crank::at_rest(self.home_rad));
        drone
    }

    /// Turns the crank towards an angle for a time, and waits there for what is left of it.
    fn arc(
        &self,
        drone: &mut Drone,
        towards_rad: f64,
        seconds: f64,
        step_s: f64,
        watch: &mut impl FnMut((f64, &Drone)),
    ) {
        let from = drone.crank().angle_rad;
        let rate = self.actuator.rate_rad_s * (towards_rad - from).signum();
        let moving = if rate == 0.0 { 0.0 } else { ((towards_rad - from) / rate).min(seconds) };
        for (duration, rate_rad_s) in [(moving, rate), (seconds - moving, 0.0)] {
            let steps = (duration / step_s).ceil();
            let start = drone.crank().angle_rad;
            for i in 1..=steps as u32 {
                let dt = duration / steps;
                let angle_rad = start + rate_rad_s * dt * f64::from(i);
                drone.step(dt, Crank::new(angle_rad, rate_rad_s));
                watch((dt, drone));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOW: Actuator = Actuator { rate_rad_s: 5.51, limit_rad: std::f64::consts::FRAC_PI_3 };
    const FAST: Actuator = Actuator { rate_rad_s: 8.73, ..SLOW };

    /// The soonest that any controller can be within `band` (a share of the start) for good: it
    /// aims at rest on the band's far edge. In s.
    fn soonest_settling_s(
        parameters: &Parameters,
        actuator: Actuator,
        pitch_rad: f64,
        rate_rad_s: f64,
        band: f64,
    ) -> Result<f64, LimitError> {
        let edge = -band * pitch_rad;
        let limit = time_optimal(parameters, actuator, pitch_rad, rate_rad_s, edge)?;
        // The last sample lies on the edge itself; rounding must not put it outside.
        limit.response.settling_s(band * (1.0 + 1e-6)).ok_or(LimitError::OutOfReach)
    }

    /// Time to rest with an infinitely fast rudder that gives these accelerations (rad/s2, sizes)
    /// while pushing back and while braking, in s.
    fn instant_rudder_s(push: f64, brake: f64, pitch_rad: f64, rate_rad_s: f64) -> f64 {
        let (pitch, rate) = (pitch_rad.abs(), rate_rad_s * pitch_rad.signum());
        let peak = ((pitch + rate * rate / (2.0 * push)) / (0.5 / push + 0.5 / brake)).sqrt();
        (rate + peak) / push + peak / brake
    }

    /// Pitch accelerations (sizes, in rad/s2) with the crank held at `+limit` and `-limit`,
    /// upright.
    fn authority(parameters: &Parameters, limit_rad: f64) -> Result<(f64, f64), ParameterError> {
        let mut drone = Drone::new(parameters, 0.0, 0.0)?;
        let mut at = |crank: f64| {
            drone.place_crank(crank);
            drone.acceleration_rad_s2(0.0).abs()
        };
        Ok((at(limit_rad), at(-limit_rad)))
    }

    /// Reference: to rest, within 2 % and 5 %, in s.
    #[test]
    fn limits_of_both_servos() {
        for (actuator, pitch, expected) in [
            (SLOW, 0.2, [0.349, 0.316, 0.294]),
            (SLOW, 0.4, [0.428, 0.386, 0.360]),
            (SLOW, 0.8, [0.532, 0.480, 0.449]),
            (FAST, 0.2, [0.301, 0.275, 0.256]),
            (FAST, 0.4, [0.374, 0.338, 0.315]),
            (FAST, 0.8, [0.471, 0.425, 0.397]),
        ] {
            let limit = time_optimal(&Parameters::PHYS, actuator, pitch, 0.2, 0.0).unwrap();
            let found = [
                limit.to_rest_s,
                limit.response.settling_s(0.02).unwrap(),
                limit.response.settling_s(0.05).unwrap(),
            ];
            // Reference: 2 % and 5 % to the last digit; its times to rest stop a little early,
            // before the crank is home, so that they bound ours from below.
            assert!((found[1] - expected[1]).abs() < 6e-4, "{found:?} {expected:?}");
            assert!((found[2] - expected[2]).abs() < 6e-4, "{found:?} {expected:?}");
            assert!((0.0..0.024).contains(&(found[0] - expected[0])), "{found:?} {expected:?}");
        }
    }

    /// Flown again step by step, the arcs end upright, at rest, with the crank at home.
    #[test]
    fn the_arcs_end_at_rest_from_either_side() {
        for (pitch, rate) in [(0.4, 0.2), (-0.4, -0.2), (0.1, 0.0)] {
            let limit = time_optimal(&Parameters::PHYS, SLOW, pitch, rate, 0.0).unwrap();
            let mut drone = Drone::new(&Parameters::PHYS, pitch, rate).unwrap();
            let mut last = 0.0;
            for [time, _, crank] in limit.trajectory.into_iter().skip(1) {
                let rate_rad_s = (crank - drone.crank().angle_rad) / (time - last);
                drone.step(time - last, Crank::new(crank, rate_rad_s));
                last = time;
            }
            assert!(drone.pitch_rad().abs() < 2e-5, "{}", drone.pitch_rad());
            assert!(drone.rate_rad_s().abs() < 1e-3, "{}", drone.rate_rad_s());
        }
    }

    #[test]
    fn the_far_edge_of_the_band_is_reached_sooner() {
        for (pitch, expected) in [(0.2, 0.279), (0.4, 0.341), (0.8, 0.425)] {
            let soonest = soonest_settling_s(&Parameters::PHYS, SLOW, pitch, 0.2, 0.05).unwrap();
            assert!((soonest - expected).abs() < 2.5e-3, "{soonest}");
        }
    }

    #[test]
    fn an_infinitely_fast_rudder() {
        let (push, brake) = authority(&Parameters::PHYS, SLOW.limit_rad).unwrap();
        assert!((push - 23.3).abs() < 0.05 && (brake - 25.4).abs() < 0.05);
        for (pitch, expected) in [(0.2, 0.190), (0.4, 0.265), (0.8, 0.372)] {
            assert!((instant_rudder_s(push, brake, pitch, 0.2) - expected).abs() < 6e-4);
        }
    }

    #[test]
    fn what_cannot_be_reached_is_refused() {
        let weak = Parameters { thrust_n: 0.0, ..Parameters::PHYS };
        let error = time_optimal(&weak, SLOW, 0.4, 0.2, 0.0).unwrap_err();
        assert_eq!(error, LimitError::OutOfReach);
        let error = time_optimal(&Parameters::PHYS, SLOW, f64::NAN, 0.2, 0.0).unwrap_err();
        assert!(error.to_string().contains("pitch_rad"));
    }
}
