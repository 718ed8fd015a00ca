//! An emulated ATSAMD21 (Cortex-M0+, 256 KB flash, 32 KB SRAM) that runs a firmware image as it is.
//!
//! [`Chip`] joins an ARMv6-M core with ARM's published cycle timing, the memories, the peripherals
//! and a USB host at the other end of the cable. It counts time in [`Ticks`](board::Ticks) of
//! 1/48 us. It knows no board: what is soldered round the chip implements
//! [`Board`](board::Board), which also names the pins of its I2C bus. A clone of a chip is a
//! snapshot of it.
//!
//! ```
//! use samd21::board::{Ticks, Unconnected};
//! use samd21::chip::Stop;
//! use samd21::{Chip, Options};
//!
//! let mut chip = Chip::new(Options::default());
//! // Stack pointer and entry point; MOVS R0, #42; BKPT.
//! chip.load_flash(0, &[0, 0x80, 0, 0x20, 9, 0, 0, 0, 42, 0x20, 0, 0xBE]);
//! chip.boot(0);
//! let stop = chip.run_until(Ticks::from_ms(1), &mut Unconnected);
//! assert_eq!(stop, Stop::Breakpoint);
//! assert_eq!(chip.registers().r[0], 42);
//! ```
//!
//! The instructions are compared with an independent core: `samd21/tools/differential.py` runs
//! random programs on both and compares registers, flags and memory; some of its programs are
//! stored and run with `cargo test`. Exceptions, faults, sleep and cycles, which that core does not
//! have or does not count, are tested against ARM's manuals, by programs written for the purpose.
//! Each file begins with what it leaves out.

#![forbid(unsafe_code)]

pub mod board;
mod bus;
pub mod chip;
mod core;
/// Instructions, decoded: for whoever examines an image without running it.
pub mod code {
    pub use crate::core::decode::{Instruction, NOBODY, Operation, ZERO, high_fields};
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
pub use options::{Options, SyncHold};
