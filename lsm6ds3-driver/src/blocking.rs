//! The driver over a blocking [`embedded_hal`] bus.

use crate::front::front_end;

front_end!(embedded_hal::i2c::I2c, embedded_hal::delay::DelayNs, tvc_imu::blocking::Device, [], []);
