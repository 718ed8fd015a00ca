//! What is done with a rig: flights, profiles, campaigns of faults, replays of recordings, and
//! running in real time behind a pseudo-terminal or USB/IP.

pub mod action;
pub mod attended;
#[cfg(unix)]
pub mod control;
pub mod faults;
pub mod flight;
pub mod gdb;
pub mod pilot;
pub mod profile;
#[cfg(unix)]
pub mod pty;
#[cfg(unix)]
pub mod real_time;
pub mod replay;
pub mod rocket;
mod servo_kind;
pub mod usbip;
