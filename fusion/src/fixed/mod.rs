//! The filters in fixed point, for cores without an FPU: raw sensor counts in, no float and no 64-bit
//! multiplication in the update, and the same bits on every machine.

mod estimator;
mod field;
mod filters;
mod number;
mod orientation;
mod over_range;
mod rest;
mod rotation;

pub use estimator::{Counts, Estimator, Scale};
pub use filters::{Filter, Gain, Mahony, View, Vqf};
pub use orientation::{Angles, Orientation};
pub use over_range::{Ignored, OverRange, Recovered};

/// The power of two that is nearest to a value of 1 or more.
fn nearest_log2(value: f32) -> u8 {
    let (mut value, mut bits) = (value, 0);
    while value > core::f32::consts::SQRT_2 {
        value *= 0.5;
        bits += 1;
    }
    bits
}
