#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

#[cfg(feature = "async")]
pub mod asynchronous;
mod axes;
#[cfg(feature = "blocking")]
pub mod blocking;
pub mod config;
mod driver;
#[cfg(any(feature = "blocking", feature = "async"))]
mod front;
mod fusion;
mod mode;
#[cfg(feature = "requests")]
mod profile;
mod register_enums;
pub mod registers;
#[cfg_attr(not(feature = "requests"), path = "no_requests.rs")]
mod request;
mod sample;
mod sensors;
mod settings;
mod startup;
mod status;
mod units;
mod verify;
#[cfg_attr(not(feature = "requests"), allow(dead_code))]
mod words;
#[cfg(not(feature = "requests"))]
use request as profile;

pub use config::Config;
pub use driver::Driver;
pub use fusion::{FusionSample, QUATERNION_UNIT};
#[cfg(feature = "requests")]
pub use profile::ProfileError;
pub use profile::{Profile, SoftIron};
pub use request::{Answer, Request};
pub use startup::BOOT_DEADLINE_US;
pub use status::{CalibrationStatus, Identity, SelfTest, SystemError, SystemStatus};
pub use tvc_imu::judge::{GLITCH_US, STEP_AGE_US};
pub use tvc_imu::{
    BusError, Bytes, Health, Imu, Micros, Next, READ_MAX, RawSample, Sample, Scale, SensorFault,
    TRANSFER_DEADLINE_US, Transfer, Transferred, WRITE_MAX,
};
