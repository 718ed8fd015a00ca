//! The virtual rig: the emulated chip with everything that is soldered and bolted to it.
//!
//! ```text
//!            +----------------- Rig ------------------------------------------+
//!  Operator  |  Chip (samd21)                World                             |
//!  MAVLink <-USB-> image         <-I2C->  Bno055  <- pitch, rate, field -+     |
//!            |                   -D3---->  servo -> crank -> rudder -> drone   |
//!            |                   -D4---->  Truth: bursts, steps, pulses, motion|
//!            +------------------------------------------------------------------+
//! ```
//!
//! Everything runs on one clock ([`Ticks`] since power-on) and out of one
//! seed: the same seed gives the same bytes. A [`Rig`] is a plain value: clone it to fork the world.
//!
//! | module | what |
//! |---|---|
//! | [`image`] | builds the firmware and reads its ELF file |
//! | [`Rig`] | chip, world and bootloader together |
//! | [`world`] | sensor, servo, drone, clamp |
//! | [`bno055`] | the sensor at register level, with its faults |
//! | [`disturbance`] | vibration, sagging servo supply, slow thrust |
//! | [`truth`], [`measure`] | what really happened, and timing figures of it |
//! | [`link`], [`request`], [`operator`] | the MAVLink client at the USB port |
//! | `real_time`, `pty`, [`hand`] | on the clock on the wall, behind a pseudo-terminal (Unix) |
//! | [`flight`] | boot once, fork, let go, measure |
//! | [`faults`] | the same flight with everything that a sensor does wrong, at random instants |
//! | [`handling`] | a sensor in the hand, and what `tvc calibrate` asks of whoever holds it |
//! | [`replay`] | real recordings through the image |

pub mod bno055;
pub mod disturbance;
pub mod faults;
pub mod flight;
pub mod hand;
pub mod handling;
pub mod image;
pub mod link;
pub mod measure;
pub mod operator;
#[cfg(unix)]
pub mod pty;
pub mod random;
#[cfg(unix)]
pub mod real_time;
mod received;
pub mod replay;
pub mod request;
mod rig;
mod tap;
pub mod timed_fault;
pub mod truth;
pub mod world;

pub use flight::{FlightRecord, Ready, ServoKind, Setup, prepare};
pub use image::Image;
pub use operator::Operator;
pub use rig::{Rig, RigConfig, RigError};

pub use samd21::board::Ticks;
pub use samd21::peripherals::ResetCause;
pub use samd21::{SyncHold, WaitStates};
