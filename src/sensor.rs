//! The sensor of this vehicle: the only place of the firmware that names it.

use bno055_driver::Config;
use bno055_driver::config::{GyrBandwidth, GyrRange, Sensors};
use tvc_imu::Description;

/// The driver.
pub type Sensor = bno055_driver::Driver;

/// The sensor's settings: the driver's defaults, but for these.
///
/// Half the gyroscope's range: 1000 deg/s is three times the 6 rad/s of a fall, and a rate whose
/// highest bit was flipped on the cable lies outside of it whatever the rate was.
///
/// 47 Hz of the gyroscope's bandwidth instead of 116: what a propeller shakes near the rate at
/// which the sensor refreshes tilts the attitude by a fifth to a third less, and flights without
/// vibration are as good.
///
/// Either address, because breakouts differ, and no second BNO055 is on the bus. No need of a
/// magnetometer, because control needs no heading.
const CONFIG: Config = Config {
    sensors: Sensors {
        gyr_range: GyrRange::Dps1000,
        gyr_bandwidth: GyrBandwidth::Hz47,
        ..Sensors::DEFAULT
    },
    either_address: true,
    needs_mag: false,
    ..Config::DEFAULT
};

/// What it is like.
pub const DESCRIPTION: Description = CONFIG.description();

/// The driver with the settings.
pub fn new() -> Sensor {
    Sensor::new(CONFIG)
}

/// Counts of 1 m/s2.
pub const ACC_COUNTS: f32 = 1.0 / DESCRIPTION.scale.acc_m_s2;
/// Counts of 1 deg/s.
pub const GYR_COUNTS: f32 = core::f32::consts::PI / 180.0 / DESCRIPTION.scale.gyr_rad_s;
/// Counts of 1 uT.
pub const MAG_COUNTS: f32 = 1.0 / DESCRIPTION.scale.mag_ut;

/// Standard deviation of the gyroscope's offset behind a rest of half a minute, deg/s: what its
/// noise leaves, and its wandering since (6.5 deg/h).
pub const GYR_OFFSET_SD_DEG_S: f32 = 0.01;

/// Noise of the gyroscope, deg/s/sqrt(Hz) (data sheet, table 0-2).
pub const GYR_NOISE_DEG_RTS: f32 = 0.014;
