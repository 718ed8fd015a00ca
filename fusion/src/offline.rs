//! Both directions of time, for recordings.
//!
//! A filter that runs through a recording knows the past of each sample; one that runs through it
//! from the end knows the future. What they are wrong by is different: an error of the gyroscope
//! makes the one late where it makes the other early, and of the noise each has a sample of its
//! own. Between them lies a better estimate than either.
//!
//! The first pass learns: offset of the gyroscope, field, the field's lag, the ranges in which the
//! gyroscope clips. The second goes back from its end with what was learned, the third forth again
//! from the beginning, where the second has ended. Second and third are averaged, each by the time
//! that it stands on: for seconds after its start, a gap or clipping an estimate counts for less.

use alloc::vec::Vec;

use crate::config::Config;
use crate::error::ConfigError;
use crate::estimator::{Attitude, Estimator, Sample};
use crate::filter::Filter;
use crate::quaternion::Quaternion;
use crate::real::Real;
use crate::vector::scaled;

/// A sample and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedSample {
    /// Time since the sample before, s.
    pub dt_s: f32,
    /// The sample.
    pub sample: Sample,
}

/// The attitudes at all samples of a recording, by a filter that runs forth and back.
///
/// Rate, offset and flags are those of the last pass. Takes some 60 bytes a sample while it runs.
///
/// # Errors
/// A parameter that is not finite or out of its range, by name.
pub fn smooth<F: Filter>(
    config: &Config<F::Gains>,
    samples: &[TimedSample],
) -> Result<Vec<Attitude<F::Real>>, ConfigError> {
    let mut learning = Estimator::<F>::new(config)?;
    for TimedSample { dt_s, sample } in samples {
        learning.update(*dt_s, sample);
    }
    let mut backward = learning.reversed(&config.gains)?;
    let mut later = Vec::with_capacity(samples.len());
    for (index, timed) in samples.iter().enumerate().rev() {
        // The rate of a sample is that of the time before it: going back, that of the next one.
        if let Some(next) = samples.get(index + 1) {
            let sample = Sample {
                gyr: next.sample.gyr.map(|rate| -rate),
                ..timed.sample
            };
            backward.update(next.dt_s, &sample);
        }
        later.push((backward.attitude().orientation, backward.standing_s()));
    }
    let mut forward = backward.reversed(&config.gains)?;
    let mut earlier = true;
    let averaged = samples
        .iter()
        .zip(later.iter().rev())
        .map(|(timed, later)| {
            // The first sample is where the way back has ended.
            if !core::mem::take(&mut earlier) {
                forward.update(timed.dt_s, &timed.sample);
            }
            let attitude = forward.attitude();
            Attitude {
                orientation: between((attitude.orientation, forward.standing_s()), *later),
                ..attitude
            }
        });
    Ok(averaged.collect())
}

/// The orientation between two, nearer to the one with the larger weight.
fn between<T: Real>(
    (a, weight_a): (Quaternion<T>, T),
    (b, weight_b): (Quaternion<T>, T),
) -> Quaternion<T> {
    let sum = weight_a + weight_b;
    let share = if sum > T::ZERO {
        weight_b * sum.recip()
    } else {
        T::HALF
    };
    let turn = a.conj().mul(&b).rotation_vector();
    a.mul(&Quaternion::from_rotation_vector(&scaled(&turn, share)))
}
