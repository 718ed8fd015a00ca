#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

mod chip;
pub mod config;
mod driver;
pub mod registers;
mod sample;
#[cfg_attr(not(feature = "self-test"), path = "no_self_test.rs")]
#[cfg_attr(not(feature = "self-test"), allow(dead_code))]
mod self_test;
mod startup;

pub use chip::Chip;
pub use config::Config;
pub use driver::Driver;
#[cfg(feature = "self-test")]
pub use self_test::SelfTest;
pub use startup::BOOT_DEADLINE_US;
#[cfg(feature = "async")]
pub use tvc_imu::asynchronous;
#[cfg(feature = "blocking")]
pub use tvc_imu::blocking;
pub use tvc_imu::{
    BusError, Bytes, Health, Imu, Micros, Next, READ_MAX, RawSample, Sample, Scale, SensorFault,
    TRANSFER_DEADLINE_US, Transfer, Transferred, WRITE_MAX,
};
