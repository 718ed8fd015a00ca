//! The sensors of this vehicle, and the choice between them.
//!
//! Only this folder names a sensor. All sensors give their samples in the same units,
//! [`SCALE`]: the rest of the firmware, calibrations and logs do not depend on the choice.

mod bno055;
mod lsm6ds3;

use tvc_imu::{
    Bursts, Description, Imu, Micros, Next, RawSample, Refresh, Sample, Scale, SensorFault,
    Transferred,
};

/// A sensor that can be chosen, by the value of `SENSOR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// A BNO055 on the bus of the header.
    #[default]
    Bno055 = 0,
    /// The LSM6DS3 of the Nano 33 IoT.
    Lsm6ds3 = 1,
}

impl Kind {
    /// All, in the order of the parameter's values from 0 on, with the names that commands use.
    pub const ALL: [(Self, &str); 2] = [(Self::Bno055, "bno055"), (Self::Lsm6ds3, "lsm6ds3")];

    /// The value of `SENSOR`.
    #[must_use]
    pub const fn value(self) -> f32 {
        self as u8 as f32
    }

    /// The kind with this value of `SENSOR`.
    #[must_use]
    pub fn of(value: f32) -> Self {
        if value == Self::Lsm6ds3.value() { Self::Lsm6ds3 } else { Self::Bno055 }
    }

    /// A sample of its chip's counts in the units of [`SCALE`].
    #[must_use]
    pub fn in_common_units(self, raw: RawSample) -> RawSample {
        match self {
            Self::Bno055 => raw,
            Self::Lsm6ds3 => lsm6ds3::convert(raw),
        }
    }

    /// What it is like.
    #[must_use]
    pub const fn description(self) -> &'static Description {
        match self {
            Self::Bno055 => &bno055::DESCRIPTION,
            Self::Lsm6ds3 => &lsm6ds3::DESCRIPTION,
        }
    }
}

/// The chosen sensor's driver.
#[derive(Clone, Debug)]
pub enum Sensor {
    /// See [`Kind::Bno055`].
    Bno055(bno055::Driver),
    /// See [`Kind::Lsm6ds3`].
    Lsm6ds3(lsm6ds3::Driver),
}

impl Sensor {
    /// A driver that will set its sensor up.
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        match kind {
            Kind::Bno055 => Self::Bno055(bno055::new()),
            Kind::Lsm6ds3 => Self::Lsm6ds3(lsm6ds3::new()),
        }
    }

    /// Which sensor it is.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Bno055(_) => Kind::Bno055,
            Self::Lsm6ds3(_) => Kind::Lsm6ds3,
        }
    }
}

/// The same call of either driver.
macro_rules! either {
    ($sensor:expr, $driver:ident => $call:expr) => {
        match $sensor {
            Sensor::Bno055($driver) => $call,
            Sensor::Lsm6ds3($driver) => $call,
        }
    };
}

impl Imu for Sensor {
    fn next(&mut self, now: Micros) -> Next {
        either!(self, driver => driver.next(now))
    }

    fn complete(&mut self, now: Micros, outcome: Transferred<'_>) {
        either!(self, driver => driver.complete(now, outcome));
    }

    fn is_sampling(&self) -> bool {
        either!(self, driver => driver.is_sampling())
    }

    fn bursts(&self) -> Bursts {
        either!(self, driver => driver.bursts())
    }

    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault> {
        either!(self, driver => driver.sample(time, outcome))
    }

    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>) {
        either!(self, driver => driver.overdue(time, outcome));
    }

    fn missed(&mut self) -> SensorFault {
        either!(self, driver => driver.missed())
    }

    fn fault(&self) -> Option<SensorFault> {
        either!(self, driver => driver.fault())
    }

    fn failed_setups(&self) -> u32 {
        either!(self, driver => driver.failed_setups())
    }

    fn fresh(&self) -> u32 {
        either!(self, driver => driver.fresh())
    }

    fn refresh(&self) -> &Refresh {
        either!(self, driver => driver.refresh())
    }
}

/// Units of a count: those of the BNO055.
pub const SCALE: Scale = bno055::DESCRIPTION.scale;

/// Counts of 1 m/s2.
pub const ACC_COUNTS: f32 = 1.0 / SCALE.acc_m_s2;
/// Counts of 1 deg/s.
pub const GYR_COUNTS: f32 = core::f32::consts::PI / 180.0 / SCALE.gyr_rad_s;
/// Counts of 1 uT.
pub const MAG_COUNTS: f32 = 1.0 / SCALE.mag_ut;

/// Standard deviation of the gyroscope's offset behind a rest of half a minute, deg/s: what its
/// noise leaves, and its wandering since (6.5 deg/h).
pub const GYR_OFFSET_SD_DEG_S: f32 = 0.01;

/// Noise of the gyroscope, deg/s/sqrt(Hz) (data sheet, table 0-2).
pub const GYR_NOISE_DEG_RTS: f32 = 0.014;
