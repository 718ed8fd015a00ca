//! Kinds of sensors: without lag, or with known lags that the estimator corrects.

use super::counts::Scale;
use super::format::{Q9, Q30};
use super::lag::{self, Lag};
use crate::config::Config;
use crate::error::{ConfigError, in_range};
use crate::lag::checked;

/// Specific force and field, counts.
type Seen = ([i32; 3], Option<[i32; 3]>);

/// A kind of sensors: [`Ideal`] or [`Late`].
pub trait Sensors: sealed::Sealed + Sized {
    #[doc(hidden)]
    fn new<G>(config: &Config<G>, scale: &Scale) -> Result<Self, ConfigError>;

    /// Keeps the rates less their offset, if they are needed later.
    #[doc(hidden)]
    fn keep_rates(_: &mut [i32; 3], _: &[i16; 3], _: &[Q9; 3]) {}

    /// The measured specific force and field, moved to the time of the rates.
    #[doc(hidden)]
    fn now(&self, _rates: &[i32; 3], seen: Seen) -> Seen {
        seen
    }

    /// The orientation now, ahead of the rates.
    #[doc(hidden)]
    fn ahead(&self, of_rates: [Q30; 4], _rates: &[i32; 3]) -> [Q30; 4] {
        of_rates
    }
}

pub(super) mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Ideal {}
    impl Sealed for super::Late {}
}

/// Sensors without lag, which cost nothing. A configuration with a lag is refused.
#[derive(Clone, Debug, PartialEq)]
pub struct Ideal;

impl Sensors for Ideal {
    #[inline(always)]
    fn new<G>(config: &Config<G>, _: &Scale) -> Result<Self, ConfigError> {
        in_range(config.gyr_lag_s, 0.0, 0.0, "gyr_lag_s")?;
        in_range(config.acc_lag_s, 0.0, 0.0, "acc_lag_s")?;
        in_range(config.mag_lag_s, 0.0, 0.0, "mag_lag_s")?;
        Ok(Self)
    }
}

/// Samples with known lags ([`Config::gyr_lag_s`] and the others). Accelerometer and magnetometer
/// cost some 100 cycles each.
#[derive(Clone, Debug, PartialEq)]
pub struct Late {
    gyr: Lag,
    acc: Lag,
    pub(super) mag: Lag,
}

impl Sensors for Late {
    #[inline(always)]
    fn new<G>(config: &Config<G>, scale: &Scale) -> Result<Self, ConfigError> {
        let unit = Lag::unit(scale.gyr_rad_s);
        let lag = |lag_s, name| Ok(unit.times(checked(lag_s, name)?));
        Ok(Self {
            gyr: lag(config.gyr_lag_s, "gyr_lag_s")?,
            acc: lag(config.acc_lag_s, "acc_lag_s")?,
            mag: lag(config.mag_lag_s, "mag_lag_s")?,
        })
    }

    #[inline(always)]
    fn keep_rates(rates: &mut [i32; 3], gyr: &[i16; 3], bias: &[Q9; 3]) {
        *rates = lag::rates(gyr, bias);
    }

    #[inline(always)]
    fn now(&self, rates: &[i32; 3], (acc, mag): Seen) -> Seen {
        let mag = mag.map(|mag| self.mag.now(&mag, rates));
        (self.acc.now(&acc, rates), mag)
    }

    fn ahead(&self, of_rates: [Q30; 4], rates: &[i32; 3]) -> [Q30; 4] {
        self.gyr.ahead(of_rates, rates)
    }
}
