//! The driver over an [`embedded_hal_async`] bus.
//!
//! A future dropped in the middle of a transfer leaves the transfer without an outcome: the driver
//! asks for it again, or judges the chip by its next burst.

use crate::front::front_end;

front_end!(
    embedded_hal_async::i2c::I2c,
    embedded_hal_async::delay::DelayNs,
    tvc_imu::asynchronous::Device,
    [async],
    [.await]
);
