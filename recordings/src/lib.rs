//! Recordings of an IMU, any filter of `tvc-fusion` on them, and how far it is from the truth.
//!
//! | | |
//! |---|---|
//! | [`Source`] | reads `IMUQ16v1` ([`imuq`]) or CSV (SI units, or counts), sample by sample |
//! | [`Recording`] | a whole recording in the format `IMUQ16v1` |
//! | [`Estimate`] | runs a filter, chosen by [`Choice`], in any arithmetic |
//! | [`smooth`] | runs a filter over a whole recording, forth and back in time |
//! | [`Scorer`] | errors against the recording's reference, as the BROAD benchmark defines them |
//!
//! Vectors are along the axes of the recorded sensor. References take them to east-north-up,
//! estimates to north-east-down; [`enu_from_ned`] converts.
#![forbid(unsafe_code)]

mod choice;
mod error;
mod estimate;
pub mod imuq;
mod lines;
mod offline;
mod score;
mod settings;
mod source;
mod table;

pub use choice::{Choice, FilterName, Mode, Scalar, Setting};
pub use error::RecordingError;
pub use estimate::Estimate;
pub use imuq::Recording;
pub use lines::Lines;
pub use offline::smooth;
pub use score::{Score, Scorer, enu_from_ned};
pub use source::{Facts, Source};

/// What a count of a BNO055 is worth, as the firmware sets its units.
pub mod bno055 {
    /// Rotation rate, rad/s.
    pub const GYR_RAD_S: f64 = std::f64::consts::PI / 180.0 / 16.0;
    /// Specific force, m/s2.
    pub const ACC_M_S2: f64 = 0.01;
    /// Magnetic field, uT.
    pub const MAG_UT: f64 = 1.0 / 16.0;
}

/// A sample of a recording, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedSample {
    /// Time as recorded, s.
    pub time_s: f64,
    /// Rotation rate, rad/s.
    pub gyr_rad_s: [f64; 3],
    /// Specific force, m/s^2.
    pub acc_m_s2: [f64; 3],
    /// Magnetic field, uT; `None` without a magnetometer, or where it has not measured anew.
    pub mag_ut: Option<[f64; 3]>,
    /// Optical reference `[w, x, y, z]`, sensor to east-north-up with magnetic north; `None`
    /// without one, or where the cameras lost it.
    pub reference: Option<[f64; 4]>,
    /// The sample belongs to the movement, over which errors are taken.
    pub movement: bool,
}
