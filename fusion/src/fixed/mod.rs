//! The filters in fixed point, for cores without an FPU: raw sensor counts in, no float and no
//! 64-bit multiplication in the update, and the same bits on every machine.

mod any;
mod counts;
mod estimator;
mod field;
mod filters;
mod format;
mod lag;
mod memory;
mod number;
mod orientation;
mod over_range;
mod quality;
mod rest;
mod rotation;
mod start_up;

pub use any::{AnyFilter, AnyGains};
pub use counts::{Counts, PERIOD_US, Scale};
pub use estimator::Estimator;
pub use filters::{Complementary, Correction, Filter, Gain, Heading, Madgwick, Mahony, View, Vqf};
pub use memory::MEMORY_WORDS;
pub use orientation::{Angles, Orientation};
pub use over_range::{Ignored, OverRange, Recovered};
