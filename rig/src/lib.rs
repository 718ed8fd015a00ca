//! The virtual rig: the emulated chip with everything that is soldered and bolted to it.
//!
//! ```text
//!            +----------------- Rig ------------------------------------------+
//!  Ground    |  Chip (samd21)                Environment                       |
//!  station <-USB-> image         <-I2C->  Bno055  <- pitch, rate, field -+     |
//!            |                   -D3---->  servo -> crank -> rudder -> drone   |
//!            |                   -D4---->  GroundTruth: bursts, steps, pulses, motion|
//!            +------------------------------------------------------------------+
//! ```
//!
//! Everything runs on one clock ([`Ticks`] since power-on) and out of one
//! seed: the same seed gives the same bytes. A [`Rig`] is a plain value: clone it to fork the environment.
//!
//! | module | what |
//! |---|---|
//! | [`image`] | builds the firmware and reads its ELF file |
//! | [`Rig`] | chip, environment and bootloader together |
//! | [`environment`] | sensor, servo, drone, clamp |
//! | [`bno055`] | the sensor at register level, with its faults |
//! | [`disturbance`] | vibration, sagging servo supply, slow thrust |
//! | [`truth`], [`measure`] | what really happened, and timing figures of it |
//! | [`ground_station`] | the MAVLink client at the USB port |
//! | `real_time`, `pty`, [`hand`] | on the clock on the wall, behind a pseudo-terminal (Unix) |
//! | [`flight`] | boot once, fork, let go, measure |
//! | [`faults`] | the same flight with everything that a sensor does wrong, at random instants |
//! | [`handling`], [`instruction`] | a sensor in the hand, and what `tvc calibrate` asks of whoever holds it |
//! | [`recording`], [`replay`], [`score`] | real recordings through the image |

pub mod bench;
pub mod bno055;
pub mod fly;
pub mod ground_station;
pub mod image;
pub mod instruction;
pub mod observe;
pub mod random;
mod received;
pub mod recording;
mod rig;
pub mod score;

pub use bench::{disturbance, sensor_motion};
pub use fly::flight::{FlightRecord, Ready, ServoKind, Setup, prepare};
pub use fly::{faults, flight, pilot, replay};
#[cfg(unix)]
pub use fly::{pty, real_time};
pub use ground_station::GroundStation;
pub use image::Image;
pub use observe::{ground_truth, measure};
pub use rig::{Rig, RigConfig, RigError};

pub use samd21::board::Ticks;
pub use samd21::peripherals::ResetCause;
pub use samd21::{SyncHold, WaitStates};
