//! Another filter on the counts of a log.

use anyhow::{Result, anyhow};
use tvc_fusion::fixed::Scale;
use tvc_fusion::{
    Complementary, Config, Estimator, Filter, Gyro, Madgwick, Mahony, Sample, Vector3, Vqf,
};
use tvc_nano::{Params, mount::Mount};

use crate::filters::fuse::FilterName;
use crate::logs::log::Flight;

/// Time and pitch (rad) after every sample, by a float filter with its default gains.
pub fn pitches(choice: FilterName, flight: &Flight, params: &Params) -> Result<Vec<(f64, f64)>> {
    match choice {
        FilterName::Gyro => follow::<Gyro<f32>>(flight, params),
        FilterName::Mahony => follow::<Mahony<f32>>(flight, params),
        FilterName::Madgwick => follow::<Madgwick<f32>>(flight, params),
        FilterName::Complementary => follow::<Complementary<f32>>(flight, params),
        FilterName::Vqf => follow::<Vqf<f32>>(flight, params),
    }
}

fn follow<F: Filter<Real = f32>>(flight: &Flight, params: &Params) -> Result<Vec<(f64, f64)>>
where
    Config<F::Gains>: Default,
{
    let config = Config {
        declination_rad: params.declination_deg().to_radians(),
        ..Config::default()
    };
    let mut estimator =
        Estimator::<F>::new(&config).map_err(|error| anyhow!("the filter: {error}"))?;
    let mount = Mount::new(params);
    let scale = Scale::BNO055;
    let si =
        |counts: [i16; 3], unit: f32| Vector3::from(counts.map(|count| f32::from(count) * unit));
    let mut last = None;
    let mut last_field = None;
    let mut pitches = Vec::new();
    for raw in flight.steps().filter_map(|step| step.sample) {
        let before = last.replace(raw.time.0);
        let dt_us = before.map_or(params.control_period_us().into(), |before| {
            raw.time.0.saturating_sub(before)
        });
        let counts = mount.convert(&raw);
        // The registers repeat until the magnetometer has measured again.
        let fresh = last_field.replace(raw.mag) != Some(raw.mag);
        let sample = Sample {
            gyr: si(counts.gyr, scale.gyr_rad_s),
            acc: si(counts.acc, scale.acc_m_s2),
            mag: counts
                .mag
                .filter(|_| fresh)
                .map(|mag| si(mag, scale.mag_ut)),
        };
        let attitude = estimator.update(dt_us as f32 * 1e-6, &sample);
        pitches.push((
            raw.time.0 as f64 * 1e-6,
            attitude.orientation.pitch().into(),
        ));
    }
    Ok(pitches)
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
