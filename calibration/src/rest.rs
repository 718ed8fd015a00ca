//! The tombstone test: the rate that a sensor at rest reads is its gyroscope's bias, if it really
//! is at rest.

use nalgebra::Vector3;
use thiserror::Error;

use crate::{AXES, Sample, spread, stillness};

/// Least length of the test, s: the mean of a gyroscope with 0.014 deg/s/sqrt(Hz) is then good to
/// 0.005 deg/s.
pub const LEAST_S: f64 = 5.0;
/// Largest standard deviation of the rate, rad/s: three times the noise of the chip at 116 Hz
/// bandwidth.
const RATE_NOISE: f64 = 0.01;
/// Largest standard deviation of the acceleration, m/s2.
const ACC_NOISE: f64 = 0.15;
/// How far the mean rate of a quarter may lie from that of the whole, rad/s: 0.12 deg/s.
const RATE_DRIFT: f64 = 0.002;
/// How far the mean acceleration of a quarter may lie from that of the whole, m/s2: a tilt of 0.2
/// deg.
const ACC_DRIFT: f64 = 0.035;
/// How far the mean field of a quarter may lie from that of the whole, uT: a turn of 3 deg where it
/// is 17 uT, and five times the noise of a chip that measures ten times a second.
const FIELD_DRIFT: f64 = 0.9;
/// Largest bias, rad/s: the data sheet's 3 deg/s at most, and as much for temperature.
const LARGEST_BIAS: f64 = 0.105;

/// What the test shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Gyroscope bias, rad/s.
    pub bias: Vector3<f64>,
    /// Standard deviation of the rate, rad/s.
    pub noise: Vector3<f64>,
    /// Mean specific force as read, m/s2.
    pub acc: Vector3<f64>,
    /// Length, s.
    pub seconds: f64,
}

/// Why the test is refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RestError {
    /// Shorter than [`LEAST_S`]: its length, s.
    #[error("a rest of {0:.1} s is too short for the gyroscope's bias, which takes {LEAST_S} s")]
    Short(f64),
    /// The sensor moved or shook: what shows it, by how much, and how much may be.
    #[error("it moved during the rest: {0}; lay the sensor down and do not touch the table")]
    Motion(String),
    /// Steady, but more than a bias can be, deg/s: it turns.
    #[error(
        "a rate of {0:.1} deg/s is more than a bias can be: it turns, or the gyroscope is broken"
    )]
    Turning(f64),
}

/// The gyroscope's bias out of a rest.
///
/// # Errors
/// [`RestError`], where it was no rest.
pub fn bias(samples: &[Sample]) -> Result<Rest, RestError> {
    let seconds = stillness::length_s(samples);
    let means = |samples: &[Sample]| {
        Some((
            spread(samples.iter().map(|m| &m.gyr))?,
            spread(samples.iter().map(|m| &m.acc))?,
            spread(samples.iter().map(|m| &m.mag))?,
        ))
    };
    let (gyr, acc, mag) = match means(samples) {
        Some(means) if seconds >= LEAST_S => means,
        _ => return Err(RestError::Short(seconds)),
    };
    within("gyroscope", gyr.1, RATE_NOISE, "rad/s")?;
    within("accelerometer", acc.1, ACC_NOISE, "m/s2")?;
    for quarter in samples.chunks(samples.len().div_ceil(4)) {
        if let Some((rate, force, field)) = means(quarter) {
            within("gyroscope", rate.0 - gyr.0, RATE_DRIFT, "rad/s")?;
            within("accelerometer", force.0 - acc.0, ACC_DRIFT, "m/s2")?;
            within("magnetometer", field.0 - mag.0, FIELD_DRIFT, "uT")?;
        }
    }
    if gyr.0.amax() > LARGEST_BIAS {
        return Err(RestError::Turning(gyr.0.amax().to_degrees()));
    }
    Ok(Rest { bias: gyr.0, noise: gyr.1, acc: acc.0, seconds })
}

fn within(sensor: &str, vector: Vector3<f64>, limit: f64, unit: &str) -> Result<(), RestError> {
    for (value, axis) in vector.iter().zip(AXES) {
        // Not a number is no rest either.
        if value.abs() <= limit {
            continue;
        }
        let by = value.abs();
        return Err(RestError::Motion(format!(
            "{sensor} {axis} by {by:.3} {unit}, where {limit:.3} may be"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of rest with a little noise that repeats.
    fn still() -> Vec<Sample> {
        (0..1000)
            .map(|i| {
                let noise = [0.004, -0.003, 0.001, -0.002][i % 4];
                Sample {
                    time_s: i as f64 * 0.01,
                    gyr: Vector3::new(0.02 + noise, -0.01, noise),
                    acc: Vector3::new(0.1, noise, -9.8),
                    mag: Vector3::new(17.0, 0.0, 47.0),
                }
            })
            .collect()
    }

    #[test]
    fn a_rest_gives_its_mean() {
        let rest = bias(&still()).unwrap();
        assert!((rest.bias - Vector3::new(0.02, -0.01, 0.0)).norm() < 1e-9);
        assert!((rest.seconds - 9.99).abs() < 1e-9);
    }

    fn refused(change: fn(usize, &mut Sample), part: &str) {
        let mut samples = still();
        for (index, sample) in samples.iter_mut().enumerate() {
            change(index, sample);
        }
        let why = bias(&samples).unwrap_err().to_string();
        assert!(why.contains(part), "{why}");
    }

    #[test]
    fn motion_is_refused_whichever_sensor_shows_it() {
        refused(|i, m| m.gyr.y += if i == 500 { 1.0 } else { 0.0 }, "gyroscope y");
        refused(|i, m| m.gyr.z += i as f64 * 1e-5, "gyroscope z");
        refused(|i, m| m.acc.x += i as f64 * 1e-4, "accelerometer x");
        refused(|i, m| m.acc.z += if i % 50 < 25 { 0.3 } else { 0.0 }, "accelerometer z");
        refused(|i, m| m.mag.y += i as f64 * 0.01, "magnetometer y");
        refused(|_, m| m.gyr.x += 0.2, "deg/s is more than a bias");
        refused(|_, m| m.gyr.x = f64::NAN, "gyroscope x");
    }

    #[test]
    fn a_short_rest_is_refused() {
        let why = bias(&still()[..400]).unwrap_err().to_string();
        assert!(why.contains("4.0 s is too short"), "{why}");
        assert!(bias(&[]).is_err());
    }
}
