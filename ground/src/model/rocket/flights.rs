//! Steps of both axes through the burn.

use anyhow::{Result, anyhow};
use plant::StepResponse;
use plant::rocket::{Attitude, Rocket, RocketSample};
use serde::Serialize;
use tvc_pid::{Axes, Config, Gains, Schedule};

use super::REQUIRED;

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
#[derive(Serialize)]
pub struct ScheduleRow {
    time_s: f64,
    mass_kg: f64,
    cm_m: f64,
    inertia_kg_m2: f64,
    pressure_pa: f64,
    mu_c: f64,
    mu_a: f64,
    kp: f64,
    kd: f64,
}

impl ScheduleRow {
    /// Time and `mu_c`.
    pub fn control(&self) -> (f64, f64) {
        (self.time_s, self.mu_c)
    }

    /// Time and `mu_a`.
    pub fn air(&self) -> (f64, f64) {
        (self.time_s, self.mu_a)
    }

    /// Time and proportional gain.
    pub fn proportional(&self) -> (f64, f64) {
        (self.time_s, self.kp)
    }

    /// Time and derivative gain.
    pub fn derivative(&self) -> (f64, f64) {
        (self.time_s, self.kd)
    }

    /// As texts.
    pub fn cells(&self) -> Vec<String> {
        vec![
            format!("{:.0}", self.time_s),
            format!("{:.0}", self.mass_kg),
            format!("{:.2}", self.cm_m),
            format!("{:.0}", self.inertia_kg_m2),
            format!("{:.1}", self.pressure_pa / 1e3),
            format!("{:.1}", self.mu_c),
            format!("{:.2}", self.mu_a),
            format!("{:.4}", self.kp),
            format!("{:.4}", self.kd),
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
            let gains = flight.gains(NATURAL_RAD_S, DAMPING);
            ScheduleRow {
                time_s,
                mass_kg: flight.mass_kg,
                cm_m: flight.cm_m,
                inertia_kg_m2: flight.inertia_kg_m2,
                pressure_pa: flight.pressure_pa,
                mu_c: flight.mu_c,
                mu_a: flight.mu_a,
                kp: gains.kp,
                kd: gains.kd,
            }
        })
        .collect()
}

/// A step of both axes.
#[derive(Serialize)]
pub struct Step {
    pub time_s: f64,
    pub scheduled: bool,
    /// Pitch, then yaw; settling is `null` if the response leaves its band to the end.
    overshoot_pct: [f64; 2],
    settling_5pct_s: [Option<f64>; 2],
    #[serde(skip)]
    pub samples: Vec<RocketSample>,
}

/// An airframe's steps.
#[derive(Serialize)]
pub struct Airframe {
    pub name: &'static str,
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

    /// Whether every step with the schedule is as required.
    pub fn passed(&self) -> bool {
        let (overshoot, settling) = REQUIRED;
        self.steps.iter().filter(|step| step.scheduled).all(|step| {
            step.overshoot_pct.iter().all(|pct| *pct <= overshoot)
                && step
                    .settling_5pct_s
                    .iter()
                    .all(|s| s.is_some_and(|s| s <= settling))
        })
    }

    /// As texts, a row a step.
    pub fn cells(&self) -> Vec<Vec<String>> {
        let seconds = |value: Option<f64>| value.map_or("never".into(), |s| format!("{s:.2}"));
        self.steps
            .iter()
            .map(|step| {
                let gains = if step.scheduled {
                    "scheduled"
                } else {
                    "of lift-off"
                };
                vec![
                    format!("{}, {gains}, {:.0} s", self.name, step.time_s),
                    format!("{:.1}", step.overshoot_pct[0]),
                    seconds(step.settling_5pct_s[0]),
                    format!("{:.1}", step.overshoot_pct[1]),
                    seconds(step.settling_5pct_s[1]),
                ]
            })
            .collect()
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
    let schedule = Schedule::<f32, 10>::new(&table).map_err(named)?;
    let lift_off = config(rocket, 0.0);
    let mut axes = Axes::<f32, 2>::new(&[lift_off.clone(), lift_off]).map_err(named)?;
    let start = Attitude {
        time_s,
        angle_rad: ERRORS_RAD,
        rate_rad_s: [0.0; 2],
    };
    let samples = rocket.fly(start, SECONDS, |attitude, _| {
        if let (true, Some(coefficients)) = (scheduled, schedule.at(attitude.time_s as f32)) {
            for pid in axes.controllers() {
                pid.set_coefficients(coefficients);
            }
        }
        let single = |values: [f64; 2]| values.map(|value| value as f32);
        let wanted = axes.update(
            [0.0; 2],
            single(attitude.angle_rad),
            single(attitude.rate_rad_s),
        );
        // A positive gimbal angle turns the rocket the other way.
        wanted.map(|angle| -f64::from(angle))
    });
    let mut overshoot_pct = [0.0; 2];
    let mut settling_5pct_s = [None; 2];
    for axis in 0..2 {
        let trace = samples
            .iter()
            .map(|s| (s.attitude.time_s, s.attitude.angle_rad[axis]));
        let response = StepResponse::new(trace, 0.0)?;
        overshoot_pct[axis] = response.overshoot_pct();
        settling_5pct_s[axis] = response.settling_s(0.05);
    }
    Ok(Step {
        time_s,
        scheduled,
        overshoot_pct,
        settling_5pct_s,
        samples,
    })
}
