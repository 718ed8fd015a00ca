//! The filters in fixed point, for cores without an FPU. They take raw sensor counts. An update has
//! no float and no 64-bit multiplication, and gives the same bits on every machine.

mod any;
mod counts;
mod estimator;
mod field;
mod filters;
mod format;
mod lag;
mod orientation;
mod quality;
mod rest;
mod rotation;
mod sensors;
mod start_up;
mod state;

pub use any::{AnyFilter, AnyGains};
pub use counts::{Counts, PERIOD_US, Scale};
pub use estimator::Estimator;
pub use filters::{Complementary, Filter, Madgwick, Mahony, Vqf};
pub use orientation::{Angles, Orientation};
pub use sensors::{Ideal, Late, Sensors};
pub use state::State;
