//! The driver over a blocking [`embedded_hal`] bus.
//!
//! ```
//! use bno055_driver::{Config, Micros, SensorFault, blocking::Bno055};
//! use embedded_hal::{delay::DelayNs, i2c::I2c};
//!
//! fn watch(
//!     i2c: impl I2c,
//!     delay: impl DelayNs,
//!     clock: impl FnMut() -> Micros,
//! ) -> Result<(), SensorFault> {
//!     let config = Config::default();
//!     let mut imu = Bno055::new(i2c, delay, clock, config);
//!     imu.start()?;
//!     let sample = imu.sample()?;
//!     let [_, _, z] = sample.acc_m_s2(&config.units.scale());
//!     assert!(z.abs() < 20.0);
//!     Ok(())
//! }
//! ```

use crate::front::front_end;

front_end!(
    embedded_hal::i2c::I2c,
    embedded_hal::delay::DelayNs,
    embedded_hal,
    [],
    []
);
