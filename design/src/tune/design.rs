//! The variables of the search, the cost of gains, and the start of the search.

use anyhow::Result;
use plant::dispersion::{self, Campaign, Draw, Outcome, Ranges};
use plant::limit::{self, Actuator};
use plant::linear::frequency::pitch_gain;
use plant::mechanism::Mechanism;
use plant::pitch_loop::{COMMAND_LIMIT_RAD, PitchLoop, Timing};
use plant::response::StepResponse;
use plant::{ParameterError, Setup};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use rig::{Image, ServoKind};
use tvc_nano::Params;
use tvc_nano::params::Range;

use super::margins::{self, Margins};
use super::{flown, named};
use crate::control_law::Law;
use report::distribution::Distribution;
use report::measure::{Figure, Limit::AtMost, figure};

/// Parameters that are searched, by the firmware's names: those of the surface law, and the servo
/// as it is best taken to be.
pub const NAMES: [&str; 11] = [
    "SRV_LOOP_S",
    "SRV_MOTOR_S",
    "SRV_PLAY_RAD",
    "SFC_AHEAD_S",
    "SFC_GAIN_S",
    "SFC_LEAD_RAD",
    "SFC_NEAR",
    "SFC_CURVE",
    "SFC_RATE",
    "SFC_PITCH",
    "PID_TRIM_RAD_S",
];
/// Their values.
pub type Gains = [f64; NAMES.len()];

/// Starts that are flown, rad, with [`START_RATE_RAD_S`] away from upright: small ones, middling
/// and large ones.
pub const STARTS_RAD: [[f64; 7]; 3] = [
    [0.1, 0.13, 0.16, 0.2, 0.23, 0.26, 0.3],
    [0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6],
    [0.6, 0.64, 0.68, 0.72, 0.76, 0.8, 0.85],
];
/// Overshoot counts in percent of the start, and at least of this, rad.
const LEAST_SCALE_RAD: f64 = 0.15;
/// Pitch rate at the start, rad/s.
pub const START_RATE_RAD_S: f64 = 0.2;
/// Settling band, share of the start.
pub const BAND: f64 = 0.05;
/// Length of a flight, s; what has not settled by then counts as settling at [`UNSETTLED_S`].
const FLIGHT_S: f64 = 1.2;
/// See [`FLIGHT_S`].
const UNSETTLED_S: f64 = 3.0;
/// Step of the model in the search, s.
const STEP_S: f64 = 1e-3;
/// Largest deviation of the sensor's clock.
const CLOCK: f64 = 0.01;
/// How much quicker than required the search wants 95 % of the flights to be, and what it costs to
/// be slower. The image flies 2 % slower than the model.
const RATIO_RESERVE: f64 = 0.04;
const SLOWNESS: f64 = 10.0;
/// Error of the measured pitch in the flights, either way, rad.
const MISJUDGED_RAD: f64 = 0.5e-3;
/// The slowest refresh of a sensor that the drone is flown with, Hz, and the overshoot with it that
/// is allowed, in those of the requirement.
const SLOW_REFRESH_HZ: f64 = 35.0;
const SLOW_OVERSHOOT: f64 = 2.0;
/// Peak of the sensitivity up to which the search has no objection.
const PEAK_SENSITIVITY: f64 = 2.1;
/// Noise of the measured rate, rms, rad/s (BNO055 data sheet: 0.014 deg/s per root Hz at 47 Hz).
const RATE_NOISE_RAD_S: f64 = 2.1e-3;
/// Dispersed drones of which the cost has those that are hard to fly, the length of their flights
/// (s) and their lateral offset (m).
const DISPERSED: u64 = 400;
const DISPERSED_S: f64 = 2.0;
const LATERAL_M: f64 = 5e-3;
/// What it costs when they nearly fail. More of it makes the nominal drone slower.
const FRAGILITY: f64 = 2.4;

/// What is required.
#[derive(Debug, Clone, Copy)]
pub struct Requirements {
    /// Largest overshoot of 95 % of the flights, percent.
    pub overshoot_pct: f64,
    /// Longest 5 % settling of 95 % of the flights, in time-optimal limits.
    pub ratio: f64,
    /// Least gain margin, dB.
    pub gain_db: f64,
}

/// A start, and the shortest 5 % settling from there that the rudder's speed allows, s.
#[derive(Debug, Clone, Copy)]
struct Start {
    pitch_rad: f64,
    limit_s: f64,
}

/// A flight from a start.
#[derive(Debug, Clone, Copy)]
struct Flight {
    start: Start,
    /// Percent of the start, or of [`LEAST_SCALE_RAD`].
    overshoot_pct: f64,
    /// 5 % settling, s; none where it did not settle.
    settling_s: Option<f64>,
}

impl Flight {
    fn new(start: Start, response: Option<StepResponse>) -> Self {
        // Starts are not zero and the model is finite: there always is a response.
        let (overshoot_pct, settling_s) = response.map_or((f64::INFINITY, None), |response| {
            (response.overshoot_pct(), response.settling_s(BAND))
        });
        let scale = (start.pitch_rad / LEAST_SCALE_RAD).min(1.0);
        Self { start, overshoot_pct: scale * overshoot_pct, settling_s }
    }
}

/// The flights from a group of starts.
#[derive(Debug, Clone)]
pub struct Run(Vec<Flight>);

impl Run {
    fn ratio(&self) -> Distribution {
        let ratio = |flight: &Flight| flight.settling_s.map(|s| s / flight.start.limit_s);
        Distribution::of(self.0.iter().map(ratio))
    }

    fn overshoot_pct(&self) -> Distribution {
        Distribution::of(self.0.iter().map(|flight| Some(flight.overshoot_pct)))
    }

    /// The figures, held to what is required; `from` says what the start is.
    pub fn figures(&self, from: &'static str, required: &Requirements) -> [Figure; 4] {
        let starts_rad = || self.0.iter().map(|flight| flight.start.pitch_rad);
        [
            figure("start_rad", starts_rad().fold(f64::INFINITY, f64::min)).shown(from, "rad", 1),
            figure("largest_start_rad", starts_rad().fold(0.0, f64::max)).shown("to", "rad", 2),
            self.ratio().figure(
                "ratio",
                ("times the limit", "", 2),
                [Some(AtMost(required.ratio)), None],
            ),
            self.overshoot_pct().figure(
                "overshoot_pct",
                ("overshoot", "%", 2),
                [Some(AtMost(required.overshoot_pct)), None],
            ),
        ]
    }

    /// Whether all that is required holds.
    pub fn is_met(&self, required: &Requirements) -> bool {
        self.ratio().p95 <= required.ratio && self.overshoot_pct().p95 <= required.overshoot_pct
    }

    /// What the search minimises of them: most flights and nearly the worst within the limit, and
    /// overshoot that comes near to what is allowed. The first half of it counts for the worst
    /// group of starts alone.
    pub fn cost(&self, required: &Requirements) -> (f64, f64) {
        let ratio =
            |flight: &Flight| Some(flight.settling_s.unwrap_or(UNSETTLED_S) / flight.start.limit_s);
        let ratio = Distribution::of(self.0.iter().map(ratio));
        let overshoot = self.overshoot_pct();
        // The grid of the search is coarse, which the reserves make up for.
        let over = |pct: f64, allowed: f64| (pct - allowed).max(0.0);
        let allowed = required.overshoot_pct;
        let bad = ratio.p95.max(ratio.worst - 0.08)
            + SLOWNESS * over(ratio.p95, required.ratio - RATIO_RESERVE)
            + over(overshoot.p95, 0.9 * allowed)
            + 0.2 * over(overshoot.worst, 1.3 * allowed);
        (bad, 0.4 * bad + 0.3 * ratio.mean)
    }

    /// What the search minimises of flights with a slow sensor: overshoot beyond what is allowed.
    fn slow_cost(&self, required: &Requirements) -> f64 {
        let worst = self.overshoot_pct().worst;
        0.1 * (worst - SLOW_OVERSHOOT * required.overshoot_pct).max(0.0)
    }
}

/// How many flights stand for all frame phases and sensor ages.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Flights from each group of starts.
    flights: u32,
    /// Rate of the sensor's refresh, Hz, where it is not that of the setup.
    refresh_hz: Option<f64>,
    /// Step of the model, s.
    step_s: f64,
}

impl Grid {
    /// For the search.
    pub const COARSE: Self = Self { flights: 35, refresh_hz: None, step_s: STEP_S };
    /// For the search, with a sensor that refreshes slowly.
    const SLOW: Self = Self { flights: 14, refresh_hz: Some(SLOW_REFRESH_HZ), step_s: STEP_S };
    /// For the figures.
    pub const FINE: Self = Self { flights: 140, refresh_hz: None, step_s: 0.5 * STEP_S };
}

/// A drone and servo for which gains are sought.
#[derive(Debug)]
pub struct Problem {
    setup: Setup,
    base: Params,
    /// Lag of the servo's motor with the rudder at zero, s.
    servo_lag_s: f64,
    starts: [[Start; STARTS_RAD[0].len()]; STARTS_RAD.len()],
    seed: u64,
}

impl Problem {
    /// The problem of a setup. Parameters that are not searched are as in `base`, those of the
    /// model are the setup's.
    ///
    /// # Errors
    /// The drone cannot be brought upright at all.
    pub fn new(setup: Setup, base: &Params, seed: u64) -> Result<Self> {
        let actuator =
            Actuator { rate_rad_s: setup.servo.speed_rad_s, limit_rad: COMMAND_LIMIT_RAD };
        let mut starts =
            STARTS_RAD.map(|group| group.map(|pitch_rad| Start { pitch_rad, limit_s: 0.0 }));
        for Start { pitch_rad, limit_s } in starts.iter_mut().flatten() {
            let limit =
                limit::time_optimal(&setup.drone, actuator, *pitch_rad, START_RATE_RAD_S, 0.0)?;
            *limit_s = limit.response.settling_s(BAND).unwrap_or(limit.to_rest_s);
        }
        let mechanism = Mechanism::new(&setup.drone)?;
        let pitch_gain = pitch_gain(&mechanism);
        let zero = mechanism.configuration(mechanism.linkage().zero_rudder_crank_rad());
        let servo_lag_s = setup.servo.lag_s(zero.crank_inertia());
        let mut problem = Self { setup, base: base.clone(), servo_lag_s, starts, seed };
        problem.base.set("PID_LAW", SURFACE_LAW).map_err(|error| anyhow::anyhow!("{error}"))?;
        set(&mut problem.base, "PITCH_GAIN", pitch_gain);
        set(&mut problem.base, "SRV_RAD_S", setup.servo.speed_rad_s);
        Ok(problem)
    }

    /// Gains from the servo alone: its own constants, the surface looked at a time constant of its
    /// loop ahead, where a rate falls at a pace that the loop can follow.
    pub fn start(&self) -> Gains {
        let servo = &self.setup.servo;
        let ahead_s = servo.loop_s;
        [
            servo.loop_s,
            1.5 * self.servo_lag_s,
            // A logarithm is searched.
            (0.5 * servo.backlash_rad).max(1e-4),
            ahead_s,
            0.6,
            1.5 * servo.speed_rad_s * servo.loop_s,
            0.42 / ahead_s,
            0.83,
            0.8,
            0.6,
            2.0,
        ]
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
        margins::of(&self.setup, params)
    }

    /// The flights from every group of starts, over frame phases, sensor ages, clocks and both
    /// sides.
    ///
    /// # Errors
    /// A parameter of the drone out of range.
    pub fn figures(&self, params: &Params, grid: Grid) -> Result<Vec<Run>, ParameterError> {
        let of_group = |group: &[Start]| {
            let flights = (0..grid.flights).into_par_iter().map(|index| {
                let start = group[index as usize % group.len()];
                self.fly(params, grid, start, index)
            });
            Ok(Run(flights.collect::<Result<_, _>>()?))
        };
        self.starts.iter().map(|group| of_group(group)).collect()
    }

    /// The same of flights by the image.
    ///
    /// # Errors
    /// Those of [`flown::fly`].
    pub fn flown(
        &self,
        image: &Image,
        servo: ServoKind,
        params: &Params,
        seeds: u32,
    ) -> Result<Vec<Run>> {
        let gains: Vec<(String, f32)> =
            named(params).into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let flights = flown::fly(image, (&self.setup, servo), &gains, seeds)?;
        let run = |(group, responses): (&[Start; _], Vec<StepResponse>)| {
            let starts = group.iter().cycle().copied();
            Run(starts.zip(responses).map(|(start, r)| Flight::new(start, Some(r))).collect())
        };
        Ok(self.starts.iter().zip(flights).map(run).collect())
    }

    /// One flight of a grid.
    fn fly(
        &self,
        params: &Params,
        grid: Grid,
        start: Start,
        index: u32,
    ) -> Result<Flight, ParameterError> {
        // Evenly over the square of both (M. Roberts, The Unreasonable Effectiveness of
        // Quasirandom Sequences, 2018).
        let [phase, age] =
            [0.754_877_67, 0.569_840_29].map(|step| (0.5 + step * f64::from(index)).fract());
        let alternately = |bit: u32| if index >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let mut timing = self.setup.timing;
        timing.step_s = grid.step_s;
        timing.phase_s = phase * timing.frame_s;
        if let Some(hz) = grid.refresh_hz {
            timing.refresh_s = Some(1.0 / hz);
        }
        if let Some(period) = &mut timing.refresh_s {
            *period *= 1.0 + CLOCK * alternately(0);
            timing.refresh_phase_s = age * *period;
        }
        let side = alternately(1);
        let mut law = Law::new(params, &self.setup.drone, &timing);
        let Setup { drone, servo, .. } = &self.setup;
        let mut flight =
            PitchLoop::new(drone, *servo, timing, side * start.pitch_rad, side * START_RATE_RAD_S)?;
        let misjudged = MISJUDGED_RAD * alternately(2);
        let mut chance = ChaCha8Rng::seed_from_u64(index.into());
        // The gyroscope has another noise for every new rate.
        let (mut newest, mut noise) = (f64::NAN, 0.0);
        let response = flight.respond(FLIGHT_S, |mut measurement| {
            if measurement.rate_rad_s != newest {
                newest = measurement.rate_rad_s;
                noise = RATE_NOISE_RAD_S * chance.sample::<f64, _>(StandardNormal);
            }
            measurement.pitch_rad += misjudged;
            measurement.rate_rad_s += noise;
            law.update(measurement)
        });
        Ok(Flight::new(start, response.ok()))
    }

    /// The cost that the search minimises: the settling of nearly all flights, overshoot near its
    /// limit, and what a sensor that refreshes slowly adds to it. A high peak of the sensitivity
    /// and dispersed drones with an offset mass that nearly fail cost, too.
    ///
    /// # Errors
    /// A parameter of the drone out of range.
    pub fn cost(&self, gains: &Gains, required: &Requirements) -> Result<f64, ParameterError> {
        let params = self.params(gains);
        let runs = self.figures(&params, Grid::COARSE)?;
        let costs: Vec<(f64, f64)> = runs.iter().map(|run| run.cost(required)).collect();
        let worst = costs.iter().map(|cost| cost.0).fold(0.0, f64::max);
        let sum: f64 = costs.iter().map(|cost| cost.1).sum();
        let slow = self.figures(&params, Grid::SLOW)?;
        let slow: f64 = slow.iter().map(|run| run.slow_cost(required)).sum();
        let fragility = self.fragility(&params)?;
        let peak = margins::likely_peak(&self.setup, &params)?;
        let peak = 0.1 * (peak - PEAK_SENSITIVITY).max(0.0);
        Ok(worst + sum + slow + peak + FRAGILITY * fragility)
    }

    /// The largest overshoot with a sensor that refreshes at [`SLOW_REFRESH_HZ`], percent.
    ///
    /// # Errors
    /// A parameter of the drone out of range.
    pub fn slow_overshoot_pct(&self, params: &Params) -> Result<f64, ParameterError> {
        let runs = self.figures(params, Grid::SLOW)?;
        let worst = runs.iter().map(|run| run.overshoot_pct().worst);
        Ok(worst.fold(0.0, f64::max))
    }

    /// How near dispersed drones come to failing what the thesis requires: the mean of what exceeds
    /// 60 % of it. Those whose rudder does by a third more or less than the nominal drone's are
    /// flown, since hardly any other fails.
    fn fragility(&self, params: &Params) -> Result<f64, ParameterError> {
        let campaign = Campaign {
            ranges: Ranges { cm_lateral_m: LATERAL_M, ..Ranges::REFERENCE },
            seconds: DISPERSED_S,
            ..Campaign::new(self.seed, DISPERSED)
        };
        let mut setup = self.setup;
        setup.timing.step_s = STEP_S;
        let law = |timing: &Timing| {
            let mut law = Law::new(params, &setup.drone, timing);
            move |measurement| law.update(measurement)
        };
        let hard = |draw: &Draw| !(0.75..1.33).contains(&(draw.thrust / draw.inertia));
        let outcomes = dispersion::fly(&setup, &campaign, hard, law, || ())?;
        let near = |run: &Outcome| {
            let badness = dispersion::badness(run.settling_5pct_s, run.overshoot_pct);
            (badness.min(2.0) - 0.6).max(0.0)
        };
        Ok(outcomes.iter().map(near).sum::<f64>() / DISPERSED as f64)
    }
}

/// The gains among parameters.
pub fn gains(params: &Params) -> Gains {
    // A logarithm is searched.
    NAMES.map(|name| f64::from(params.value(name).unwrap_or_default()).max(1e-4))
}

/// The value of `PID_LAW` for the law that is tuned.
const SURFACE_LAW: f32 = 2.0;

/// Sets a parameter to the value of its range that is nearest.
fn set(params: &mut Params, name: &str, value: f64) {
    if let Some(Range::Between(low, high)) = Params::info(name).map(|info| info.range) {
        // Within its range a value is always taken.
        let _ = params.set(name, (value as f32).clamp(low, high));
    }
}
