#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod board;
mod bus;
pub mod chip;
mod core;
/// Instructions, decoded: for whoever examines an image without running it.
pub mod code {
    pub use crate::memory::decode::{Instruction, NOBODY, Operation, ZERO, high_fields};
}
pub mod fault;
pub mod memory;
mod options;
pub mod peripherals;
#[cfg(test)]
mod tests;
pub mod upset;
pub mod usb_host;

pub use chip::Chip;
pub use options::Options;
