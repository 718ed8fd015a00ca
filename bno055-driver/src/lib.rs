//! BNO055 driver that survives resets, torn reads and stuck buses; no I/O of its own.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod config;
mod driver;
mod fault;
mod health;
mod profile;
pub mod registers;
mod sample;
mod startup;
mod status;
mod transfer;

pub use config::Config;
pub use driver::{Driver, Next};
pub use fault::SensorFault;
pub use health::Health;
pub use profile::{Profile, ProfileError, SoftIron};
pub use sample::{RawSample, STEP_AGE_US};
pub use startup::BOOT_DEADLINE_US;
pub use status::{Identity, SystemError, SystemStatus};
pub use transfer::{BusError, Bytes, Micros, READ_MAX, TRANSFER_DEADLINE_US, Transfer, WRITE_MAX};
