#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

#[cfg(feature = "offline")]
extern crate alloc;
#[cfg(test)]
extern crate std;

mod complementary;
mod config;
mod consistency;
pub mod docs;
mod error;
mod estimator;
mod field;
pub mod filter;
#[cfg(feature = "fixed")]
pub mod fixed;
mod gyro;
mod kalman;
mod lag;
mod madgwick;
mod mahony;
mod motion_bias;
#[cfg(feature = "offline")]
pub mod offline;
mod quality;
mod quaternion;
mod range;
mod real;
mod recovery;
mod rest;
mod settings;
#[cfg(feature = "signal")]
pub mod signal;
mod vector;
mod vqf;

pub use complementary::{Complementary, ComplementaryGains};
pub use config::{Config, GRAVITY};
pub use error::ConfigError;
pub use estimator::{Attitude, Estimator, FieldReference, Flags, Sample, State};
pub use field::FieldConfig;
pub use filter::Filter;
pub use gyro::Gyro;
pub use kalman::{Kalman, KalmanGains};
pub use madgwick::{Madgwick, MadgwickGains};
pub use mahony::{Mahony, MahonyGains};
pub use quality::{BiasState, Quality};
pub use quaternion::{Euler, Quaternion};
pub use rest::RestConfig;
pub use vqf::{Vqf, VqfGains};
