//! Both directions of time, for recordings.
//!
//! A filter that runs through a recording knows the past of each sample; a filter that runs from
//! the end knows its future. Their errors differ: an error of the gyroscope makes one pass late and
//! the other early, and each pass has its own noise. The average of both is better than either.
//!
//! The first pass learns the gyroscope's offset, the field, the field's lag and the ranges in which
//! the gyroscope clips. The second pass goes back from the end, the third forth from the beginning.
//! The result is the mean of the second and the third, weighted by their averaging times. For
//! seconds after its start, a gap or clipping, an estimate has less weight.

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
/// Rate, offset and flags are the last pass's. Takes some 60 bytes a sample while it runs.
///
/// # Errors
/// The name of a parameter that is not finite or out of range.
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
        // A sample has the rate of the time before it. Going back, the next sample has it.
        if let Some(next) = samples.get(index + 1) {
            let sample = Sample { gyr: next.sample.gyr.map(|rate| -rate), ..timed.sample };
            backward.update(next.dt_s, &sample);
        }
        later.push((backward.attitude().orientation, backward.standing_s()));
    }
    let mut forward = backward.reversed(&config.gains)?;
    let mut earlier = true;
    let averaged = samples.iter().zip(later.iter().rev()).map(|(timed, later)| {
        // The way back has ended at the first sample.
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

/// The orientation between two orientations, nearer to the one with the larger weight.
fn between<T: Real>(
    (a, weight_a): (Quaternion<T>, T),
    (b, weight_b): (Quaternion<T>, T),
) -> Quaternion<T> {
    let sum = weight_a + weight_b;
    let share = if sum > T::ZERO { weight_b * sum.recip() } else { T::HALF };
    let turn = a.conj().mul(&b).rotation_vector();
    a.mul(&Quaternion::from_rotation_vector(&scaled(&turn, share)))
}
