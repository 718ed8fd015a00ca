//! Running a scenario.

use std::cell::Cell;

use crate::free::State;
use crate::integrate::{Adaptive, IntegrationError};
use crate::linkage::Linkage;
use crate::mechanism::Mechanism;
use crate::pitch_loop::{COMMAND_LIMIT_RAD, Pd, PitchLoop};

use super::signal::Curve;
use super::{Between, Input, PulseServo, Row, Scenario, ScenarioError, Signal};

/// Sine of the transmission angle below which link and rudder arm lie so nearly in line that the
/// crank is at the end of its way: the forces in rigid bars would grow without bound.
const LEAST_TRANSMISSION: f64 = 0.02;

/// Precision of a motion with a stop, whose damping sets in with a jump: the error of a step across
/// the jump falls only in proportion to the step, so that the tolerance must leave it some length.
const AT_A_STOP: Adaptive = Adaptive { relative: 1e-9, absolute: 1e-10, max_step_s: 0.02 };

/// The rows of a run, or why there are none.
type Rows = Result<Vec<Row>, ScenarioError>;

/// What moves the crank at an instant.
enum Drive {
    /// A torque, in N m.
    Torque(f64),
    /// The acceleration that a servo gives it, in rad/s2.
    Acceleration(f64),
}

/// The drone under loads that change with time.
struct Loaded {
    mechanism: Mechanism,
    thrust: Option<Curve>,
    pitch_moment: Curve,
}

impl Loaded {
    /// The mechanism and the external pitch moment (N m) at a time (s).
    fn at(&self, time_s: f64) -> (Mechanism, f64) {
        let mechanism = match &self.thrust {
            None => self.mechanism.clone(),
            Some(thrust) => self.mechanism.with_thrust(thrust.value(time_s)),
        };
        (mechanism, self.pitch_moment.value(time_s))
    }

    fn knots(&self) -> impl Iterator<Item = f64> + '_ {
        self.thrust.iter().flat_map(Curve::knots).chain(self.pitch_moment.knots())
    }
}

impl Scenario {
    /// Runs and gives a row every `dt_s`, the start first.
    ///
    /// # Errors
    /// As [`Scenario::validate`], a motion that grows without bound, or a crank angle at which the
    /// linkage is open.
    pub fn run(&self) -> Result<Vec<Row>, ScenarioError> {
        self.validate()?;
        let mechanism =
            Mechanism::new(&self.setup.drone).map_err(ScenarioError::in_table("drone"))?;
        let zero = mechanism.linkage().zero_rudder_crank_rad();
        let loaded = Loaded {
            mechanism,
            thrust: self.loads.thrust_n.as_ref().map(load),
            pitch_moment: load(&self.loads.pitch_moment_n_m),
        };
        match &self.input {
            Input::TorqueNM(signal) => self.run_torque(&loaded, signal, 1.0),
            Input::VoltageV(signal) => {
                self.run_torque(&loaded, signal, self.setup.drone.motor_n_m_per_v)
            }
            Input::TorqueLaw(law) => self.run_free(&loaded, None, |_, x| {
                let crank = law.crank_kp * (x.crank_rad - zero) + law.crank_kd * x.crank_rate_rad_s;
                Drive::Torque(-law.kp * x.pitch_rad - law.kd * x.pitch_rate_rad_s - crank)
            }),
            Input::IdealServo(servo) => {
                let command = angle(&servo.command_rad);
                self.run_free(&loaded, Some(&command), |time, x| {
                    let law = zero + servo.kp * x.pitch_rad + servo.kd * x.pitch_rate_rad_s;
                    let error = law + command.value(time) - x.crank_rad;
                    let braking = servo.damping * x.crank_rate_rad_s;
                    Drive::Acceleration(servo.stiffness * error - braking)
                })
            }
            Input::CrankRad(signal) => self.run_prescribed(&loaded, &angle(signal)),
            Input::PulseServo(servo) => self.run_loop(&loaded.mechanism, servo),
        }
    }

    /// Times of the rows, in s.
    fn times(&self) -> Vec<f64> {
        let rows = (self.seconds / self.dt_s + 1e-9).floor() as usize;
        // A whole number of rows a second divides, so that 0.15 s is 0.15 and not a bit beside it.
        let rate = (1.0 / self.dt_s).round();
        let whole = rate >= 1.0 && (rate * self.dt_s - 1.0).abs() < 1e-15;
        (0..=rows).map(|i| i as f64).map(|i| if whole { i / rate } else { i * self.dt_s }).collect()
    }

    /// Free crank under a torque over time.
    fn run_torque(&self, loaded: &Loaded, signal: &Signal, factor: f64) -> Rows {
        let torque = load(signal);
        self.run_free(loaded, Some(&torque), |time, _| Drive::Torque(factor * torque.value(time)))
    }

    /// Integrates `[th0, th1, w0, v1]` under a drive that follows an input.
    fn run_free(
        &self,
        loaded: &Loaded,
        input: Option<&Curve>,
        drive: impl Fn(f64, &State) -> Drive,
    ) -> Rows {
        let linkage = *loaded.mechanism.linkage();
        let start = State {
            pitch_rad: self.start.pitch_rad,
            crank_rad: self.start.crank_rad.unwrap_or(linkage.zero_rudder_crank_rad()),
            pitch_rate_rad_s: self.start_rate(),
            crank_rate_rad_s: self.start.crank_rate_rad_s,
        };
        let hold = self.options.hold_pitch;
        let open = Cell::new(None);
        let slope = |time: f64, x: &[f64; 4]| {
            let state = State::from_array(*x);
            if state.crank_rad.is_finite() && !closes(&linkage, state.crank_rad) {
                open.set(Some((state.crank_rad, time)));
                return [f64::NAN; 4];
            }
            let (mechanism, moment) = loaded.at(time);
            let [pitch, crank] = match drive(time, &state) {
                Drive::Acceleration(crank) if hold => [0.0, crank],
                Drive::Acceleration(crank) => {
                    [mechanism.pitch_acceleration(&state, crank, moment), crank]
                }
                Drive::Torque(torque) => {
                    let torque = torque + self.stop_torque(&state);
                    if hold {
                        [0.0, mechanism.crank_acceleration_held(&state, torque)]
                    } else {
                        mechanism.accelerations_under(&state, torque, moment)
                    }
                }
            };
            [x[2], x[3], pitch, crank]
        };
        let times = self.times();
        let knots = input.into_iter().flat_map(Curve::knots).chain(loaded.knots());
        let precision = match self.options.crank_stop {
            None => Adaptive::default(),
            Some(_) => AT_A_STOP,
        };
        let states = precision.sample(slope, &times, knots, start.to_array());
        match (states, open.get()) {
            (Ok(states), _) => rows(&loaded.mechanism, &times, states),
            (Err(_), Some((crank_rad, time_s))) => Err(ScenarioError::Open { crank_rad, time_s }),
            (Err(error), None) => Err(error.into()),
        }
    }

    fn start_rate(&self) -> f64 {
        if self.options.hold_pitch { 0.0 } else { self.start.pitch_rate_rad_s }
    }

    /// What the stop, if there is one, does to the crank, in N m.
    fn stop_torque(&self, state: &State) -> f64 {
        let Some(stop) = self.options.crank_stop else {
            return 0.0;
        };
        let beyond = state.crank_rad.abs() - stop.angle_rad;
        if beyond <= 0.0 {
            return 0.0;
        }
        -stop.stiffness_n_m_rad * beyond.copysign(state.crank_rad)
            - stop.damping_n_m_s * state.crank_rate_rad_s
    }

    /// Prescribed crank: pitch and momentum are integrated.
    fn run_prescribed(&self, loaded: &Loaded, crank: &Curve) -> Rows {
        let times = self.times();
        let linkage = loaded.mechanism.linkage();
        for &time_s in &times {
            let crank_rad = crank.value(time_s);
            if !closes(linkage, crank_rad) {
                return Err(ScenarioError::Open { crank_rad, time_s });
            }
        }
        let hold = self.options.hold_pitch;
        let [angle, rate] = crank.at(0.0);
        let at = loaded.mechanism.configuration(angle);
        let start = [self.start.pitch_rad, at.m00 * self.start_rate() + at.m01 * rate];
        let slope = |time: f64, x: &[f64; 2]| {
            if hold {
                return [0.0, 0.0];
            }
            let [angle, rate] = crank.at(time);
            let (mechanism, moment) = loaded.at(time);
            let at = mechanism.configuration(angle);
            let w0 = (x[1] - at.m01 * rate) / at.m00;
            [w0, mechanism.pitch_load(&at, x[0], w0) + moment]
        };
        let knots = crank.knots().chain(loaded.knots());
        let states = Adaptive::default().sample(slope, &times, knots, start)?;
        let states = states
            .into_iter()
            .zip(&times)
            .map(|([pitch, momentum], &time)| {
                let [angle, rate] = crank.at(time);
                let at = loaded.mechanism.configuration(angle);
                let w0 = (momentum - at.m01 * rate) / at.m00;
                [pitch, angle, if hold { 0.0 } else { w0 }, rate]
            })
            .collect();
        rows(&loaded.mechanism, &times, states)
    }

    /// The pulse-driven loop.
    fn run_loop(&self, mechanism: &Mechanism, servo: &PulseServo) -> Rows {
        let timing = self.setup.timing;
        let command = angle(&servo.command_rad);
        let mut law = Pd::new(servo.kp, servo.kd, mechanism.linkage(), timing.control_s);
        let mut sim = PitchLoop::new(
            &self.setup.drone,
            self.setup.servo,
            timing,
            self.start.pitch_rad,
            self.start.pitch_rate_rad_s,
        )
        .map_err(ScenarioError::in_table("start"))?;
        let steps = (self.dt_s / timing.step_s).round() as usize;
        let times = self.times();
        let mut states = Vec::with_capacity(times.len());
        for i in 0..times.len() {
            for _ in 0..if i == 0 { 0 } else { steps } {
                sim.step(|m| {
                    let asked = law.update(m) + command.value(m.time_s);
                    asked.clamp(-COMMAND_LIMIT_RAD, COMMAND_LIMIT_RAD)
                });
            }
            let s = sim.sample();
            states.push([s.pitch_rad, s.crank.angle_rad, s.rate_rad_s, s.crank.rate_rad_s]);
        }
        rows(mechanism, &times, states)
    }
}

/// Whether the crank can stand at an angle (rad).
fn closes(linkage: &Linkage, crank_rad: f64) -> bool {
    // Where the bars do not meet, the transmission is not a number and the comparison is false.
    linkage.at(crank_rad).transmission() > LEAST_TRANSMISSION
}

/// A load over time: straight between points.
fn load(signal: &Signal) -> Curve {
    signal.curve(Between::Straight)
}

/// An angle over time: smooth between points.
fn angle(signal: &Signal) -> Curve {
    signal.curve(Between::Smooth)
}

/// Rows of `[th0, th1, w0, v1]`, link and rudder added.
fn rows(mechanism: &Mechanism, times: &[f64], states: Vec<[f64; 4]>) -> Rows {
    times
        .iter()
        .zip(states)
        .map(|(&t, [theta0, theta1, w0, w1])| {
            let at = mechanism.linkage().at(theta1);
            let row = Row {
                t,
                theta0,
                theta1,
                theta2: at.link_rad(),
                theta3: at.rudder_rad(),
                w0,
                w1,
                w2: at.link_ratio * w1,
                w3: at.rudder_ratio * w1,
            };
            if row.values().into_iter().all(f64::is_finite) {
                Ok(row)
            } else {
                Err(IntegrationError::Stuck { time_s: t }.into())
            }
        })
        .collect()
}

#[cfg(test)]
mod tests;
