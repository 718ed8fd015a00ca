//! The variables of the search, the cost of gains, and the start of the search.

use anyhow::Result;
use plant::dispersion::{self, Campaign, Outcome, Ranges};
use plant::limit::{self, Actuator};
use plant::linear::frequency::crank_to_pitch;
use plant::mechanism::Mechanism;
use plant::pitch_loop::{COMMAND_LIMIT_RAD, PitchLoop};
use plant::{ParameterError, Setup};
use rayon::prelude::*;
use tvc_nano::Params;
use tvc_nano::params::Range;

use super::margins::{self, Margins};
use crate::model::control_law::Law;
use crate::out::measure::{Figure, Limit::AtMost, figure};

/// Parameters that are searched, by the firmware's names.
pub const NAMES: [&str; 8] = [
    "PID_KP",
    "PID_KD",
    "PID_KNEE_RAD",
    "PID_FAR",
    "PID_AHEAD_S",
    "PID_TRIM_RAD_S",
    "SRV_DELAY_S",
    "SRV_LAG_S",
];
/// Their values.
pub type Gains = [f64; NAMES.len()];

/// Starts that are flown, rad, with [`START_RATE_RAD_S`] away from upright.
const STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.8];
/// Pitch rate at the start, rad/s.
const START_RATE_RAD_S: f64 = 0.2;
/// Settling band, share of the start.
const BAND: f64 = 0.05;
/// Length of a flight, s; what has not settled by then counts as settling at [`UNSETTLED_S`].
const FLIGHT_S: f64 = 1.6;
/// See [`FLIGHT_S`].
const UNSETTLED_S: f64 = 3.0;
/// Step of the model in the search, s.
const STEP_S: f64 = 1e-3;
/// Largest deviation of the sensor's clock.
const CLOCK: f64 = 0.01;
/// Error of the measured pitch in the flights, either way, rad.
const MISJUDGED_RAD: f64 = 1e-3;
/// Dispersed drones in the cost, their length (s) and lateral offset (m).
const DISPERSED: u64 = 90;
const DISPERSED_S: f64 = 2.0;
const LATERAL_M: f64 = 5e-3;

/// What is required.
#[derive(Debug, Clone, Copy)]
pub struct Requirements {
    /// Largest overshoot, percent.
    pub overshoot_pct: f64,
    /// Longest 5 % settling, in time-optimal limits.
    pub ratio: f64,
    /// Least phase margin, deg.
    pub phase_deg: f64,
}

/// The worst flights from one start.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Pitch at the start, rad.
    start_rad: f64,
    /// The time-optimal limit of the 5 % settling, s.
    limit_s: f64,
    /// Largest overshoot, percent.
    overshoot_pct: f64,
    /// Longest 5 % settling, s; none where a flight did not settle.
    settling_5pct_s: Option<f64>,
}

impl Run {
    /// Settling over limit; none where a flight did not settle.
    fn ratio(&self) -> Option<f64> {
        self.settling_5pct_s.map(|s| s / self.limit_s)
    }

    /// The figures, held to what is required.
    pub fn figures(&self, required: &Requirements) -> [Figure; 5] {
        [
            figure("start_rad", self.start_rad).shown("start", "rad", 1),
            figure("limit_s", self.limit_s).shown("time-optimal limit", "s", 3),
            figure("overshoot_pct", self.overshoot_pct)
                .shown("overshoot", "%", 2)
                .limit(AtMost(required.overshoot_pct)),
            figure("settling_5pct_s", self.settling_5pct_s)
                .shown("5 % settling", "s", 3)
                .or("never"),
            figure("ratio", self.ratio())
                .shown("times the limit", "", 2)
                .or("never")
                .limit(AtMost(required.ratio)),
        ]
    }
}

/// How finely frame phases and sensor ages are tried.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Frame phases.
    pub phases: u32,
    /// Ages of the sensor's refresh.
    pub ages: u32,
    /// Step of the model, s.
    step_s: f64,
}

impl Grid {
    /// For the search.
    pub const COARSE: Self = Self {
        phases: 4,
        ages: 3,
        step_s: STEP_S,
    };
    /// For the figures.
    pub const FINE: Self = Self {
        phases: 10,
        ages: 5,
        step_s: 0.5 * STEP_S,
    };
}

/// A drone and servo for which gains are sought.
#[derive(Debug)]
pub struct Problem {
    setup: Setup,
    base: Params,
    limits_s: [f64; STARTS_RAD.len()],
    pitch_gain: f64,
    seed: u64,
}

impl Problem {
    /// The problem of a setup. Parameters that are not searched are as in `base`, those of the
    /// model are the setup's.
    ///
    /// # Errors
    /// The drone cannot be brought upright at all.
    pub fn new(setup: Setup, base: &Params, seed: u64) -> Result<Self> {
        let actuator = Actuator {
            rate_rad_s: setup.servo.speed_rad_s,
            limit_rad: COMMAND_LIMIT_RAD,
        };
        let mut limits_s = [0.0; STARTS_RAD.len()];
        for (limit_s, start) in limits_s.iter_mut().zip(STARTS_RAD) {
            let limit = limit::time_optimal(&setup.drone, actuator, start, START_RATE_RAD_S, 0.0)?;
            *limit_s = limit.response.settling_s(BAND).unwrap_or(limit.to_rest_s);
        }
        let transfer = crank_to_pitch(&Mechanism::new(&setup.drone)?);
        let pitch_gain =
            transfer.numerator().last().copied().unwrap_or(0.0) / transfer.denominator()[0];
        let mut problem = Self {
            setup,
            base: base.clone(),
            limits_s,
            pitch_gain,
            seed,
        };
        set(&mut problem.base, "PITCH_GAIN", pitch_gain);
        set(&mut problem.base, "SRV_RAD_S", setup.servo.speed_rad_s);
        Ok(problem)
    }

    /// Gains from the delays alone. With `tau`, the lag of servo and frame plus the delay from
    /// sample to effect, the rate loop crosses at `0.8 / tau` and the angle loop at 0.4 of that;
    /// prediction covers the delay.
    pub fn start(&self) -> Gains {
        let Setup { servo, timing, .. } = &self.setup;
        let lag_s = servo.loop_s + servo.lag_s + 0.5 * timing.frame_s;
        let delay_s = self.delay_s();
        let rate_loop_rad_s = 0.8 / (lag_s + delay_s);
        let kd = rate_loop_rad_s / self.pitch_gain;
        [
            0.4 * rate_loop_rad_s * kd,
            kd,
            0.22,
            0.5,
            delay_s,
            5.0,
            0.5 * timing.control_s,
            servo.loop_s + servo.lag_s,
        ]
    }

    /// Mean delay from a sample to the pulse's end, s.
    fn delay_s(&self) -> f64 {
        let timing = &self.setup.timing;
        timing.delay_s
            + 0.5 * timing.refresh_s.unwrap_or(0.0)
            + timing.lead_s.unwrap_or(0.0)
            + margins::PULSE_S
    }

    /// The firmware's parameters with these gains, each within its range.
    pub fn params(&self, gains: &Gains) -> Params {
        let mut params = self.base.clone();
        for (name, value) in NAMES.iter().zip(gains) {
            set(&mut params, name, *value);
        }
        params
    }

    /// Margins of the loop near upright.
    ///
    /// # Errors
    /// A parameter of the drone out of range.
    pub fn margins(&self, params: &Params) -> Result<Margins, ParameterError> {
        margins::of(&self.setup, params, self.delay_s())
    }

    /// The worst flights from every start, over frame phases, sensor ages, clocks and both sides.
    ///
    /// # Errors
    /// A parameter of the drone out of range.
    pub fn figures(&self, params: &Params, grid: Grid) -> Result<Vec<Run>, ParameterError> {
        let per_start = grid.phases * grid.ages;
        STARTS_RAD
            .into_iter()
            .zip(self.limits_s)
            .map(|(start_rad, limit_s)| {
                let flights: Vec<(f64, Option<f64>)> = (0..per_start)
                    .into_par_iter()
                    .map(|index| self.fly(params, grid, start_rad, index))
                    .collect::<Result<_, _>>()?;
                let overshoot_pct = flights.iter().map(|f| f.0).fold(0.0, f64::max);
                let settling = flights
                    .iter()
                    .map(|f| f.1)
                    .try_fold(0.0_f64, |worst, s| Some(worst.max(s?)));
                Ok(Run {
                    start_rad,
                    limit_s,
                    overshoot_pct,
                    settling_5pct_s: settling,
                })
            })
            .collect()
    }

    /// Overshoot (percent) and settling time (s) of one flight of a grid.
    fn fly(
        &self,
        params: &Params,
        grid: Grid,
        start_rad: f64,
        index: u32,
    ) -> Result<(f64, Option<f64>), ParameterError> {
        let (phase, age) = (index / grid.ages, index % grid.ages);
        let share = |place: u32, of: u32| (f64::from(place) + 0.5) / f64::from(of);
        let alternately = |bit: u32| if index >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let mut timing = self.setup.timing;
        timing.step_s = grid.step_s;
        timing.phase_s = share(phase, grid.phases) * timing.frame_s;
        if let Some(period) = &mut timing.refresh_s {
            *period *= 1.0 + CLOCK * alternately(0);
            timing.refresh_phase_s = share(age, grid.ages) * *period;
        }
        let side = alternately(1);
        let mut law = Law::new(params, &self.setup.drone);
        let Setup { drone, servo, .. } = &self.setup;
        let mut flight = PitchLoop::new(
            drone,
            *servo,
            timing,
            side * start_rad,
            side * START_RATE_RAD_S,
        )?;
        let misjudged = MISJUDGED_RAD * alternately(2);
        let response = flight.respond(FLIGHT_S, |mut measurement| {
            measurement.pitch_rad += misjudged;
            law.update(measurement)
        });
        // Starts are not zero and the model is finite: there always is a response.
        Ok(response.map_or((f64::INFINITY, None), |response| {
            (response.overshoot_pct(), response.settling_s(BAND))
        }))
    }

    /// The cost that the search minimises: the worst ratio, overshoot near its limit, missing phase
    /// margin, and how near dispersed drones with an offset mass come to failing.
    ///
    /// # Errors
    /// A parameter of the drone out of range.
    pub fn cost(&self, gains: &Gains, required: &Requirements) -> Result<f64, ParameterError> {
        let params = self.params(gains);
        let runs = self.figures(&params, Grid::COARSE)?;
        // Half a percent of reserve: the grid of the search is coarse.
        let allowed = (required.overshoot_pct - 0.5).max(0.0);
        let costs: Vec<f64> = runs
            .iter()
            .map(|run| {
                let ratio = run.ratio().unwrap_or(UNSETTLED_S / run.limit_s);
                ratio + 0.3 * (run.overshoot_pct - allowed).max(0.0)
            })
            .collect();
        let worst = costs.iter().copied().fold(0.0, f64::max);
        let mean = costs.iter().sum::<f64>() / costs.len() as f64;
        let phase_deg = self.margins(&params)?.phase_deg.unwrap_or(0.0);
        let short_deg = (required.phase_deg + 2.0 - phase_deg).max(0.0);
        Ok(worst + 0.4 * mean + 0.1 * short_deg + 3.0 * self.fragility(&params)?)
    }

    /// How near dispersed drones come to failing what the thesis requires: the mean of what exceeds
    /// 60 % of it.
    fn fragility(&self, params: &Params) -> Result<f64, ParameterError> {
        let campaign = Campaign {
            ranges: Ranges::WIDE.with_lateral_m(LATERAL_M),
            seconds: DISPERSED_S,
            ..Campaign::new(self.seed, DISPERSED)
        };
        let mut setup = self.setup;
        setup.timing.step_s = STEP_S;
        let law = || {
            let mut law = Law::new(params, &setup.drone);
            move |measurement| law.update(measurement)
        };
        let outcomes = dispersion::fly(&setup, &campaign, law, || ())?;
        let near = |outcome: &Outcome| (outcome.badness().min(2.0) - 0.6).max(0.0);
        Ok(outcomes.iter().map(near).sum::<f64>() / DISPERSED as f64)
    }
}

/// Sets a parameter to the value of its range that is nearest.
fn set(params: &mut Params, name: &str, value: f64) {
    if let Some(Range::Between(low, high)) = Params::info(name).map(|info| info.range) {
        // Within its range a value is always taken.
        let _ = params.set(name, (value as f32).clamp(low, high));
    }
}
