//! A BNO055 on the bus of the header.

use bno055_driver::Config;
use bno055_driver::config::{GyrBandwidth, GyrRange, Sensors};
use tvc_imu::Description;

pub(super) use bno055_driver::Driver;

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
pub(super) const DESCRIPTION: Description = CONFIG.description();

/// The driver with the settings.
pub(super) fn new() -> Driver {
    Driver::new(CONFIG)
}
