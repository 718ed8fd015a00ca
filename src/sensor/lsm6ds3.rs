//! The LSM6DS3 of the Nano 33 IoT, on the same bus.

use lsm6ds3_driver::Config;
pub(super) use lsm6ds3_driver::Driver;
use lsm6ds3_driver::config::Units;
use tvc_imu::{Description, RawSample};

/// The driver's settings: +-8 g and +-1000 deg/s as of the BNO055, in its units, and 833 Hz. The
/// chip's noise is two of those counts.
const CONFIG: Config = Config { units: Units::Bno055, ..Config::DEFAULT };

/// What it is like.
pub(super) const DESCRIPTION: Description = CONFIG.description();

/// The driver with the settings.
pub(super) fn new() -> Driver {
    Driver::new(CONFIG)
}

/// A sample of the chip's counts in the units of the firmware.
pub(super) fn convert(raw: RawSample) -> RawSample {
    CONFIG.convert(raw)
}
