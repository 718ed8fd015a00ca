//! Parameters from a recorded run: thrust, inertia, servo speed and sensor delay.
//!
//! The record's pulses drive the model of servo and drone; Levenberg-Marquardt moves the
//! parameters until the model's pitch and rate, seen through the sensor's delay, match the record.
//! The start (pitch, rate) and the horn's fitting are estimated along, because the drone integrates
//! their errors twice.
//!
//! Each parameter starts from the nominal setup with a prior spread. What the record says nothing
//! about keeps its prior: a standard deviation near [`Estimate::prior`] means "not seen in this
//! record". Above all a record shows the quotient of thrust and inertia,
//! [`Identification::pitch_gain`]; the two apart only by small effects (the crank's reaction, the
//! servo slowed by the wash), so that their spreads are some ten times larger. Spreads count noise,
//! not what the model leaves out.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::drone::Drone;
use crate::linear::frequency;
use crate::mechanism::Mechanism;
use crate::response::first_bad_sample;
use crate::servo::Servo;
use crate::setup::{Setup, SetupError};

/// Step of the model, in s.
const STEP_S: f64 = 0.5e-3;
/// Time for which the servo is given its first pulse before the record starts, in s.
const SETTLE_S: f64 = 0.5;
/// Iterations after which the search is given up.
const ITERATIONS: usize = 60;
/// Weight of a large residual is cut beyond this many standard deviations: quantisation, play and
/// a lost sample are not Gaussian.
const HUBER: f64 = 3.0;
/// Fewest samples that an identification accepts.
const FEWEST_SAMPLES: usize = 50;

/// A pitch and rate as the sensor reported them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time of the report, in s.
    pub time_s: f64,
    /// Pitch, in rad.
    pub pitch_rad: f64,
    /// Pitch rate, in rad/s.
    pub rate_rad_s: f64,
}

/// A recorded run of the free drone: from the release on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Readings in order of time; the first one is the start.
    pub readings: Vec<Reading>,
    /// Servo pulses `(rising edge in s, width in us)` in order, on the same clock. One before the
    /// start says where the rudder stood.
    pub pulses: Vec<(f64, f64)>,
}

/// Why a record cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// The nominal setup is not valid.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// Too little data.
    #[error("the record has {found} readings and {pulses} pulses; at least 50 and 2 are needed")]
    TooShort {
        /// Readings found.
        found: usize,
        /// Pulses found.
        pulses: usize,
    },
    /// Times that do not increase or values that are not finite.
    #[error("reading or pulse {0} is not finite or not later than the one before it")]
    BadSample(usize),
    /// The drone hardly moved or the pulses never changed.
    #[error("the record shows no motion to learn from")]
    NoMotion,
    /// The search ended without a minimum.
    #[error("no parameters within reason explain the record")]
    NoFit,
}

/// One identified quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Name of the parameter in a parameter file.
    pub name: &'static str,
    /// Nominal value, SI.
    pub nominal: f64,
    /// Estimate, SI.
    pub value: f64,
    /// Standard deviation of the estimate, SI.
    pub deviation: f64,
    /// Standard deviation before the record was seen, SI.
    pub prior: f64,
}

/// What a record has shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// The nominal setup with the estimates in it.
    pub setup: Setup,
    /// The estimates: thrust, inertia, servo speed, sensor delay, horn.
    pub estimates: Vec<Estimate>,
    /// Pitch acceleration for each radian of crank at zero rudder, in 1/s2: what gains scale with.
    pub pitch_gain: Estimate,
    /// Misfit of the pitch, rms, in rad.
    pub pitch_rms_rad: f64,
    /// Misfit of the rate, rms, in rad/s.
    pub rate_rms_rad_s: f64,
    /// Steps of the search.
    pub iterations: usize,
}

/// The unknowns: five parameters, then pitch and rate at the start.
const UNKNOWNS: usize = 7;
const THRUST: usize = 0;
const INERTIA: usize = 1;
const SPEED: usize = 2;
const DELAY: usize = 3;
const HORN: usize = 4;

/// Prior standard deviations: shares for thrust, inertia and speed; s; rad; rad; rad/s.
const PRIOR: [f64; UNKNOWNS] = [0.3, 0.3, 0.3, 0.010, 0.03, 0.05, 0.2];
/// Steps of the differences: wide enough to average over play and deadband.
const DIFFERENCE: [f64; UNKNOWNS] = [0.01, 0.01, 0.01, 0.5e-3, 2e-3, 1e-3, 2e-3];

/// A candidate, as offsets from the nominal (relative for the first three).
type Unknowns = [f64; UNKNOWNS];

/// Identifies the parameters from a record, starting from a nominal setup.
///
/// # Errors
/// See [`IdentifyError`].
pub fn identify(nominal: &Setup, record: &Record) -> Result<Identification, IdentifyError> {
    nominal.validate()?;
    let fit = Fit::new(nominal, record)?;
    let mut x: Unknowns = [0.0; UNKNOWNS];
    let mut noise = fit.first_noise();
    let mut misfit = fit.residuals(&x).ok_or(IdentifyError::NoFit)?;
    let mut damping = 1e-3;
    let mut iterations = 0;
    let mut settled = 0;
    while iterations < ITERATIONS && settled < 2 {
        iterations += 1;
        let jacobian = fit.jacobian(&x, &misfit).ok_or(IdentifyError::NoFit)?;
        let (normal, gradient) = fit.normal(&jacobian, &misfit, &noise, &x);
        let mut improved = false;
        for _ in 0..12 {
            let mut damped = normal.clone();
            for i in 0..UNKNOWNS {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(factor) = damped.cholesky() else {
                damping *= 10.0;
                continue;
            };
            let step = factor.solve(&gradient);
            let candidate: Unknowns = std::array::from_fn(|i| x[i] + step[i]);
            let before = fit.cost(&misfit, &noise, &x);
            if let Some(trial) = fit.residuals(&candidate)
                && fit.cost(&trial, &noise, &candidate) < before
            {
                let gain = 1.0 - fit.cost(&trial, &noise, &candidate) / before;
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
            noise = fit.noise(&misfit);
            damping = 1e-3;
        }
    }
    fit.report(&x, &misfit, &noise, iterations)
}

/// Differences between record and model: pitch and rate of each reading.
type Residuals = Vec<[f64; 2]>;

struct Fit<'a> {
    nominal: &'a Setup,
    record: &'a Record,
    first: Reading,
}

impl<'a> Fit<'a> {
    fn new(nominal: &'a Setup, record: &'a Record) -> Result<Self, IdentifyError> {
        let (readings, pulses) = (&record.readings, &record.pulses);
        if readings.len() < FEWEST_SAMPLES || pulses.len() < 2 {
            return Err(IdentifyError::TooShort { found: readings.len(), pulses: pulses.len() });
        }
        let bad = first_bad_sample(readings.iter().map(|r| [r.time_s, r.pitch_rad, r.rate_rad_s]))
            .or_else(|| first_bad_sample(pulses.iter().map(|&(edge, width)| [edge, width])));
        if let Some(index) = bad {
            return Err(IdentifyError::BadSample(index));
        }
        let spread = |values: &mut dyn Iterator<Item = f64>| {
            let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
            high - low
        };
        let moved = spread(&mut readings.iter().map(|r| r.pitch_rad));
        let steered = spread(&mut pulses.iter().map(|p| p.1));
        if moved < 0.02 || steered < 10.0 {
            return Err(IdentifyError::NoMotion);
        }
        Ok(Self { nominal, record, first: readings[0] })
    }

    fn setup(&self, x: &Unknowns) -> Setup {
        let mut setup = *self.nominal;
        setup.drone.thrust_n *= 1.0 + x[THRUST];
        setup.drone.body_inertia_kg_m2 *= 1.0 + x[INERTIA];
        setup.servo.speed_rad_s *= 1.0 + x[SPEED];
        setup.timing.delay_s += x[DELAY];
        setup.servo.horn_rad += x[HORN];
        setup
    }

    /// Flies the record's pulses; `None` for parameters that are not valid.
    fn residuals(&self, x: &Unknowns) -> Option<Residuals> {
        let setup = self.setup(x);
        setup.validate().ok()?;
        let delay = setup.timing.delay_s;
        let start_s = self.first.time_s;
        let pitch = self.first.pitch_rad + x[5];
        let rate = self.first.rate_rad_s + x[6];
        let mut drone = Drone::new(&setup.drone, pitch, rate).ok()?.with_tether_stop(f64::INFINITY);
        let mut pulses = self.record.pulses.iter().copied().peekable();

        // Before the start the servo has long settled at the last pulse, or stands at zero rudder.
        let zero = drone.crank().angle_rad;
        let mut servo = Servo::new(setup.servo, zero, start_s - SETTLE_S);
        while let Some((edge, width)) = pulses.next_if(|(edge, _)| *edge < start_s) {
            servo.pulse(edge.max(start_s - SETTLE_S), width);
        }
        let crank = servo.advance(start_s, 0.0);
        drone.place_crank(crank.angle_rad);

        let mut residuals = Vec::with_capacity(self.record.readings.len());
        let mut last = [drone.pitch_rad(), drone.rate_rad_s()];
        let mut steps = 0_u64;
        for reading in &self.record.readings {
            let seen = reading.time_s - delay;
            let mut now = start_s + steps as f64 * STEP_S;
            while now < seen {
                last = [drone.pitch_rad(), drone.rate_rad_s()];
                steps += 1;
                now = start_s + steps as f64 * STEP_S;
                while let Some((edge, width)) = pulses.next_if(|(edge, _)| *edge < now) {
                    servo.pulse(edge, width);
                }
                let crank = servo.advance(now, drone.hinge_torque_n_m());
                drone.step(STEP_S, crank);
            }
            let part = ((now - seen) / STEP_S).clamp(0.0, 1.0);
            let ahead = [drone.pitch_rad(), drone.rate_rad_s()];
            // What the sensor showed before the release is the start itself.
            let model = [0, 1].map(|i| {
                if seen < start_s {
                    [pitch, rate][i]
                } else {
                    ahead[i] + part * (last[i] - ahead[i])
                }
            });
            let residual = [reading.pitch_rad - model[0], reading.rate_rad_s - model[1]];
            if !residual.iter().all(|r| r.is_finite()) {
                return None;
            }
            residuals.push(residual);
        }
        Some(residuals)
    }

    /// Change of the residuals with each unknown, by differences.
    fn jacobian(&self, x: &Unknowns, misfit: &Residuals) -> Option<DMatrix<f64>> {
        let mut jacobian = DMatrix::zeros(2 * misfit.len(), UNKNOWNS);
        for i in 0..UNKNOWNS {
            let shifted = |by: f64| self.residuals(&shifted(x, i, by));
            // At the edge of the valid range (a delay of zero), one side has to suffice.
            let up = shifted(DIFFERENCE[i])?;
            let (down, width) = match shifted(-DIFFERENCE[i]) {
                Some(down) => (down, 2.0 * DIFFERENCE[i]),
                None => (misfit.clone(), DIFFERENCE[i]),
            };
            for (row, (u, d)) in up.iter().flatten().zip(down.iter().flatten()).enumerate() {
                jacobian[(row, i)] = (u - d) / width;
            }
        }
        Some(jacobian)
    }

    /// Normal equations with Huber's weights and the priors.
    fn normal(
        &self,
        jacobian: &DMatrix<f64>,
        misfit: &Residuals,
        noise: &[f64; 2],
        x: &Unknowns,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut normal = DMatrix::zeros(UNKNOWNS, UNKNOWNS);
        let mut gradient = DVector::zeros(UNKNOWNS);
        for (row, residual) in misfit.iter().flatten().enumerate() {
            let sigma = noise[row % 2];
            let size = (residual / sigma).abs();
            let weight = if size > HUBER { HUBER / size } else { 1.0 } / (sigma * sigma);
            let line = jacobian.row(row);
            normal.ger(weight, &line.transpose(), &line.transpose(), 1.0);
            gradient.axpy(-weight * residual, &line.transpose(), 1.0);
        }
        for i in 0..UNKNOWNS {
            let weight = 1.0 / (PRIOR[i] * PRIOR[i]);
            normal[(i, i)] += weight;
            gradient[i] -= weight * x[i];
        }
        (normal, gradient)
    }

    fn cost(&self, misfit: &Residuals, noise: &[f64; 2], x: &Unknowns) -> f64 {
        let data: f64 = misfit
            .iter()
            .flatten()
            .enumerate()
            .map(|(row, residual)| {
                let size = (residual / noise[row % 2]).abs();
                if size > HUBER { HUBER * (2.0 * size - HUBER) } else { size * size }
            })
            .sum();
        let prior: f64 = x.iter().zip(PRIOR).map(|(x, sigma)| (x / sigma).powi(2)).sum();
        data + prior
    }

    /// A first guess of the noise: a percent of how far the record ranges, so that no part of it is
    /// an outlier yet.
    fn first_noise(&self) -> [f64; 2] {
        let range = |f: fn(&Reading) -> f64| {
            let values = self.record.readings.iter().map(|r| f(r).abs());
            (0.05 * values.fold(0.0, f64::max)).max(1e-3)
        };
        [range(|r| r.pitch_rad), range(|r| r.rate_rad_s)]
    }

    /// The noise that a fit leaves: rms, not below a floor that only perfect data would reach.
    fn noise(&self, misfit: &Residuals) -> [f64; 2] {
        [0, 1].map(|i| rms(misfit, i).max(1e-4))
    }

    fn report(
        &self,
        x: &Unknowns,
        misfit: &Residuals,
        noise: &[f64; 2],
        iterations: usize,
    ) -> Result<Identification, IdentifyError> {
        let jacobian = self.jacobian(x, misfit).ok_or(IdentifyError::NoFit)?;
        let (normal, _) = self.normal(&jacobian, misfit, noise, x);
        let covariance = normal.cholesky().ok_or(IdentifyError::NoFit)?.inverse();
        let deviation = |i: usize| covariance[(i, i)].sqrt();
        let setup = self.setup(x);
        let n = self.nominal;
        let scales = [
            ("thrust_n", n.drone.thrust_n, n.drone.thrust_n),
            ("body_inertia_kg_m2", n.drone.body_inertia_kg_m2, n.drone.body_inertia_kg_m2),
            ("speed_rad_s", n.servo.speed_rad_s, n.servo.speed_rad_s),
            ("delay_s", n.timing.delay_s, 1.0),
            ("horn_rad", n.servo.horn_rad, 1.0),
        ];
        let estimates = scales
            .into_iter()
            .enumerate()
            .map(|(i, (name, nominal, scale))| Estimate {
                name,
                nominal,
                value: nominal + scale * x[i],
                deviation: scale * deviation(i),
                prior: scale * PRIOR[i],
            })
            .collect();

        // The pitch gain's spread follows from its slope along thrust and inertia.
        let gain = |x: &Unknowns| pitch_gain(&self.setup(x)).ok_or(IdentifyError::NoFit);
        let mut slopes = DVector::zeros(UNKNOWNS);
        for i in [THRUST, INERTIA] {
            let shifted = |by: f64| gain(&shifted(x, i, by)).unwrap_or(f64::NAN);
            slopes[i] = (shifted(1e-4) - shifted(-1e-4)) / 2e-4;
        }
        let spread = |matrix: &DMatrix<f64>| slopes.dot(&(matrix * &slopes)).sqrt();
        let variances = PRIOR.map(|sigma| sigma * sigma);
        let prior = DMatrix::from_diagonal(&DVector::from_row_slice(&variances));
        Ok(Identification {
            pitch_gain: Estimate {
                name: "pitch_gain",
                nominal: gain(&[0.0; UNKNOWNS])?,
                value: gain(x)?,
                deviation: spread(&covariance),
                prior: spread(&prior),
            },
            setup,
            estimates,
            pitch_rms_rad: rms(misfit, 0),
            rate_rms_rad_s: rms(misfit, 1),
            iterations,
        })
    }
}

/// The unknowns with one of them changed.
fn shifted(x: &Unknowns, i: usize, by: f64) -> Unknowns {
    let mut x = *x;
    x[i] += by;
    x
}

/// Pitch acceleration for each radian of crank at zero rudder, in 1/s2.
fn pitch_gain(setup: &Setup) -> Option<f64> {
    Some(frequency::pitch_gain(&Mechanism::new(&setup.drone).ok()?))
}

fn rms(misfit: &Residuals, i: usize) -> f64 {
    let sum: f64 = misfit.iter().map(|r| r[i] * r[i]).sum();
    (sum / misfit.len() as f64).sqrt()
}
