//! With and without the magnetometer at once.

use crate::config::Config;
use crate::error::ConfigError;
use crate::estimator::{Attitude, Estimator, Filter, Sample};
use crate::real::{Number, Real};

/// Two estimators on the same samples: one that sees the magnetometer, and one that does not.
///
/// The heading of the second drifts slowly and is never disturbed by a magnet. Their difference
/// shows what the magnetometer does to the heading: steady, it is where north is; moving fast, it
/// is a disturbance.
#[derive(Clone, Debug)]
pub struct Both<F: Filter> {
    /// Without the magnetometer.
    pub six: Estimator<F>,
    /// With it.
    pub nine: Estimator<F>,
}

/// The estimates of [`Both`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BothAttitudes<T = f32> {
    /// Without the magnetometer; north is where the estimate started.
    pub six: Attitude<T>,
    /// With it.
    pub nine: Attitude<T>,
    /// Heading with the magnetometer less heading without, rad, -pi..pi.
    pub heading_difference_rad: T,
}

impl<F: Filter> Both<F> {
    /// Two estimators that wait for their first sample.
    ///
    /// # Errors
    /// A parameter that is not finite or out of its range, by name.
    pub fn new(config: &Config<F::Gains>) -> Result<Self, ConfigError> {
        Ok(Self {
            six: Estimator::new(config)?,
            nine: Estimator::new(config)?,
        })
    }

    /// Take one sample, `dt_s` seconds after the one before, as [`Estimator::update`] does.
    pub fn update(&mut self, dt_s: f32, sample: &Sample) -> BothAttitudes<F::Real> {
        let blind = Sample {
            mag: None,
            ..*sample
        };
        let six = self.six.update(dt_s, &blind);
        let nine = self.nine.update(dt_s, sample);
        // Of the turn from the one to the other, in the earth frame, the part about the vertical.
        let turn = nine.orientation.mul(&six.orientation.conj());
        let half = if turn.w.is_negative() {
            (-turn.z).atan2(-turn.w)
        } else {
            turn.z.atan2(turn.w)
        };
        BothAttitudes {
            six,
            nine,
            heading_difference_rad: half + half,
        }
    }
}
