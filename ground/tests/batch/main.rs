//! `tvc` on recordings, models, images and rigs that run as fast as the machine can: these tests
//! keep all cores busy.

mod bringup;
mod calibrate;
mod command_line;
mod fuse;
#[cfg(unix)]
mod golden_keys;
mod image;
mod model;
mod outputs;
#[path = "../running/mod.rs"]
mod running;
mod support;
mod tether;
mod tuning;
mod waves;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_tvc");
