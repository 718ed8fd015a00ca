//! An emulated ATSAMD21 (Cortex-M0+, 256 KB flash, 32 KB SRAM) that runs a firmware image as it is.
//!
//! [`Chip`] joins an ARMv6-M core with ARM's published cycle timing, the memories and the
//! peripherals. It counts time in [`Ticks`](board::Ticks) of 1/48 us and knows nothing of what it
//! is used for: what is soldered round it implements [`Board`](board::Board). A chip is a plain
//! value: to snapshot it is to clone it.
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
//! The instructions are proven against an independent core: `samd21/tools/differential.py` runs
//! random programs on both and compares registers, flags and memory; some of its programs are
//! stored and run with `cargo test`. Exceptions, faults, sleep and cycles, which that core does not
//! have or does not count, are tested by hand from ARM's manuals. What is left out is said where
//! each file begins.

pub mod board;
mod bus;
pub mod chip;
mod core;
pub mod fault;
pub mod memory;
mod options;
pub mod peripherals;
#[cfg(test)]
mod testing;
pub mod usb_host;

pub use chip::Chip;
pub use options::{Options, SyncHold, WaitStates};
