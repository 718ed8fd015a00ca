//! BNO055 driver.
#![no_std]
