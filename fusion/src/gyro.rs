//! Integrated rates, the baseline: aligned at start-up, never corrected after.

use crate::error::ConfigError;
use crate::filter::{Filter, View};
use crate::mahony::{Mahony, MahonyGains};
use crate::real::Real;
use crate::vector::zero;

/// No correction but the averaging at start-up.
#[derive(Clone, Debug)]
pub struct Gyro<T = f32> {
    alignment: Mahony<T>,
}

impl<T: Real> Filter for Gyro<T> {
    type Real = T;
    type Gains = ();
    const CORRECTS: bool = false;

    fn new((): &()) -> Result<Self, ConfigError> {
        // With gains of zero it corrects by the running mean of the start-up alone.
        let gains = MahonyGains { acc_per_s: 0.0, mag_per_s: 0.0, integral_per_s2: 0.0 };
        Ok(Self { alignment: Mahony::new(&gains)? })
    }

    #[inline(always)]
    fn correction(&mut self, view: &View<T>, bias: &mut [T; 3]) -> [T; 3] {
        if view.starting { self.alignment.correction(view, bias) } else { zero() }
    }
}
