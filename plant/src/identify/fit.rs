//! The fit of a model to records: Levenberg and Marquardt's search with Huber's weights.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{IdentifyError, Reading, Record, check};
use crate::drone::Drone;
use crate::linear::frequency;
use crate::mechanism::Mechanism;
use crate::servo::{Load, Servo};
use crate::setup::Setup;

/// Step of the model, in s.
const STEP_S: f64 = 1e-3;
/// Time for which the servo is given its first pulse before the record starts, in s.
const SETTLE_S: f64 = 0.5;
/// The beginning of a record, in s: the way up from a release.
const BEGINNING_S: f64 = 0.7;
/// Iterations after which the search is given up.
const ITERATIONS: usize = 60;
/// Weight of a large residual is cut beyond this many standard deviations: quantisation, play and
/// a lost sample are not Gaussian.
const HUBER: f64 = 3.0;
/// By how much more than noise the estimates are off, for what the model lacks: with it, 19 of 20
/// true values of vehicles on the rig lie within two deviations.
const MODEL: f64 = 4.5;
/// Noise of pitch, rad, and rate, rad/s, at least: an attitude is off by 1 mrad even where it is
/// the sum of the rates, whose errors it repeats.
const LEAST_NOISE: [f64; 2] = [1e-3, 1e-4];
/// Residuals that correlate by less than this are independent.
const INDEPENDENT: f64 = 0.05;

/// The unknowns that all records share: offsets from the nominal setup, the first three of the
/// logarithm. Behind them lie pitch and rate at the start of each record, and how long after its
/// first reading that is: a release comes at any time.
pub(super) const SHARED: usize = 5;
pub(super) const THRUST: usize = 0;
pub(super) const INERTIA: usize = 1;
pub(super) const SPEED: usize = 2;
const DELAY: usize = 3;
const HORN: usize = 4;
/// Unknowns of a record.
const OWN: usize = 3;

/// Prior standard deviations: shares for thrust, inertia and speed; s; rad. Those of a start are
/// rad, rad/s and s.
pub(super) const PRIOR: [f64; SHARED] = [0.4, 0.5, 0.5, 0.010, 0.03];
const START_PRIOR: [f64; OWN] = [0.05, 0.2, 0.005];
/// Steps of the differences: wide enough to average over play and deadband.
const DIFFERENCE: [f64; SHARED] = [0.01, 0.01, 0.01, 0.5e-3, 2e-3];
const START_DIFFERENCE: [f64; OWN] = [1e-3, 2e-3, 0.5e-3];

/// Differences between a record and the model: pitch and rate of each reading.
type Residuals = Vec<[f64; 2]>;

/// Where a search has ended.
pub(super) struct Found {
    pub(super) unknowns: Vec<f64>,
    /// Of each record.
    misfit: Vec<Residuals>,
    /// Minus the logarithm of the likelihood, up to a constant.
    pub(super) cost: f64,
    pub(super) iterations: usize,
}

impl Found {
    /// Misfit of pitch or rate, rms.
    pub(super) fn rms(&self, channel: usize) -> f64 {
        rms(&self.misfit, channel)
    }
}

/// Records, and the setup from which the search starts.
pub(super) struct Fit<'a> {
    nominal: &'a Setup,
    records: &'a [Record],
    /// So much of each record counts, s: a longer flight diverges from a model that is far off.
    horizon_s: f64,
}

impl<'a> Fit<'a> {
    /// Records that can be used.
    pub(super) fn new(nominal: &'a Setup, records: &'a [Record]) -> Result<Self, IdentifyError> {
        records.iter().try_for_each(check)?;
        Ok(Self { nominal, records, horizon_s: f64::INFINITY })
    }

    /// The same of the quick part of each record.
    pub(super) fn of_beginning(&self) -> Self {
        Self { horizon_s: BEGINNING_S, ..*self }
    }

    /// The nominal setup, and starts as they were read.
    pub(super) fn nominal_unknowns(&self) -> Vec<f64> {
        vec![0.0; SHARED + OWN * self.records.len()]
    }

    /// The setup that unknowns stand for.
    pub(super) fn setup(&self, x: &[f64]) -> Setup {
        let mut setup = *self.nominal;
        setup.drone.thrust_n *= x[THRUST].exp();
        setup.drone.body_inertia_kg_m2 *= x[INERTIA].exp();
        setup.servo.speed_rad_s *= x[SPEED].exp();
        setup.timing.delay_s += x[DELAY];
        setup.servo.horn_rad += x[HORN];
        setup
    }

    /// Searches from there; `None` if no parameters within reason are found.
    pub(super) fn search(&self, start: Vec<f64>) -> Option<Found> {
        let mut x = start;
        let mut noise = self.first_noise();
        let mut misfit = self.residuals(&x)?;
        let mut damping = 1e-3;
        let mut iterations = 0;
        let mut settled = 0;
        while iterations < ITERATIONS && settled < 2 {
            iterations += 1;
            let jacobian = self.jacobian(&x, &misfit)?;
            let (normal, gradient) = self.normal(&jacobian, &misfit, &noise, &x);
            let mut improved = false;
            for _ in 0..12 {
                let mut damped = normal.clone();
                for i in 0..x.len() {
                    damped[(i, i)] *= 1.0 + damping;
                }
                let Some(factor) = damped.cholesky() else {
                    damping *= 10.0;
                    continue;
                };
                let step = factor.solve(&gradient);
                let candidate: Vec<f64> = x.iter().zip(step.iter()).map(|(x, by)| x + by).collect();
                let before = self.cost(&misfit, &noise, &x);
                if let Some(trial) = self.residuals(&candidate)
                    && self.cost(&trial, &noise, &candidate) < before
                {
                    let gain = 1.0 - self.cost(&trial, &noise, &candidate) / before;
                    (x, misfit) = (candidate, trial);
                    damping = (damping * 0.3).max(1e-9);
                    improved = gain > 1e-6;
                    break;
                }
                damping *= 5.0;
            }
            // The noise is what the best fit leaves; once it is known, the fit is repeated.
            if !improved {
                settled += 1;
                noise = left_noise(&misfit);
                damping = 1e-3;
            }
        }
        let samples: usize = misfit.iter().map(Vec::len).sum();
        let cost = samples as f64 * (noise[0].ln() + noise[1].ln()) + 0.5 * self.prior_cost(&x);
        Some(Found { unknowns: x, misfit, cost, iterations })
    }

    /// Covariance of the unknowns where a search has ended.
    pub(super) fn covariance(&self, found: &Found) -> Option<DMatrix<f64>> {
        let Found { unknowns: x, misfit, .. } = found;
        let jacobian = self.jacobian(x, misfit)?;
        // Residuals in a row that are alike count as one.
        let noise = left_noise(misfit);
        let noise = [0, 1].map(|i| MODEL * noise[i] * alike(misfit, i).sqrt());
        let (normal, _) = self.normal(&jacobian, misfit, &noise, x);
        Some(normal.cholesky()?.inverse())
    }

    /// Flies the pulses of all records; `None` for parameters that are not valid.
    fn residuals(&self, x: &[f64]) -> Option<Vec<Residuals>> {
        (0..self.records.len()).map(|run| self.residuals_of(run, x)).collect()
    }

    fn residuals_of(&self, run: usize, x: &[f64]) -> Option<Residuals> {
        let setup = self.setup(x);
        setup.validate().ok()?;
        let Record { readings, pulses, is_summed } = &self.records[run];
        let first = readings[0];
        let own = SHARED + OWN * run;
        let (pitch, rate) = (first.pitch_rad + x[own], first.rate_rad_s + x[own + 1]);
        let delay = setup.timing.delay_s;
        let start_s = first.time_s + x[own + 2];
        let mut drone = Drone::new(&setup.drone, pitch, rate).ok()?.with_tether_stop(f64::INFINITY);
        let mut pulses = pulses.iter().copied().peekable();

        // Before the start the servo has long settled at the last pulse, or stands at zero rudder.
        let zero = drone.crank().angle_rad;
        let mut servo = Servo::new(setup.servo, zero, start_s - SETTLE_S);
        while let Some((edge, width)) = pulses.next_if(|(edge, _)| *edge < start_s) {
            servo.pulse(edge.max(start_s - SETTLE_S), width);
        }
        let held = Load { torque_n_m: drone.hinge_torque_n_m(), ..drone.crank_load() };
        let crank = servo.advance(start_s, held);
        drone.place_crank(crank.angle_rad);

        let mut residuals = Vec::with_capacity(readings.len());
        // The delay of a sensor that gives rates alone is that of its low-pass, of first order.
        let (late_s, lag_s) = if *is_summed { (0.0, delay) } else { (delay, 0.0) };
        let keep = (-STEP_S / lag_s).exp();
        let mut filtered = drone.rate_rad_s();
        let mut last = [drone.pitch_rad(), filtered];
        let mut steps = 0_u64;
        let (mut summed, mut before_s) = (pitch, first.time_s);
        let end_s = first.time_s + self.horizon_s;
        for reading in readings.iter().take_while(|reading| reading.time_s <= end_s) {
            let seen = reading.time_s - late_s;
            let mut now = start_s + steps as f64 * STEP_S;
            while now < seen {
                let before = drone.rate_rad_s();
                last = [drone.pitch_rad(), filtered];
                steps += 1;
                now = start_s + steps as f64 * STEP_S;
                while let Some((edge, width)) = pulses.next_if(|(edge, _)| *edge < now) {
                    servo.pulse(edge, width);
                }
                let crank = servo.advance(now, drone.crank_load());
                drone.step(STEP_S, crank);
                let after = drone.rate_rad_s();
                // Exact for a rate that changes evenly within the step.
                let lagging = |rate: f64| rate - lag_s * (after - before) / STEP_S;
                filtered = lagging(after) + keep * (filtered - lagging(before));
            }
            let part = ((now - seen) / STEP_S).clamp(0.0, 1.0);
            let ahead = [drone.pitch_rad(), filtered];
            let [pitch_then, rate_then] = [0, 1].map(|i| ahead[i] + part * (last[i] - ahead[i]));
            let residual = if seen < start_s {
                // The pitch is that of the start; a clamp lets it have no rate.
                [reading.pitch_rad - pitch, 0.0]
            } else {
                summed += (reading.time_s - before_s) * rate_then;
                let pitch_then = if *is_summed { summed } else { pitch_then };
                [reading.pitch_rad - pitch_then, reading.rate_rad_s - rate_then]
            };
            before_s = reading.time_s;
            if !residual.iter().all(|r| r.is_finite()) {
                return None;
            }
            residuals.push(residual);
        }
        Some(residuals)
    }

    /// Change of the residuals with each unknown, by differences.
    fn jacobian(&self, x: &[f64], misfit: &[Residuals]) -> Option<DMatrix<f64>> {
        let columns = (0..x.len()).into_par_iter().map(|i| {
            let width = match i.checked_sub(SHARED) {
                None => DIFFERENCE[i],
                Some(own) => START_DIFFERENCE[own % OWN],
            };
            let mut column = Vec::new();
            for (run, here) in misfit.iter().enumerate() {
                if i >= SHARED && (i - SHARED) / OWN != run {
                    column.resize(column.len() + 2 * here.len(), 0.0);
                    continue;
                }
                let at = |by: f64| self.residuals_of(run, &shifted(x, i, by));
                let up = at(width)?;
                // At the edge of the valid range (a delay of zero), one side has to suffice.
                let down = at(-width);
                let (down, width) = match &down {
                    Some(down) => (down, 2.0 * width),
                    None => (here, width),
                };
                let pairs = up.iter().flatten().zip(down.iter().flatten());
                column.extend(pairs.map(|(up, down)| (up - down) / width));
            }
            Some(column)
        });
        let columns: Vec<Vec<f64>> = columns.collect::<Option<_>>()?;
        Some(DMatrix::from_fn(columns[0].len(), x.len(), |row, i| columns[i][row]))
    }

    /// Normal equations with Huber's weights and the priors.
    fn normal(
        &self,
        jacobian: &DMatrix<f64>,
        misfit: &[Residuals],
        noise: &[f64; 2],
        x: &[f64],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut normal = DMatrix::zeros(x.len(), x.len());
        let mut gradient = DVector::zeros(x.len());
        for (row, residual) in misfit.iter().flatten().flatten().enumerate() {
            let sigma = noise[row % 2];
            let size = (residual / sigma).abs();
            let weight = if size > HUBER { HUBER / size } else { 1.0 } / (sigma * sigma);
            let line = jacobian.row(row);
            normal.ger(weight, &line.transpose(), &line.transpose(), 1.0);
            gradient.axpy(-weight * residual, &line.transpose(), 1.0);
        }
        for (i, sigma) in self.priors().enumerate() {
            let weight = 1.0 / (sigma * sigma);
            normal[(i, i)] += weight;
            gradient[i] -= weight * x[i];
        }
        (normal, gradient)
    }

    fn cost(&self, misfit: &[Residuals], noise: &[f64; 2], x: &[f64]) -> f64 {
        let data = misfit.iter().flatten().flatten().enumerate().map(|(row, residual)| {
            let size = (residual / noise[row % 2]).abs();
            if size > HUBER { HUBER * (2.0 * size - HUBER) } else { size * size }
        });
        data.sum::<f64>() + self.prior_cost(x)
    }

    fn prior_cost(&self, x: &[f64]) -> f64 {
        x.iter().zip(self.priors()).map(|(x, sigma)| (x / sigma).powi(2)).sum()
    }

    fn priors(&self) -> impl Iterator<Item = f64> {
        PRIOR.into_iter().chain(START_PRIOR.into_iter().cycle().take(OWN * self.records.len()))
    }

    /// A first guess of the noise: a twentieth of how far the records range, so that no part of
    /// them is an outlier yet.
    fn first_noise(&self) -> [f64; 2] {
        let range = |f: fn(&Reading) -> f64| {
            let readings = self.records.iter().flat_map(|record| &record.readings);
            (0.05 * readings.map(|reading| f(reading).abs()).fold(0.0, f64::max)).max(1e-3)
        };
        [range(|r| r.pitch_rad), range(|r| r.rate_rad_s)]
    }
}

/// The unknowns with one of them changed.
pub(super) fn shifted(x: &[f64], i: usize, by: f64) -> Vec<f64> {
    let mut x = x.to_vec();
    x[i] += by;
    x
}

/// Pitch acceleration for each radian of crank at zero rudder, in 1/s2.
pub(super) fn pitch_gain(setup: &Setup) -> Option<f64> {
    Some(frequency::pitch_gain(&Mechanism::new(&setup.drone).ok()?))
}

/// The noise that a fit leaves: rms, not below [`LEAST_NOISE`].
fn left_noise(misfit: &[Residuals]) -> [f64; 2] {
    [0, 1].map(|channel| rms(misfit, channel).max(LEAST_NOISE[channel]))
}

fn rms(misfit: &[Residuals], channel: usize) -> f64 {
    let squares = misfit.iter().flatten().map(|residual| residual[channel].powi(2));
    let samples: usize = misfit.iter().map(Vec::len).sum();
    (squares.sum::<f64>() / samples as f64).sqrt()
}

/// How many residuals of pitch or rate in a row are alike: the sum of their autocorrelation.
fn alike(misfit: &[Residuals], channel: usize) -> f64 {
    let product = |lag: usize| -> f64 {
        let pairs = misfit.iter().flat_map(|run| run.iter().zip(run.iter().skip(lag)));
        pairs.map(|(a, b)| a[channel] * b[channel]).sum()
    };
    let whole = product(0);
    let longest = misfit.iter().map(Vec::len).max().unwrap_or(0);
    let shares = (1..longest).map(|lag| product(lag) / whole);
    1.0 + 2.0 * shares.take_while(|share| *share > INDEPENDENT).sum::<f64>()
}
