//! Another filter on the counts of a log.

use anyhow::Result;
use recordings::{
    Choice, Estimate, Facts, FilterName, Mode, RecordedSample, Scalar, Setting, smooth,
};
use tvc_fusion::Quaternion;
use tvc_fusion::fixed::Scale;
use tvc_nano::{Params, mount::Mount};

use flights::log::Flight;
use report::exit::BadInput;

/// Time and pitch (rad) after every sample, by a filter in single precision with its default gains;
/// `offline`: in both directions of time, so that what comes later counts too.
pub fn pitches(
    filter: FilterName,
    offline: bool,
    flight: &Flight,
    params: &Params,
) -> Result<Vec<(f64, f64)>> {
    let choice = Choice {
        filter,
        scalar: Scalar::F32,
        mode: Mode::NineD,
        settings: vec![Setting {
            key: "declination_rad".into(),
            value: params.declination_deg().to_radians().to_string(),
        }],
    };
    let scale = Scale::BNO055;
    let facts = Facts {
        period_s: f64::from(params.control_period_us()) * 1e-6,
        scale,
        gyro_range_rad_s: None,
    };
    let samples = samples(flight, params);
    let pitch = |q: [f64; 4]| {
        let [w, x, y, z] = q.map(|c| c as f32);
        f64::from(Quaternion { w, x, y, z }.pitch())
    };
    let times = samples.iter().map(|(_, sample)| sample.time_s);
    if offline {
        let recorded: Vec<_> = samples.iter().map(|(_, sample)| *sample).collect();
        let smoothed = smooth(&choice, &facts, &recorded).map_err(BadInput::new)?;
        return Ok(times.zip(smoothed.into_iter().map(pitch)).collect());
    }
    let mut estimate = Estimate::new(&choice, &facts).map_err(BadInput::new)?;
    let estimated = samples.iter().map(|(dt_s, sample)| pitch(estimate.step(*dt_s, sample)));
    Ok(times.zip(estimated).collect())
}

/// The log's samples in the body's axes, each with the time step, s, as the firmware rounds it.
fn samples(flight: &Flight, params: &Params) -> Vec<(f64, RecordedSample)> {
    let scale = Scale::BNO055;
    let mount = Mount::new(params);
    let si = |counts: [i16; 3], unit: f32| counts.map(|c| f64::from(c) * f64::from(unit));
    let mut last = None;
    let mut last_field = None;
    let mut samples = Vec::new();
    for raw in flight.steps().filter_map(|step| step.sample) {
        let before = last.replace(raw.time.0);
        let dt_us = before
            .map_or(params.control_period_us().into(), |before| raw.time.0.saturating_sub(before));
        let counts = mount.convert(&raw, &raw.gyr);
        // The registers repeat until the magnetometer has measured again.
        let fresh = last_field.replace(raw.mag) != Some(raw.mag);
        let sample = RecordedSample {
            time_s: raw.time.0 as f64 * 1e-6,
            gyr_rad_s: si(counts.gyr, scale.gyr_rad_s),
            acc_m_s2: si(counts.acc, scale.acc_m_s2),
            mag_ut: counts.mag.filter(|_| fresh).map(|mag| si(mag, scale.mag_ut)),
            reference: None,
            movement: true,
        };
        samples.push((f64::from(dt_us as f32 * 1e-6), sample));
    }
    samples
}

/// RMS difference to the pitch that the firmware told at the same samples, rad.
pub fn difference_rms(other: &[(f64, f64)], flight: &Flight) -> f64 {
    let logged = flight.steps().filter(|step| step.sample.is_some());
    let squares: Vec<f64> = other
        .iter()
        .zip(logged)
        .map(|((_, pitch), step)| (pitch - step.pitch_rad()).powi(2))
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}
