//! What the front page leaves out.

/// Accuracy on recordings, stated deviations, and cycles.
#[doc = include_str!("../docs/measured.md")]
pub mod measured {}

/// Sensors that are late, and a start in motion.
#[doc = include_str!("../docs/sensors.md")]
pub mod sensors {}
