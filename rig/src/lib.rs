//! The virtual rig: the emulated chip with everything that is soldered and bolted to it.
//!
//! ```text
//!            +----------------- Rig ------------------------------------------+
//!  Operator  |  Chip (samd21)                Environment                       |
//!  MAVLink <-USB-> image         <-I2C->  Bno055  <- pitch, rate, field -+     |
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
//! | [`Rig`] | chip, environment and bootloader together |
//! | [`bench`] | sensor, servo, drone, clamp; what disturbs them ([`disturbance`]); the sensor moved by hand ([`sensor_motion`]) |
//! | [`bno055`] | the sensor at register level, with its faults |
//! | [`observe`] | what really happened ([`ground_truth`]), and timing figures of it ([`measure`]) |
//! | [`fly`] | flights ([`flight`]), campaigns of faults ([`faults`]), recordings through the image ([`replay`]), the person at the rig ([`pilot`]), and on Unix real time behind a pseudo-terminal (`real_time`, `pty`) |
//! | [`link`], [`request`], [`operator`], [`instruction`] | the MAVLink client at the USB port |
//! | [`recording`], [`score`] | real recordings, and errors against their reference |

pub mod bench;
pub mod bno055;
pub mod fly;
pub mod image;
pub mod instruction;
pub mod link;
pub mod observe;
pub mod operator;
pub mod random;
mod received;
pub mod recording;
pub mod request;
mod rig;
pub mod score;

pub use bench::{disturbance, sensor_motion};
pub use fly::flight::{FlightRecord, Ready, ServoKind, Setup, prepare};
pub use fly::{faults, flight, pilot, replay};
#[cfg(unix)]
pub use fly::{pty, real_time};
pub use image::Image;
pub use observe::{ground_truth, measure};
pub use operator::Operator;
pub use rig::{Rig, RigConfig, RigError};

pub use samd21::board::Ticks;
pub use samd21::peripherals::ResetCause;
pub use samd21::{SyncHold, WaitStates};
