//! Running a scenario.

use crate::drone::Crank;
use crate::free::State;
use crate::integrate::{Adaptive, IntegrationError};
use crate::mechanism::Mechanism;
use crate::pitch_loop::{Pd, PitchLoop};

use super::{Input, Row, Scenario, ScenarioError, Signal};

impl Scenario {
    /// Runs and gives a row every `dt_s`, the start first.
    ///
    /// # Errors
    /// As [`Scenario::validate`], or a motion that runs away.
    pub fn run(&self) -> Result<Vec<Row>, ScenarioError> {
        self.validate()?;
        let mechanism = Mechanism::new(&self.setup.drone)?;
        let rows = (self.seconds / self.dt_s + 1e-9).floor() as usize;
        let times: Vec<f64> = (0..=rows).map(|i| i as f64 * self.dt_s).collect();
        match &self.input {
            Input::PulseServo { kp, kd } => self.run_loop(&mechanism, *kp, *kd, rows),
            Input::CrankRad(signal) => self.run_prescribed(&mechanism, signal, &times),
            Input::TorqueNM(signal) => self.run_free(&mechanism, signal, 1.0, &times),
            Input::VoltageV(signal) => {
                let factor = self.setup.drone.motor_n_m_per_v;
                self.run_free(&mechanism, signal, factor, &times)
            }
            Input::IdealServo {
                kp,
                kd,
                stiffness,
                damping,
            } => {
                let zero = mechanism.linkage().zero_rudder_crank_rad();
                self.integrate(&mechanism, &times, &[], |_, state| {
                    let command = zero + kp * state.pitch_rad + kd * state.pitch_rate_rad_s;
                    let crank =
                        stiffness * (command - state.crank_rad) - damping * state.crank_rate_rad_s;
                    [mechanism.pitch_acceleration(state, crank), crank]
                })
            }
        }
    }

    /// Free crank under a torque.
    fn run_free(
        &self,
        mechanism: &Mechanism,
        signal: &Signal,
        factor: f64,
        times: &[f64],
    ) -> Result<Vec<Row>, ScenarioError> {
        self.integrate(mechanism, times, signal.knots(), |time, state| {
            let mut torque = factor * signal.straight(time);
            if let Some(stop) = self.options.crank_stop {
                let beyond = state.crank_rad.abs() - stop.angle_rad;
                if beyond > 0.0 {
                    torque -= stop.stiffness_n_m_rad * beyond.copysign(state.crank_rad)
                        + stop.damping_n_m_s * state.crank_rate_rad_s;
                }
            }
            if self.options.hold_pitch {
                [0.0, mechanism.crank_acceleration_held(state, torque)]
            } else {
                mechanism.accelerations(state, torque)
            }
        })
    }

    /// Integrates `[th0, th1, w0, v1]`, stopping at the knots of the input.
    fn integrate(
        &self,
        mechanism: &Mechanism,
        times: &[f64],
        knots: &[[f64; 2]],
        accelerations: impl Fn(f64, &State) -> [f64; 2],
    ) -> Result<Vec<Row>, ScenarioError> {
        let zero = mechanism.linkage().zero_rudder_crank_rad();
        let hold = self.options.hold_pitch;
        let start = State {
            pitch_rad: self.start.pitch_rad,
            crank_rad: self.start.crank_rad.unwrap_or(zero),
            pitch_rate_rad_s: if hold {
                0.0
            } else {
                self.start.pitch_rate_rad_s
            },
            crank_rate_rad_s: self.start.crank_rate_rad_s,
        };
        let slope = |time: f64, x: &[f64; 4]| {
            let [pitch, crank] = accelerations(time, &State::from_array(*x));
            [x[2], x[3], if hold { 0.0 } else { pitch }, crank]
        };
        let states = sample_with_knots(slope, times, knots, start.to_array())?;
        Ok(rows(mechanism, times, states))
    }

    /// Prescribed crank: pitch and momentum are integrated.
    fn run_prescribed(
        &self,
        mechanism: &Mechanism,
        signal: &Signal,
        times: &[f64],
    ) -> Result<Vec<Row>, ScenarioError> {
        let rate = |momentum: f64, crank: Crank| {
            let at = mechanism.configuration(crank.angle_rad);
            ((momentum - at.m01 * crank.rate_rad_s) / at.m00, at)
        };
        let first = signal.smooth(0.0);
        let (_, at) = rate(0.0, first);
        let momentum = at.m00 * self.start.pitch_rate_rad_s + at.m01 * first.rate_rad_s;
        let start = [self.start.pitch_rad, momentum];
        let hold = self.options.hold_pitch;
        let slope = |time: f64, x: &[f64; 2]| {
            if hold {
                return [0.0, 0.0];
            }
            let (w0, at) = rate(x[1], signal.smooth(time));
            [w0, mechanism.pitch_load(&at, x[0], w0)]
        };
        let states = sample_with_knots(slope, times, signal.knots(), start)?;
        let states: Vec<[f64; 4]> = states
            .into_iter()
            .zip(times)
            .map(|(x, &time)| {
                let crank = signal.smooth(time);
                let w0 = if hold { 0.0 } else { rate(x[1], crank).0 };
                [x[0], crank.angle_rad, w0, crank.rate_rad_s]
            })
            .collect();
        Ok(rows(mechanism, times, states))
    }

    /// The pulse-driven loop.
    fn run_loop(
        &self,
        mechanism: &Mechanism,
        kp: f64,
        kd: f64,
        count: usize,
    ) -> Result<Vec<Row>, ScenarioError> {
        let timing = self.setup.timing;
        let mut law = Pd::new(kp, kd, mechanism.linkage(), timing.control_s);
        let mut sim = PitchLoop::new(
            &self.setup.drone,
            self.setup.servo,
            timing,
            self.start.pitch_rad,
            self.start.pitch_rate_rad_s,
        )?;
        let steps = (self.dt_s / timing.step_s).round() as usize;
        let mut states = Vec::with_capacity(count + 1);
        let mut times = Vec::with_capacity(count + 1);
        for i in 0..=count {
            if i > 0 {
                for _ in 0..steps {
                    sim.step(|m| law.update(m));
                }
            }
            let s = sim.sample();
            times.push(s.time_s);
            states.push([
                s.pitch_rad,
                s.crank.angle_rad,
                s.rate_rad_s,
                s.crank.rate_rad_s,
            ]);
        }
        Ok(rows(mechanism, &times, states))
    }
}

/// Integrates to every time of `times`, ending a step on each knot in between, so that no step
/// straddles a kink of the input.
fn sample_with_knots<const N: usize>(
    mut slope: impl FnMut(f64, &[f64; N]) -> [f64; N],
    times: &[f64],
    knots: &[[f64; 2]],
    start: [f64; N],
) -> Result<Vec<[f64; N]>, IntegrationError> {
    let adaptive = Adaptive::default();
    let mut step = 1e-4;
    let mut state = start;
    let first = times[0];
    let mut now = first;
    let mut knots = knots
        .iter()
        .map(|knot| knot[0])
        .filter(|time| *time > first)
        .peekable();
    let mut states = Vec::with_capacity(times.len());
    for &time in times {
        while let Some(knot) = knots.next_if(|knot| *knot < time) {
            state = adaptive.advance(&mut slope, now, knot, state, &mut step)?;
            now = knot;
        }
        state = adaptive.advance(&mut slope, now, time, state, &mut step)?;
        now = time;
        states.push(state);
    }
    Ok(states)
}

/// Rows of `[th0, th1, w0, v1]`, link and rudder added.
fn rows(mechanism: &Mechanism, times: &[f64], states: Vec<[f64; 4]>) -> Vec<Row> {
    times
        .iter()
        .zip(states)
        .map(|(&t, [theta0, theta1, w0, w1])| {
            let at = mechanism.linkage().at(theta1);
            Row {
                t,
                theta0,
                theta1,
                theta2: at.link_rad,
                theta3: at.rudder_rad,
                w0,
                w1,
                w2: at.link_ratio * w1,
                w3: at.rudder_ratio * w1,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(text: &str) -> Vec<Row> {
        Scenario::parse(text).unwrap().run().unwrap()
    }

    fn last(rows: &[Row]) -> &Row {
        rows.last().unwrap()
    }

    /// Thesis figure 5.11: no forces, no motion.
    #[test]
    fn zero_force_is_no_motion() {
        let rows = run("seconds = 3.0\n[drone]\nthrust_n = 0\ngravity_m_s2 = 0\n\
                        [start]\npitch_rad = 0.3\ncrank_rad = 0.1");
        assert_eq!(rows.len(), 601);
        assert!(
            rows.iter()
                .all(|r| r.theta0 == 0.3 && r.theta1 == 0.1 && r.w0 == 0.0)
        );
    }

    /// Thesis figure 5.12 shows an unbounded fall. With gravity that turns with the drone it is a
    /// still drone, a pendulum, or a fall, depending on where the centre of mass is.
    #[test]
    fn gravity_only_is_what_the_centre_of_mass_makes_it() {
        let gravity_only = |drone: &str, pitch: f64| {
            run(&format!(
                "seconds = 5.0\n[drone]\nthrust_n = 0\n{drone}\n[start]\npitch_rad = {pitch}"
            ))
        };
        let balanced = gravity_only("", 0.1);
        assert!((last(&balanced).theta0 - 0.096).abs() < 1e-3);
        let pendulum = gravity_only("body_cm_m = [0, 0]", 0.2);
        let lowest = pendulum.iter().map(|r| r.theta0).fold(f64::MAX, f64::min);
        assert!((lowest + 0.205).abs() < 2e-3, "{lowest}");
        let above = gravity_only("body_cm_m = [-9.92e-5, 0.0625]", 0.05);
        assert!(above.iter().any(|r| r.theta0.abs() > 2.0));
    }

    /// Thesis figure 5.13: thrust and a constant servo torque; the drone tumbles.
    #[test]
    fn thrust_and_torque_tumble_the_drone() {
        let rows = run("seconds = 2.0\n[drone]\ncrank_friction_n_m_s = 0.02\n\
                        [input]\ntorque_n_m = 0.1");
        assert!(
            (last(&rows).theta1 - 0.263).abs() < 0.002,
            "{:?}",
            last(&rows)
        );
        assert!(
            (last(&rows).theta0 + 16.29).abs() < 0.05,
            "{:?}",
            last(&rows)
        );
        // The motor's 6 V are 0.3104 N m: more than the wash can hold, only a stop does.
        let rows = run("seconds = 1.0\n[input]\nvoltage_v = 6\n[options]\n\
            crank_stop = { angle_rad = 0.8, stiffness_n_m_rad = 50, damping_n_m_s = 0.02 }");
        let reached = rows.iter().map(|r| r.theta1).fold(0.0, f64::max);
        assert!((0.8..0.87).contains(&reached), "{reached}");
        // The reference has -9.5 rad with a stop of other constants.
        assert!((last(&rows).theta0 + 9.5).abs() < 1.2, "{:?}", last(&rows));
    }

    #[test]
    fn a_prescribed_crank_sweeps_the_linkage() {
        let points: Vec<String> = (0..=60)
            .map(|i| {
                let t = 0.05 * f64::from(i);
                let angle = 0.8 * (std::f64::consts::PI * t / 3.0).sin().powi(2);
                format!("[{t}, {angle}]")
            })
            .collect();
        let rows = run(&format!(
            "seconds = 3.0\n[input]\ncrank_rad = [{}]\n[options]\nhold_pitch = true",
            points.join(", ")
        ));
        for row in &rows {
            let angle = 0.8 * (std::f64::consts::PI * row.t / 3.0).sin().powi(2);
            assert!((row.theta1 - angle).abs() < 1e-5);
            assert_eq!(row.w0, 0.0);
        }
        assert!((rows[300].theta3 - 0.39946).abs() < 1e-5);
        assert!((rows[300].theta2 + 0.24277).abs() < 1e-5);
    }

    /// A free drone under the same crank: prescribing what a free crank did gives the same pitch.
    #[test]
    fn prescribed_and_free_runs_agree() {
        let free = run("seconds = 0.5\ndt_s = 0.001\n[start]\npitch_rad = 0.1\n\
            [input]\nideal_servo = { kp = 1.0, kd = 0.3, stiffness = 900, damping = 60 }");
        let points = free.iter().map(|r| [r.t, r.theta1]).collect();
        let mut scenario = Scenario::parse("seconds = 0.5\n[start]\npitch_rad = 0.1").unwrap();
        scenario.input = Input::CrankRad(Signal::Table(points));
        let pitch = last(&scenario.run().unwrap()).theta0;
        // The table's first rate comes from its points, and is off by some mrad/s.
        assert!((pitch - last(&free).theta0).abs() < 2e-5);
    }

    #[test]
    fn a_pulse_servo_flies_the_reference_loop() {
        let rows = run("seconds = 3.0\n[timing]\nphase_s = \"10 ms\"\n\
            [start]\npitch_rad = 0.2\npitch_rate_rad_s = 0.2\n\
            [input]\npulse_servo = { kp = 1.0, kd = 0.3 }");
        // The reference run at 0.2 s and 0.5 s.
        assert!((rows[40].theta0 - 0.160279126).abs() < 3e-3);
        assert!(last(&rows).theta0.abs() < 5e-3);
    }

    #[test]
    fn mistakes_are_named() {
        let refusal = |text: &str| Scenario::parse(text).unwrap_err().to_string();
        assert!(refusal("dt_s = 1").contains("seconds"));
        assert!(refusal("seconds = 1\nsecond = 2").contains("second"));
        assert!(refusal("seconds = -1").contains("rows"));
        assert!(refusal("seconds = 1\ndt_s = 0").contains("rows"));
        assert!(refusal("seconds = 1\n[start]\npitch_rad = \"3 m\"").contains("must be one of"));
        assert!(refusal("seconds = 1\n[drone]\nlink_mass_kg = 0").contains("link_mass_kg"));
        assert!(refusal("seconds = 1\n[input]\npush = 3").contains("push"));
        let order = "seconds = 1\n[input]\ntorque_n_m = [[1, 0], [0, 1]]";
        assert!(refusal(order).contains("point 1"));
        let odd = "seconds = 1\ndt_s = 0.0007\n[input]\npulse_servo = { kp = 1, kd = 1 }";
        assert!(refusal(odd).contains("step_s"));
    }
}
