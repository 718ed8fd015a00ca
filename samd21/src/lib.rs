//! An emulated ATSAMD21 (Cortex-M0+, 256 KB flash, 32 KB SRAM) that runs a firmware image as it is.
//!
//! [`Chip`] joins an ARMv6-M core with ARM's published cycle timing, the memories and the
//! peripherals. It counts time in [`Ticks`](board::Ticks) of 1/48 us and knows nothing of what it
//! is used for: what is soldered round it implements [`Board`](board::Board). A chip is a plain
//! value: to snapshot it is to clone it.

pub mod board;
pub mod chip;
mod core;
pub mod fault;
pub mod memory;
mod options;
pub mod peripherals;
pub mod usb_host;

pub use chip::Chip;
pub use options::{Options, SyncHold, WaitStates};
