//! Margins of the loop with the image's own controller, servo and frame in it.
//!
//! They are measured as on a test bench. The gain is raised, or delay added, until the model does
//! not come to rest. A small sine on what the sensor measures shows how much of it the loop takes
//! up. So they hold for the law as it is, with its model and its frame, where a transfer function
//! would be another law.

use std::f64::consts::TAU;
use std::ops::Range;

use plant::pitch_loop::PitchLoop;
use plant::{ParameterError, Setup};
use rayon::prelude::*;
use tvc_nano::Params;

use crate::control_law::Law;
use report::measure::{Figure, Limit::AtLeast, figure};

/// Step of the model, s.
const STEP_S: f64 = 1e-3;
/// Start of a flight that is to come to rest, rad, and its length, s.
const START_RAD: f64 = 0.05;
const FLIGHT_S: f64 = 4.0;
/// A loop that oscillates by more in its last second is lost, and by less it is quiet, rad.
const LOST_RAD: f64 = 0.02;
const QUIET_RAD: f64 = 5e-3;
/// Largest factor on the gain and longest delay that are tried (s).
const MOST_GAIN: f64 = 8.0;
const MOST_DELAY_S: f64 = 0.1;
/// Halvings of the interval in which a margin lies.
const HALVINGS: u32 = 8;
/// Amplitude of the sine, rad; how long it is not counted and then is, in periods.
const SINE_RAD: f64 = 5e-3;
const SETTLE_PERIODS: f64 = 4.0;
const COUNTED_PERIODS: f64 = 6.0;
/// Frequencies of the sine, rad/s: the first, and the factor from one to the next.
const SLOWEST_RAD_S: f64 = 3.0;
const FASTER: f64 = 1.2;
const FREQUENCIES: i32 = 18;

/// How far the loop is from instability.
#[derive(Debug, Clone, Copy)]
pub struct Margins {
    /// Gain that may be added until the loop is lost, dB.
    pub gain_db: f64,
    /// Gain that may be added until it oscillates by 5 mrad, dB.
    pub quiet_db: f64,
    /// Delay that may be added, s.
    pub delay_s: f64,
    /// Largest sensitivity: what is left, over the sine on the measured pitch.
    pub peak_sensitivity: f64,
    /// Where that is, rad/s.
    pub peak_rad_s: f64,
}

impl Margins {
    /// The figures, the gain margin held to at least `gain_db`.
    pub fn figures(&self, gain_db: f64) -> Figure {
        figure(
            "margins",
            [
                figure("gain_db", self.gain_db)
                    .shown("gain margin", "dB", 1)
                    .limit(AtLeast(gain_db)),
                figure("quiet_db", self.quiet_db).shown("to 5 mrad of oscillation", "dB", 1),
                figure("delay_s", self.delay_s).shown("delay margin", "ms", 1).scaled(1e3),
                figure("peak_sensitivity", self.peak_sensitivity).shown("peak sensitivity", "", 2),
                figure("peak_rad_s", self.peak_rad_s).shown("at", "rad/s", 1),
            ],
        )
    }
}

/// Margins near upright.
///
/// # Errors
/// A parameter of the drone out of range.
pub fn of(setup: &Setup, params: &Params) -> Result<Margins, ParameterError> {
    let gain_db = |rest_rad| -> Result<f64, ParameterError> {
        let gain = largest(1.0, MOST_GAIN, |gain| {
            Ok(oscillation_rad(setup, params, gain, 0.0)? < rest_rad)
        })?;
        Ok(20.0 * gain.log10())
    };
    let delay_s = largest(0.0, MOST_DELAY_S, |delay_s| {
        Ok(oscillation_rad(setup, params, 1.0, delay_s)? < LOST_RAD)
    })?;
    let (peak_sensitivity, peak_rad_s) = peak(setup, params, 0..FREQUENCIES)?;
    let [gain_db, quiet_db] = [gain_db(LOST_RAD)?, gain_db(QUIET_RAD)?];
    Ok(Margins { gain_db, quiet_db, delay_s, peak_sensitivity, peak_rad_s })
}

/// The largest sensitivity at the frequencies where fast loops have it, 10 to 27 rad/s.
///
/// # Errors
/// A parameter of the drone out of range.
pub fn likely_peak(setup: &Setup, params: &Params) -> Result<f64, ParameterError> {
    Ok(peak(setup, params, 7..13)?.0)
}

/// The largest sensitivity at some of the frequencies, and where that is, rad/s.
fn peak(
    setup: &Setup,
    params: &Params,
    frequencies: Range<i32>,
) -> Result<(f64, f64), ParameterError> {
    let sensitivities: Vec<(f64, f64)> = frequencies
        .into_par_iter()
        .map(|index| {
            let rad_s = SLOWEST_RAD_S * FASTER.powi(index);
            Ok((sensitivity(setup, params, rad_s)?, rad_s))
        })
        .collect::<Result<_, ParameterError>>()?;
    let larger = |peak: (f64, f64), at: (f64, f64)| if at.0 > peak.0 { at } else { peak };
    Ok(sensitivities.into_iter().fold((0.0, 0.0), larger))
}

/// The largest value between two for which `is_stable` holds.
fn largest(
    mut low: f64,
    mut high: f64,
    is_stable: impl Fn(f64) -> Result<bool, ParameterError>,
) -> Result<f64, ParameterError> {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if is_stable(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(low)
}

/// The largest pitch, rad, in the last second of a flight whose crank moves `gain` times as far,
/// and whose sensor is `delay_s` later.
fn oscillation_rad(
    setup: &Setup,
    params: &Params,
    gain: f64,
    delay_s: f64,
) -> Result<f64, ParameterError> {
    let mut timing = setup.timing;
    timing.step_s = STEP_S;
    timing.delay_s += delay_s;
    let zero_rad = setup.drone.linkage().zero_rudder_crank_rad();
    let mut law = Law::new(params, &setup.drone, &timing);
    let mut flight = PitchLoop::new(&setup.drone, setup.servo, timing, START_RAD, 0.0)?;
    let steps = (FLIGHT_S / STEP_S) as u32;
    let last = steps - (1.0 / STEP_S) as u32;
    let mut largest_rad = 0.0_f64;
    for step in 0..steps {
        let sample = flight.step(|m| zero_rad + gain * (law.update(m) - zero_rad));
        if step >= last {
            largest_rad = largest_rad.max(sample.pitch_rad.abs());
        }
    }
    Ok(largest_rad)
}

/// What a sine of a frequency on the measured pitch and its rate becomes, as a share of it: by
/// correlation with sine and cosine over whole periods.
fn sensitivity(setup: &Setup, params: &Params, rad_s: f64) -> Result<f64, ParameterError> {
    let mut timing = setup.timing;
    timing.step_s = STEP_S;
    let mut law = Law::new(params, &setup.drone, &timing);
    let mut flight = PitchLoop::new(&setup.drone, setup.servo, timing, 0.0, 0.0)?;
    let period_s = TAU / rad_s;
    let begin = (SETTLE_PERIODS * period_s / STEP_S) as u32;
    let end = begin + (COUNTED_PERIODS * period_s / STEP_S) as u32;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for step in 0..end {
        let sample = flight.step(|mut m| {
            let angle = rad_s * m.time_s;
            m.pitch_rad += SINE_RAD * angle.sin();
            m.rate_rad_s += SINE_RAD * rad_s * angle.cos();
            law.update(m)
        });
        if step >= begin {
            let angle = rad_s * sample.time_s;
            let left = sample.pitch_rad + SINE_RAD * angle.sin();
            sine += left * angle.sin();
            cosine += left * angle.cos();
        }
    }
    let scale = 2.0 / f64::from(end - begin) / SINE_RAD;
    Ok((scale * sine).hypot(scale * cosine))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::free::State;
    use plant::linear::frequency::OpenLoop;
    use plant::mechanism::Mechanism;

    /// A law that has a transfer function, whose margins `tvc model linear` finds.
    #[test]
    fn a_plain_law_has_the_margins_of_its_transfer_function() {
        let setup = crate::vehicle::VehicleChoice::default().drone(rig::ServoKind::S3003).unwrap();
        let mut params = Params::default();
        for (name, value) in [("PID_LAW", 0.0), ("PID_KP", 1.0), ("PID_KD", 0.3)] {
            params.set(name, value).unwrap();
        }
        let found = of(&setup, &params).unwrap();
        let mechanism = Mechanism::new(&setup.drone).unwrap();
        let mut timing = setup.timing;
        timing.delay_s += 0.5 * timing.refresh_s.unwrap() + timing.lead_s.unwrap();
        let crank_rad = mechanism.linkage().zero_rudder_crank_rad();
        let upright = State { crank_rad, ..State::default() };
        let mut open = OpenLoop::new(&mechanism, &upright, &setup.servo, &timing, 1.0, 0.3);
        open.rate_filter_rad_s = f64::INFINITY;
        let expected = open.margins();
        let delay_s = expected.phase.unwrap().delay_s;
        assert!((found.gain_db - expected.gain.unwrap().db).abs() < 2.0, "{found:?} {expected:?}");
        assert!((found.delay_s / delay_s - 1.0).abs() < 0.25, "{found:?} {expected:?}");
        let peak = expected.peak_sensitivity;
        assert!((found.peak_sensitivity / peak - 1.0).abs() < 0.2, "{found:?} {expected:?}");
    }

    #[test]
    fn the_largest_of_an_interval_is_found() {
        let found = largest(1.0, 3.0, |value| Ok(value < 2.345)).unwrap();
        assert!((found - 2.345).abs() < 0.01);
    }
}
