//! Attitude filters on recordings.

pub mod fuse;
