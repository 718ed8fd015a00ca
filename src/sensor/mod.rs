//! The sensors of this vehicle, and the choice between them.
//!
//! Only this folder names a sensor. All sensors give their samples in the same units,
//! [`SCALE`]: the rest of the firmware, calibrations and logs do not depend on the choice.

mod bno055;
mod lsm6ds3;
mod pair;

use crate::params::Params;
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
    /// The BNO055, with the LSM6DS3 standing by.
    Both = 2,
}

impl Kind {
    /// All, in the order of the parameter's values from 0 on, with the names that commands use.
    pub const ALL: [(Self, &str); 3] =
        [(Self::Bno055, "bno055"), (Self::Lsm6ds3, "lsm6ds3"), (Self::Both, "both")];

    /// The value of `SENSOR`.
    #[must_use]
    pub const fn value(self) -> f32 {
        self as u8 as f32
    }

    /// The kind with this value of `SENSOR`.
    #[must_use]
    pub fn of(value: f32) -> Self {
        let mut kinds = Self::ALL.iter().map(|(kind, _)| *kind);
        kinds.find(|kind| kind.value() == value).unwrap_or_default()
    }

    /// A sample of its chip's counts in the units of [`SCALE`].
    #[must_use]
    pub fn in_common_units(self, raw: RawSample) -> RawSample {
        match self {
            Self::Bno055 | Self::Both => raw,
            Self::Lsm6ds3 => lsm6ds3::convert(raw),
        }
    }

    /// What it is like.
    #[must_use]
    pub const fn description(self) -> &'static Description {
        match self {
            Self::Bno055 | Self::Both => &bno055::DESCRIPTION,
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
    /// See [`Kind::Both`].
    Both(pair::Pair),
}

impl Sensor {
    /// A driver that will set its sensor up, as the parameters choose it.
    #[must_use]
    pub fn new(params: &Params) -> Self {
        match params.sensor_kind() {
            Kind::Bno055 => Self::Bno055(bno055::new()),
            Kind::Lsm6ds3 => Self::Lsm6ds3(lsm6ds3::new()),
            Kind::Both => Self::Both(pair::Pair::new(mounts_deg(params))),
        }
    }

    /// Whether the parameters choose this sensor.
    #[must_use]
    pub fn is_as(&self, params: &Params) -> bool {
        let kind = params.sensor_kind();
        match self {
            Self::Bno055(_) => kind == Kind::Bno055,
            Self::Lsm6ds3(_) => kind == Kind::Lsm6ds3,
            Self::Both(pair) => kind == Kind::Both && pair.mounts_deg() == mounts_deg(params),
        }
    }

    /// The sensor whose transfer [`Imu::next`] gave last.
    #[must_use]
    pub fn asked(&self) -> Kind {
        match self {
            Self::Lsm6ds3(_) => Kind::Lsm6ds3,
            Self::Both(pair) if pair.asks_onboard() => Kind::Lsm6ds3,
            Self::Bno055(_) | Self::Both(_) => Kind::Bno055,
        }
    }

    /// The 7-bit address of the transfer that [`Imu::next`] gave last.
    #[must_use]
    pub fn address(&self) -> u8 {
        match self {
            Self::Both(pair) => pair.address(),
            single => single.bursts().address,
        }
    }

    /// While the vehicle is armed, what two sensors differ by stays.
    pub fn hold_offsets(&mut self, holds: bool) {
        if let Self::Both(pair) = self {
            pair.hold_offsets(holds);
        }
    }
}

/// How both sensors sit: roll, pitch and yaw of each, deg.
fn mounts_deg(params: &Params) -> [[f32; 3]; 2] {
    [params.mount_deg(), params.standby_mount_deg()]
}

/// The same call of any driver.
macro_rules! of_any {
    ($sensor:expr, $driver:ident => $call:expr) => {
        match $sensor {
            Sensor::Bno055($driver) => $call,
            Sensor::Lsm6ds3($driver) => $call,
            Sensor::Both($driver) => $call,
        }
    };
}

impl Imu for Sensor {
    fn next(&mut self, now: Micros) -> Next {
        of_any!(self, driver => driver.next(now))
    }

    fn complete(&mut self, now: Micros, outcome: Transferred<'_>) {
        of_any!(self, driver => driver.complete(now, outcome));
    }

    fn is_sampling(&self) -> bool {
        of_any!(self, driver => driver.is_sampling())
    }

    fn bursts(&self) -> Bursts {
        of_any!(self, driver => driver.bursts())
    }

    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault> {
        of_any!(self, driver => driver.sample(time, outcome))
    }

    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>) {
        of_any!(self, driver => driver.overdue(time, outcome));
    }

    fn missed(&mut self) -> SensorFault {
        of_any!(self, driver => driver.missed())
    }

    fn fault(&self) -> Option<SensorFault> {
        of_any!(self, driver => driver.fault())
    }

    fn failed_setups(&self) -> u32 {
        of_any!(self, driver => driver.failed_setups())
    }

    fn fresh(&self) -> u32 {
        of_any!(self, driver => driver.fresh())
    }

    fn refresh(&self) -> &Refresh {
        of_any!(self, driver => driver.refresh())
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
