//! The virtual rig: the emulated chip with everything that is soldered and bolted to it.

pub mod bno055;
pub mod image;
pub mod link;
pub mod measure;
pub mod random;
pub mod recording;
mod tap;
pub mod truth;
pub mod world;
