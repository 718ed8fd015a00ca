//! The virtual rig: the emulated chip with everything that is soldered and bolted to it.
//!
//! ```text
//!            +----------------- Rig ------------------------------------------+
//!  Ground    |  Chip (samd21)                Environment                       |
//!  station <-USB-> image         <-I2C->  Bno055  <- pitch, rate, field -+     |
//!            |                   -D3---->  servo -> crank -> rudder -> drone   |
//!            |                   -D4---->  GroundTruth: bursts, steps, pulses, |
//!            |                             motion                              |
//!            +------------------------------------------------------------------+
//! ```
//!
//! Everything runs on one clock ([`Ticks`] since power-on) and out of one seed: the same seed gives
//! the same bytes. A [`Rig`] is a plain value: clone it, and both copies go on from the same state.
//!
//! | module | what |
//! |---|---|
//! | [`image`] | builds the firmware and reads its ELF file |
//! | [`Rig`] | chip, environment and [`bootloader`] together |
//! | [`mod@bench`] | sensor, servo, drone, clamp; what disturbs them ([`disturbance`]); the sensor moved by hand ([`sensor_motion`]) |
//! | [`bno055`], [`lsm6ds3`] | the sensors at register level, with their faults; [`inertial`] has the errors of their signals |
//! | [`observe`] | what really happened ([`ground_truth`]), and timing figures of it ([`measure`]) |
//! | [`fly`] | flights ([`flight`]), campaigns of faults ([`faults`]), recordings through the image ([`replay`]), the person at the rig ([`pilot`], [`attended`]) and what is done by hand ([`action`]), and on Unix real time behind a pseudo-terminal (`real_time`, `pty`) with a socket for actions (`control`) |
//! | [`ground_station`] | the MAVLink client at the USB port |

#![forbid(unsafe_code)]

pub mod bench;
pub mod bno055;
pub mod bootloader;
pub mod fly;
pub mod ground_station;
pub mod image;
pub mod inertial;
pub mod lsm6ds3;
mod named_enum;
pub mod observe;
pub mod random;
mod received;
mod rig;
mod unsent;
mod wiring;

pub use bench::{disturbance, sensor_motion};
pub use fly::flight::{FlightRecord, Ready, ServoKind, Setup, fly_at_once, prepare};
pub use fly::{action, attended, faults, flight, gdb, pilot, profile, replay, rocket, usbip};
#[cfg(unix)]
pub use fly::{control, pty, real_time};
pub use ground_station::GroundStation;
pub use image::Image;
pub use observe::{ground_truth, measure, waves};
pub use rig::{LIVE_KEYS, ProgramEnd, Rig, RigConfig, RigError};

pub use samd21::board::Ticks;
pub use samd21::peripherals::ResetCause;
