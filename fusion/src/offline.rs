//! Both directions of time, for recordings.
//!
//! A filter that runs through a recording knows the past of each sample. A filter that runs from
//! the end knows its future. Together they have no delay: an error of the gyroscope makes one pass
//! late and the other early.
//!
//! The first pass learns the gyroscope's offset, the field, the field's lag and the ranges in which
//! the gyroscope clips. The second pass goes back from the end, the third forth from the beginning.
//! The result is the mean of the second and the third, weighted by their averaging times. For
//! seconds after its start, a gap or clipping, an estimate has less weight.
//!
//! With the response `H` of a filter from the accelerometer to the tilt, the mean has the real part
//! of `H`. For a response of first order that is `|H|^2`; for the VQF class, of second order, it
//! smooths less. So there the third pass takes the vertical of the second pass in place of the
//! accelerometer's: the tilt of the third pass has `|H|^2`, and only the heading is a mean.

use alloc::vec::Vec;

use crate::config::{Config, GRAVITY};
use crate::error::ConfigError;
use crate::estimator::{Attitude, Estimator, SETTLED_S, Sample};
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
/// Rate, offset and flags are the last pass's. `acc_lag_s` does not count. Takes 68 bytes a sample
/// in `f32` and 128 in `f64` while it runs.
///
/// # Errors
/// The name of a parameter that is not finite or out of range.
pub fn smooth<F: Filter>(
    config: &Config<F::Gains>,
    samples: &[TimedSample],
) -> Result<Vec<Attitude<F::Real>>, ConfigError> {
    // The lag makes up for the delay of a single pass. Two directions together have none.
    let config = Config { acc_lag_s: 0.0, ..*config };
    let mut learning = Estimator::<F>::new(&config)?;
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
        later.push((backward.orientation(), backward.standing_s()));
    }
    let mut forward = backward.reversed(&config.gains)?;
    let mut attitudes = Vec::with_capacity(samples.len());
    for (timed, (later, later_s)) in samples.iter().zip(later.iter().rev()) {
        // The way back has ended at the first sample.
        if !attitudes.is_empty() {
            let mut sample = timed.sample;
            if F::IS_SECOND_ORDER && *later_s >= F::Real::from_f32(SETTLED_S) {
                let down = later.half_rows().down;
                sample.acc = down.map(|half| -2.0 * GRAVITY * half.to_f32());
            }
            forward.update(timed.dt_s, &sample);
        }
        let attitude = forward.attitude();
        let mut turn = towards((forward.orientation(), forward.standing_s()), (*later, *later_s));
        if F::IS_SECOND_ORDER {
            let [north, east, _] = &mut turn;
            (*north, *east) = (F::Real::ZERO, F::Real::ZERO);
        }
        let turn = Quaternion::from_rotation_vector(&turn);
        attitudes.push(Attitude { orientation: turn.mul(&attitude.orientation), ..attitude });
    }
    Ok(attitudes)
}

/// The rotation vector, earth frame, from an orientation to the mean of two: it is nearer to the
/// orientation with the larger weight.
fn towards<T: Real>(
    (a, weight_a): (Quaternion<T>, T),
    (b, weight_b): (Quaternion<T>, T),
) -> [T; 3] {
    let sum = weight_a + weight_b;
    let share = if sum > T::ZERO { weight_b * sum.recip() } else { T::HALF };
    scaled(&b.mul(&a.conj()).rotation_vector(), share)
}
