#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

#[cfg(feature = "async")]
pub mod asynchronous;
#[cfg(feature = "blocking")]
pub mod blocking;
mod driver;
mod fault;
#[cfg(any(feature = "blocking", feature = "async"))]
mod front;
mod health;
mod hex;
pub mod judge;
pub mod pace;
mod refresh;
mod report;
mod sample;
mod time;
mod transfer;

pub use driver::{Bursts, Description, Imu, Next};
pub use fault::SensorFault;
pub use health::Health;
pub use hex::Hex;
pub use refresh::Refresh;
pub use report::Report;
pub use sample::{NewRates, RawSample, Sample, Scale};
pub use time::Micros;
pub use transfer::{
    BusError, Bytes, READ_MAX, TRANSFER_DEADLINE_US, Transfer, Transferred, WRITE_MAX,
};
