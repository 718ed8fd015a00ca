//! `tvc` on recordings, models and images: what needs no vehicle in real time.

mod command_line;
mod cycles;
mod experiment;
mod fuse;
mod image;
mod model;
mod outputs;
#[path = "../running/mod.rs"]
mod running;
mod tuning;
