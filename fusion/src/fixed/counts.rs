//! Input: samples as the sensors give them, and the value of a count.

use core::ops::RangeInclusive;

use crate::error::{ConfigError, in_range, require};

/// Sampling periods that the estimators take, us. In the longest periods, a step of 1.25 periods
/// must turn by at most half a radian an axis ([`Scale::TURN_RAD`]).
pub const PERIOD_US: RangeInclusive<u32> = 500..=10_500;

/// One sample as the sensors give it, in body axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counts {
    /// Rotation rate.
    pub gyr: [i16; 3],
    /// Specific force.
    pub acc: [i16; 3],
    /// Magnetic field, when there is a fresh one.
    pub mag: Option<[i16; 3]>,
}

/// Units of a count.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scale {
    /// Rotation rate of a count, rad/s.
    pub gyr_rad_s: f32,
    /// Specific force of a count, m/s^2.
    pub acc_m_s2: f32,
    /// Magnetic field of a count, uT.
    pub mag_ut: f32,
}

impl Scale {
    /// BNO055 with its default units (data sheet tables 3-17, 3-19, 3-22): 16 counts per deg/s, 100
    /// per m/s^2, 16 per uT.
    pub const BNO055: Self = Self { gyr_rad_s: 0.001_090_830_8, acc_m_s2: 0.01, mag_ut: 0.0625 };

    /// Accepted rotation rates of a count, rad/s: up to 2340 deg/s at full scale.
    pub const GYR_RAD_S: RangeInclusive<f32> = 1e-5..=0.001_25;

    /// Largest accepted turn of a count in a sampling period, rad: 2150 deg/s at full scale for
    /// 10.5 ms, 2300 for 9.8.
    pub const TURN_RAD: f32 = 0.001_15 * 10.5e-3;

    /// Accepted specific forces of a count, m/s^2: 1.7 g to 167 g at full scale.
    pub const ACC_M_S2: RangeInclusive<f32> = 5e-4..=0.05;

    /// Fields of a count that they take, uT.
    pub const MAG_UT: RangeInclusive<f32> = 1e-3..=1.0;

    /// Refuses a scale outside of the number formats at this sampling period.
    #[inline(always)]
    pub(super) fn check(&self, period_s: f32) -> Result<(), ConfigError> {
        require(Self::GYR_RAD_S.contains(&self.gyr_rad_s), "gyr_rad_s")?;
        require(Self::ACC_M_S2.contains(&self.acc_m_s2), "acc_m_s2")?;
        require(Self::MAG_UT.contains(&self.mag_ut), "mag_ut")?;
        in_range(self.gyr_rad_s * period_s, 0.0, Self::TURN_RAD, "period_us")
    }
}
