//! `tvc` at a vehicle: the virtual rig, most of the time in real time behind its pseudo-terminal.
//!
//! It is one program, so that these tests, which mostly wait, run beside each other.

#[cfg(unix)]
mod commands;
#[cfg(unix)]
mod forward;
#[cfg(unix)]
mod info;
#[path = "../running/mod.rs"]
mod running;
#[cfg(unix)]
mod stop;
mod troubleshooting;
#[cfg(unix)]
mod vehicle;
#[cfg(unix)]
mod web;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_tvc");
