//! The flight of a drone (or a rocket's stand-in) steered by rudders in its wash: attitude,
//! control, servo, failsafe and telemetry. It decides everything and names no hardware:
//! `src/samd21` knows the chip, `src/boards` the pins.
//!
//! [`Flight::step`] is the whole of it: a sample in, a pulse for each axis out. A log replay runs
//! it; the image, on the chip and on the virtual rig, runs its three parts in turn.
//!
//! Body axes: x forward, y right, z down. Earth axes: north, east, down. Pitch is positive nose up,
//! roll right side down.
//! Angles are in rad and rates in rad/s unless a name says otherwise.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

#[cfg(test)]
extern crate std;

pub mod application;
mod axis;
mod blow;
mod board_status;
pub mod bringup;
pub mod bus;
mod channel;
pub mod config;
pub mod controller;
pub mod failsafe;
pub mod flight;
mod format;
#[cfg_attr(not(feature = "free-flight"), path = "tethered.rs")]
mod free_flight;
pub mod guard;
pub mod led;
pub mod mount;
pub mod navigation;
mod numbered;
pub mod params;
pub mod recorder;
pub mod registers;
pub mod sampling;
pub mod self_test;
pub mod sensor;
pub mod servo;
pub mod sleep;
pub mod store;
pub mod telemetry;
#[cfg(test)]
mod tests;
pub mod ticks;
pub mod usb;
pub mod watchdog;
mod words;

pub use axis::Axis;
pub use board_status::BoardStatus;
pub use controller::{Controller, LawState};
pub use failsafe::{
    BootReport, Command, Crash, Latch, Refusal, SelfCheck, State, StateCode, StateKind,
};
pub use flight::{Flight, Snapshot};
pub use params::Params;
pub use recorder::Recorder;
pub use servo::{PulseUs, Servo};
pub use telemetry::Telemetry;
pub use tvc_imu::{Micros, RawSample, Refresh, Sample, SensorFault};
