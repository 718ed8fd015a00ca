//! `lab` on images, recordings and rigs that run as fast as the machine can: these tests keep all
//! cores busy.

mod cycles;
mod examples;
mod faults;
mod keys;
#[path = "../../../ground/tests/running/mod.rs"]
mod running;
mod stack;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_lab");
