//! Attitude filters on recordings, in the thesis' experiments, and by their cost on the chip.

pub mod cycles;
pub mod experiment;
pub mod fuse;
mod progress;
