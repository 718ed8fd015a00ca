//! Attitude filters on recordings.

pub mod fuse;
pub mod progress;
