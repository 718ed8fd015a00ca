//! Settings, in SI units.

use crate::field::FieldConfig;
use crate::rest::RestConfig;

/// Standard gravity, m/s^2.
pub const GRAVITY: f32 = 9.806_65;

/// Configuration of an [`Estimator`](crate::Estimator): the filter's gains, and the settings of all
/// filters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(
    feature = "serde",
    serde(default, bound(deserialize = "G: Default + serde::Deserialize<'de>"))
)]
pub struct Config<G> {
    /// The filter's gains.
    pub gains: G,
    /// Rest detection and gyroscope offset.
    pub rest: RestConfig,
    /// Magnetic field: gate and reference.
    pub field: FieldConfig,
    /// Largest accepted deviation of the acceleration's magnitude from standard gravity, as a
    /// fraction of it. `f32::INFINITY`, the default, lets everything pass but free fall. A narrow
    /// gate harms filters that average the acceleration as a vector: the accepted part of a motion
    /// has no mean of zero.
    pub acc_gate: f32,
    /// The gyroscope's full scale, rad/s: larger rates have clipped and are clamped. The filter
    /// finds a lower limit in the data.
    pub gyro_range_rad_s: f32,
    /// Noise of the vertical that the accelerometer shows in motion, as a density, rad^2 s (0.28
    /// rad for 0.25 s). It sets the pace of recovery after clipping or a gap.
    pub recovery_rad2_s: f32,
    /// Two samples further apart than this are a gap, s: the motion between them is unknown. Below
    /// 4 Hz the default takes every sample for one, and the attitude is never initialised: a slow
    /// sensor needs twice its period.
    pub gap_s: f32,
    /// After this time of averaging the attitude counts as initialised (s).
    pub start_up_s: f32,
    /// Age of the gyroscope's samples, s: -0.1 to 0.1. The attitude is ahead of the rates by this
    /// time.
    pub gyr_lag_s: f32,
    /// Age of the accelerometer's samples less the rates' age, s: -0.1 to 0.1. The accelerometer's
    /// low-pass filter mostly has the lower cut-off.
    pub acc_lag_s: f32,
    /// Age of the magnetometer's samples less the rates' age, s: -0.1 to 0.1.
    pub mag_lag_s: f32,
    /// Standard deviation of `mag_lag_s`, s: 0 to 0.1. The filter learns the lag that the field
    /// shows while the body turns; the larger the deviation, the faster. With 0 it learns nothing.
    /// Fixed point learns in [`FieldLag`](crate::fixed::FieldLag).
    pub mag_lag_sd_s: f32,
    /// Magnetic declination, east positive (rad). With it, north is geographic.
    pub declination_rad: f32,
}

impl<G: Default> Default for Config<G> {
    fn default() -> Self {
        Self::with_gains(G::default())
    }
}

impl<G> Config<G> {
    /// The shared defaults with the gains given.
    pub fn with_gains(gains: G) -> Self {
        Self {
            gains,
            rest: RestConfig::default(),
            field: FieldConfig::default(),
            acc_gate: f32::INFINITY,
            gyro_range_rad_s: 35.0,
            recovery_rad2_s: 0.02,
            gap_s: 0.25,
            start_up_s: 1.0,
            gyr_lag_s: 0.002,
            acc_lag_s: 0.0025,
            mag_lag_s: 0.008,
            mag_lag_sd_s: 0.005,
            declination_rad: 0.0,
        }
    }

    /// The same settings for sensors without lag, as in a simulation; the filter learns no lag.
    pub fn without_lags(self) -> Self {
        Self { gyr_lag_s: 0.0, acc_lag_s: 0.0, mag_lag_s: 0.0, mag_lag_sd_s: 0.0, ..self }
    }
}
