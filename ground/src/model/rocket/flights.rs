//! Steps of both axes through the burn.

use anyhow::{Result, anyhow};
use plant::StepResponse;
use plant::rocket::{self, Attitude, Flight, Rocket, RocketSample};
use tvc_pid::{Config, Controller, Gains, Law as _, Pid, Schedule};

use super::{OVERSHOOT_PCT, SETTLING_S};
use report::measure::{Figure, Value, figure, rows};

/// Natural frequency (rad/s) and damping that the gains are to give.
const NATURAL_RAD_S: f64 = 3.0;
const DAMPING: f64 = 0.8;
/// Times of the schedule, in s, and of the steps.
const TABLE_S: [f64; 10] = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0];
const STEPS_S: [f64; 5] = [0.0, 20.0, 37.0, 60.0, 84.0];
/// Errors of pitch and yaw at a step, in rad: unequal, so that the axes can be told apart.
const ERRORS_RAD: [f64; 2] = [
    5.0 * std::f64::consts::PI / 180.0,
    -3.0 * std::f64::consts::PI / 180.0,
];
/// Length of a step response, in s.
const SECONDS: f64 = 4.0;
/// Period of the controller, in s.
const PERIOD_S: f32 = 0.01;

/// A row of the schedule.
pub struct ScheduleRow {
    /// The rocket at a time.
    pub flight: Flight,
    /// The gains that follow.
    pub gains: rocket::Gains,
}

impl ScheduleRow {
    /// What `--json` and the table say of it.
    pub fn figures(&self) -> [Figure; 9] {
        let at = &self.flight;
        [
            figure("time_s", at.time_s).shown("time", "s", 0),
            figure("mass_kg", at.mass_kg).shown("mass", "kg", 0),
            figure("cm_m", at.cm_m).shown("CM", "m", 2),
            figure("inertia_kg_m2", at.inertia_kg_m2).shown("inertia", "kg m2", 0),
            figure("pressure_pa", at.pressure_pa)
                .shown("q", "kPa", 1)
                .scaled(1e-3),
            figure("mu_c", at.mu_c).shown("mu_c", "1/s2", 1),
            figure("mu_a", at.mu_a).shown("mu_a", "1/s2", 2),
            figure("kp", self.gains.kp).shown("kp", "", 4),
            figure("kd", self.gains.kd).shown("kd", "s", 4),
        ]
    }
}

/// The schedule of a rocket, every ten seconds and at its greatest dynamic pressure.
pub fn schedule_rows(rocket: &Rocket) -> Vec<ScheduleRow> {
    let mut times: Vec<f64> = TABLE_S.to_vec();
    times.extend([32.0, 75.0]);
    times.sort_by(f64::total_cmp);
    times
        .into_iter()
        .map(|time_s| {
            let flight = rocket.at(time_s);
            ScheduleRow {
                gains: flight.gains(NATURAL_RAD_S, DAMPING),
                flight,
            }
        })
        .collect()
}

/// A step of both axes.
pub struct Step {
    /// Time since ignition, s.
    pub time_s: f64,
    /// With the schedule, or else with the gains of lift-off.
    pub scheduled: bool,
    /// Pitch, then yaw.
    responses: [StepResponse; 2],
    /// The motion.
    pub samples: Vec<RocketSample>,
}

impl Step {
    /// What `--json` and the table say of it; steps with the schedule are held to the requirements.
    pub fn figures(&self, airframe: &str) -> [Figure; 4] {
        let held = |limit| self.scheduled.then_some(limit);
        let [pitch, yaw] = &self.responses;
        let overshoot = |of: &StepResponse, label| {
            let shown = figure("", of.overshoot_pct()).shown(label, "%", 1);
            shown.limit(held(OVERSHOOT_PCT))
        };
        let settling = |of: &StepResponse, label| {
            let shown = figure("", of.settling_s(0.05)).shown(label, "s", 2);
            shown.or("never").limit(held(SETTLING_S))
        };
        let overshoots = [
            overshoot(pitch, "pitch overshoot"),
            overshoot(yaw, "yaw overshoot"),
        ];
        let settlings = [
            settling(pitch, "pitch 5 % settling"),
            settling(yaw, "yaw 5 % settling"),
        ];
        let gains = if self.scheduled {
            "scheduled"
        } else {
            "of lift-off"
        };
        let name = format!("{airframe}, {gains}, {:.0} s", self.time_s);
        [
            figure("time_s", self.time_s).said("airframe, gains, time of the burn", name),
            figure("scheduled", self.scheduled),
            figure("overshoot_pct", Value::Rows(overshoots.into())),
            figure("settling_5pct_s", Value::Rows(settlings.into())),
        ]
    }
}

/// An airframe's steps.
pub struct Airframe {
    /// Its name.
    pub name: &'static str,
    /// Steps at several times, with the schedule and without.
    pub steps: Vec<Step>,
}

impl Airframe {
    /// Flies every step with the schedule and with the gains of lift-off.
    pub fn fly(name: &'static str, rocket: &Rocket) -> Result<Self> {
        let steps = [true, false]
            .into_iter()
            .flat_map(|scheduled| STEPS_S.map(|time_s| step(rocket, time_s, scheduled)))
            .collect::<Result<_>>()?;
        Ok(Self { name, steps })
    }

    /// As a member of `--json`.
    pub fn object(&self) -> [Figure; 2] {
        [figure("name", self.name), rows("steps", self.figures())]
    }

    /// Its steps as figures.
    pub fn figures(&self) -> impl Iterator<Item = [Figure; 4]> {
        self.steps.iter().map(|step| step.figures(self.name))
    }
}

/// The controller's configuration at a time of the burn (s).
fn config(rocket: &Rocket, time_s: f64) -> Config {
    let gains = rocket.at(time_s).gains(NATURAL_RAD_S, DAMPING);
    let limit = rocket.parameters().gimbal_limit_rad as f32;
    Config {
        gains: Gains {
            kp: gains.kp as f32,
            ki: 0.0,
            kd: gains.kd as f32,
        },
        limit: -limit..=limit,
        ..Config::new(PERIOD_S)
    }
}

fn step(rocket: &Rocket, time_s: f64, scheduled: bool) -> Result<Step> {
    let named = |error| anyhow!("the rocket's controller: {error}");
    let table = TABLE_S.map(|at| (at as f32, config(rocket, at)));
    let schedule = Schedule::<f32, 10>::new(table).map_err(named)?;
    let lift_off = config(rocket, 0.0);
    let pid = Controller::<f32, Pid<f32>>::new(&lift_off).map_err(named)?;
    let mut axes = [pid.clone(), pid];
    let start = Attitude {
        time_s,
        angle_rad: ERRORS_RAD,
        rate_rad_s: [0.0; 2],
    };
    let samples = rocket.fly(start, SECONDS, |attitude, _| {
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
    let response = |axis: usize| {
        let trace = samples.iter().map(|s| &s.attitude);
        StepResponse::new(trace.map(|at| (at.time_s, at.angle_rad[axis])), 0.0)
    };
    Ok(Step {
        time_s,
        scheduled,
        responses: [response(0)?, response(1)?],
        samples,
    })
}
