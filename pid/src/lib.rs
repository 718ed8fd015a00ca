#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

#[cfg(test)]
extern crate std;

mod cascade;
mod config;
mod law;
mod pd;
mod pid;
mod scalar;
mod schedule;
mod state;
mod surface;

pub use cascade::{Cascade, CascadeConfig};
pub use config::{AntiWindup, Config, ConfigError, Derivative, Gains};
pub use law::{Controller, Law, Reading};
pub use pd::Pd;
pub use pid::{Coefficients, Pid, PidState};
pub use scalar::{Q16, Scalar, Share16};
pub use schedule::Schedule;
pub use state::State;
pub use surface::{Surface, SurfaceConfig, SurfaceState};
