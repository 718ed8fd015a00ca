//! Parameters from recorded runs: thrust, inertia, servo speed and sensor delay.
//!
//! The pulses of a record drive the model of servo and drone. The search moves the parameters until
//! the model's pitch and rate, seen through the sensor, match the record. Each record has
//! its own pitch and rate at the start and its own time of the release, which are estimated along,
//! as is the horn's fitting: the drone integrates their errors twice.
//!
//! Each parameter starts from the nominal setup with a prior spread. A standard deviation near
//! [`Estimate::prior`] means that the records do not show the parameter. Above all they show the
//! quotient of thrust and inertia, [`Identification::pitch_gain`]. Either alone shows only in small
//! effects, the crank's reaction and the servo that the wash slows down.
//!
//! The deviations count the noise that the best fit leaves, and that its neighbours in time are
//! alike: what the model lacks looks like slow noise.

mod fit;

use nalgebra::DMatrix;
use rayon::prelude::*;
use serde::Serialize;

use crate::response::first_bad_sample;
use crate::setup::{Setup, SetupError};
use fit::{Fit, INERTIA, SHARED, SPEED, THRUST, pitch_gain};

/// Fewest samples of a record.
const FEWEST_SAMPLES: usize = 50;
/// Where the search begins: by how much the logarithms of thrust and servo speed are off the
/// nominal ones.
const STARTS: [[f64; 2]; 5] = [[0.0, 0.0], [-0.4, -0.4], [-0.4, 0.4], [0.4, -0.4], [0.4, 0.4]];
/// Two parameters whose errors correlate by more than this cannot be told apart.
const ALIKE: f64 = 0.95;

/// Largest misfit of a right model, rms, rad: an attitude is off by 1 to 2 mrad.
pub const MOST_MISFIT_RAD: f64 = 5e-3;

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
    /// Whether a pitch is the sum of the rates, each over the time since the reading before, as the
    /// firmware estimates it; else the sensor measured it.
    pub is_summed: bool,
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
    /// Name of the parameter in a vehicle's file.
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

/// What records have shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// The nominal setup with the estimates in it.
    pub setup: Setup,
    /// The estimates: thrust, inertia, servo speed, sensor delay, horn.
    pub estimates: Vec<Estimate>,
    /// Pitch acceleration for each radian of crank at zero rudder, in 1/s2: what gains scale with.
    pub pitch_gain: Estimate,
    /// Pairs of parameters that the records do not tell apart.
    pub alike: Vec<[&'static str; 2]>,
    /// Misfit of the pitch, rms, in rad.
    pub pitch_rms_rad: f64,
    /// Misfit of the rate, rms, in rad/s.
    pub rate_rms_rad_s: f64,
    /// Steps of the search that found the estimates.
    pub iterations: usize,
}

impl Identification {
    /// Whether the model with the estimates explains the records.
    pub fn explains(&self) -> bool {
        self.pitch_rms_rad <= MOST_MISFIT_RAD
    }
}

/// Identifies the parameters from records of one drone, starting from a nominal setup and from
/// neighbours of it.
///
/// # Errors
/// See [`IdentifyError`].
pub fn identify(nominal: &Setup, records: &[Record]) -> Result<Identification, IdentifyError> {
    nominal.validate()?;
    let fit = Fit::new(nominal, records)?;
    let best = search(&fit)?;
    report(&fit, &best)
}

/// The best that is found from all starts.
fn search(fit: &Fit<'_>) -> Result<fit::Found, IdentifyError> {
    let found = STARTS.into_par_iter().filter_map(|[thrust, speed]| {
        let mut start = fit.nominal_unknowns();
        (start[THRUST], start[SPEED]) = (thrust, speed);
        let near = fit.of_beginning().search(start)?;
        fit.search(near.unknowns)
    });
    found.min_by(|a, b| a.cost.total_cmp(&b.cost)).ok_or(IdentifyError::NoFit)
}

/// Of a run that was recorded in several ways, the record that the model explains best.
///
/// # Errors
/// See [`IdentifyError`].
pub fn likeliest(nominal: &Setup, records: Vec<Record>) -> Result<Record, IdentifyError> {
    nominal.validate()?;
    if let [only] = records.as_slice() {
        return check(only).map(|()| only.clone());
    }
    let costs = records.par_iter().map(|record| {
        let fit = Fit::new(nominal, std::slice::from_ref(record))?;
        // The beginning twice: searched once, one vehicle of 16 got the wrong record.
        Ok(search(&fit.of_beginning())?.cost)
    });
    let costs = costs.collect::<Result<Vec<f64>, IdentifyError>>()?;
    let best = records.into_iter().zip(costs).min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(record, _)| record).ok_or(IdentifyError::NoFit)
}

/// Whether a record can be used.
fn check(record: &Record) -> Result<(), IdentifyError> {
    let Record { readings, pulses, .. } = record;
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
    if moved < 0.02 || steered < 10.0 { Err(IdentifyError::NoMotion) } else { Ok(()) }
}

/// What the best fit says.
fn report(fit: &Fit<'_>, found: &fit::Found) -> Result<Identification, IdentifyError> {
    let x = &found.unknowns;
    let covariance = fit.covariance(found).ok_or(IdentifyError::NoFit)?;
    let deviation = |i: usize| covariance[(i, i)].sqrt();
    let (setup, nominal) = (fit.setup(x), fit.setup(&fit.nominal_unknowns()));
    let values = [&nominal, &setup].map(|setup| {
        let Setup { drone, servo, timing } = setup;
        [
            drone.thrust_n,
            drone.body_inertia_kg_m2,
            servo.speed_rad_s,
            timing.delay_s,
            servo.horn_rad,
        ]
    });
    let [before, after] = values;
    let estimates: Vec<Estimate> = (0..SHARED)
        .map(|i| {
            // The first three are shares of the value.
            let scale = |value: f64| if i <= SPEED { value } else { 1.0 };
            Estimate {
                name: NAMES[i],
                nominal: before[i],
                value: after[i],
                deviation: scale(after[i]) * deviation(i),
                prior: scale(before[i]) * fit::PRIOR[i],
            }
        })
        .collect();
    let alike = (0..SHARED)
        .flat_map(|i| (i + 1..SHARED).map(move |k| (i, k)))
        .filter(|&(i, k)| (covariance[(i, k)] / (deviation(i) * deviation(k))).abs() > ALIKE);
    Ok(Identification {
        alike: alike.map(|(i, k)| [NAMES[i], NAMES[k]]).collect(),
        pitch_gain: gain(fit, x, &covariance)?,
        setup,
        estimates,
        pitch_rms_rad: found.rms(0),
        rate_rms_rad_s: found.rms(1),
        iterations: found.iterations,
    })
}

/// Names of the shared unknowns in a vehicle's file.
const NAMES: [&str; SHARED] =
    ["thrust_n", "body_inertia_kg_m2", "speed_rad_s", "delay_s", "horn_rad"];

/// The pitch gain, whose spread follows from its slope along thrust and inertia.
fn gain(fit: &Fit<'_>, x: &[f64], covariance: &DMatrix<f64>) -> Result<Estimate, IdentifyError> {
    let of = |x: &[f64]| pitch_gain(&fit.setup(x)).ok_or(IdentifyError::NoFit);
    let mut slopes = [0.0; 2];
    for (slope, i) in slopes.iter_mut().zip([THRUST, INERTIA]) {
        let at = |by: f64| of(&fit::shifted(x, i, by));
        *slope = (at(1e-4)? - at(-1e-4)?) / 2e-4;
    }
    let [thrust, inertia] = slopes;
    let spread = |variance: [f64; 2], both: f64| {
        let own = thrust * thrust * variance[0] + inertia * inertia * variance[1];
        (own + 2.0 * thrust * inertia * both).max(0.0).sqrt()
    };
    let variances = [THRUST, INERTIA].map(|i| covariance[(i, i)]);
    let priors = [THRUST, INERTIA].map(|i| fit::PRIOR[i] * fit::PRIOR[i]);
    Ok(Estimate {
        name: "pitch_gain",
        nominal: of(&fit.nominal_unknowns())?,
        value: of(x)?,
        deviation: spread(variances, covariance[(THRUST, INERTIA)]),
        prior: spread(priors, 0.0),
    })
}
