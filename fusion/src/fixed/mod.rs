//! The filters in fixed point, for cores without an FPU. They take raw sensor counts. An update has
//! no float and no 64-bit multiplication, and gives the same bits on every machine.
//!
//! ```
//! use tvc_fusion::{Config, fixed};
//!
//! let estimator =
//!     fixed::Estimator::<fixed::Mahony>::new(&Config::default(), &fixed::Scale::BNO055, 10_000)?;
//! let mut state = estimator.start();
//! let counts = fixed::Counts { gyr: [0; 3], acc: [0, 0, -981], mag: Some([272, 0, 752]) };
//! for _ in 0..200 {
//!     estimator.update(&mut state, 10_000, &counts); // microseconds since the sample before
//! }
//! let angles = estimator.orientation(&state).angles();
//! assert!(fixed::Angles::to_rad(angles.pitch).abs() < 1e-2);
//!
//! let stored = *state.words(); // [u32; fixed::State::WORDS]
//! let restored = fixed::State::from_words(&stored);
//! assert!(restored == state && estimator.accepts(&restored));
//! # Ok::<(), tvc_fusion::ConfigError>(())
//! ```
//!
//! [`Estimator`] holds constants, [`State`] everything that changes. [`AnyFilter`] chooses a filter
//! at run time. `Gyro` and `Kalman` are float only.
//!
//! - Over ten minutes at 1 kHz, Mahony and VQF stay within 0.025 deg RMS of `f64`, except in
//!   start-up.
//! - BNO055, BMI270, ICM-20948, LSM6DSO, MPU-6050 and MPU-9250 fit at all ranges from 104 to
//!   2,000 Hz. [`PERIOD_US`] and [`Scale`] say the limits.
//! - It refuses the accelerometer's gate and Mahony's integral gain.
//! - It does not recover from clipping: choose a sufficient range.

mod any;
mod counts;
mod estimator;
mod field;
mod field_lag;
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
pub use field_lag::FieldLag;
pub use filters::{Complementary, Filter, Madgwick, Mahony, Vqf};
pub use orientation::{Angles, Orientation};
pub use sensors::{Ideal, Late, Sensors};
pub use state::State;
