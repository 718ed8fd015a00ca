//! What the sensors are like, and so what an estimator makes good for.

use core::fmt::Debug;

use super::counts::{Counts, Scale};
use super::format::{Q9, Q30, Q31};
use super::lag::{self, Lag};
use super::rotation::Products;
use crate::config::Config;
use crate::error::{ConfigError, in_range};
use crate::lag::checked;

/// What the sensors are like: [`Ideal`], [`Late`] or [`Clipped`](super::Clipped).
pub trait Sensors: sealed::Sealed + Sized {
    /// What making good for them remembers beside the [`State`](super::State).
    type Memory: Clone + Debug;

    /// With the smaller one of the filter's gains, 1/s, and the duration of a block.
    #[doc(hidden)]
    fn new<G>(
        config: &Config<G>,
        scale: &Scale,
        slow_per_s: f32,
        block_s: f32,
    ) -> Result<Self, ConfigError>;

    #[doc(hidden)]
    fn start(&self) -> Self::Memory;

    /// Keeps the rates less their offset, where they are needed later.
    #[doc(hidden)]
    fn keep_rates(_: &mut [i32; 3], _: &[i16; 3], _: &[Q9; 3]) {}

    /// The specific force and the field that were measured, as they are at the time of the rates.
    #[doc(hidden)]
    fn now(
        &self,
        _: &Self::Memory,
        _rates: &[i32; 3],
        acc: [i32; 3],
        mag: Option<[i32; 3]>,
    ) -> ([i32; 3], Option<[i32; 3]>) {
        (acc, mag)
    }

    /// The orientation now, ahead of the rates.
    #[doc(hidden)]
    fn ahead(&self, of_rates: [Q30; 4], _rates: &[i32; 3]) -> [Q30; 4] {
        of_rates
    }

    /// Looks for clipped rates at the end of a step.
    #[doc(hidden)]
    fn examine(&self, _: &mut Self::Memory, _: &StepEnd<'_>) -> Response {
        Response::default()
    }

    /// A rate is clipped, or was within the last seconds.
    #[doc(hidden)]
    fn is_over_range(_: &Self::Memory) -> bool {
        false
    }
}

pub(super) mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Ideal {}
    impl Sealed for super::Late {}
    impl Sealed for crate::fixed::Clipped {}
}

/// What an estimator knows at the end of a step.
pub struct StepEnd<'a> {
    /// Time step, us.
    pub(super) dt_us: u32,
    /// The sample.
    pub(super) counts: &'a Counts,
    /// The orientation after the step.
    pub(super) products: &'a Products,
    /// Specific force, as it is now, counts.
    pub(super) acc: &'a [i32; 3],
    /// Offset of the gyroscope, counts.
    pub(super) bias: &'a [Q9; 3],
    /// The field's reference: north and down, counts.
    pub(super) field: Option<[i32; 2]>,
    /// The field is like it, to its full weight.
    pub(super) field_is_like_it: bool,
    /// Base-2 logarithm of the gain increase of the slower channel.
    pub(super) gain_log2: i32,
}

/// What an estimator does about clipped rates.
#[derive(Default)]
pub struct Response {
    /// A correction, half a rotation vector in the body frame, rad.
    pub(super) correction: [Q31; 3],
    /// Base-2 logarithm of a gain increase and the blocks that it lasts: see `Schedule::raise`.
    pub(super) raise: Option<(i32, u32)>,
}

/// Sensors of one instant, and a gyroscope whose range no motion exceeds: nothing is made good for,
/// which costs nothing. A configuration with a lag is refused.
#[derive(Clone, Debug, PartialEq)]
pub struct Ideal;

impl Sensors for Ideal {
    type Memory = ();

    #[inline(always)]
    fn new<G>(config: &Config<G>, _: &Scale, _: f32, _: f32) -> Result<Self, ConfigError> {
        in_range(config.gyr_lag_s, 0.0, 0.0, "gyr_lag_s")?;
        in_range(config.acc_lag_s, 0.0, 0.0, "acc_lag_s")?;
        in_range(config.mag_lag_s, 0.0, 0.0, "mag_lag_s")?;
        Ok(Self)
    }

    fn start(&self) {}
}

/// Samples that are older than they seem, by lags that are known ([`Config::gyr_lag_s`] and the
/// others). Accelerometer and magnetometer cost some 100 cycles each.
#[derive(Clone, Debug, PartialEq)]
pub struct Late {
    pub(super) gyr: Lag,
    pub(super) acc: Lag,
    pub(super) mag: Lag,
}

impl Sensors for Late {
    type Memory = ();

    #[inline(always)]
    fn new<G>(config: &Config<G>, scale: &Scale, _: f32, _: f32) -> Result<Self, ConfigError> {
        let unit = Lag::unit(scale.gyr_rad_s);
        let lag = |lag_s, name| Ok(unit.times(checked(lag_s, name)?));
        Ok(Self {
            gyr: lag(config.gyr_lag_s, "gyr_lag_s")?,
            acc: lag(config.acc_lag_s, "acc_lag_s")?,
            mag: lag(config.mag_lag_s, "mag_lag_s")?,
        })
    }

    fn start(&self) {}

    #[inline(always)]
    fn keep_rates(rates: &mut [i32; 3], gyr: &[i16; 3], bias: &[Q9; 3]) {
        *rates = lag::rates(gyr, bias);
    }

    #[inline(always)]
    fn now(
        &self,
        (): &(),
        rates: &[i32; 3],
        acc: [i32; 3],
        mag: Option<[i32; 3]>,
    ) -> ([i32; 3], Option<[i32; 3]>) {
        let mag = mag.map(|mag| self.mag.now(&mag, rates));
        (self.acc.now(&acc, rates), mag)
    }

    fn ahead(&self, of_rates: [Q30; 4], rates: &[i32; 3]) -> [Q30; 4] {
        self.gyr.ahead(of_rates, rates)
    }
}
