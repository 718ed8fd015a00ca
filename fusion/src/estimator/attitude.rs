//! Input and output of an estimator.

use crate::config::GRAVITY;
use crate::quaternion::Quaternion;
use crate::real::Real;
use crate::vector::{add, scaled};

/// One sample of the sensors, all in the same body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// Rotation rate, rad/s: mean over the time since the last sample, right-handed about each
    /// axis.
    pub gyr: [f32; 3],
    /// Specific force, m/s^2: at rest 9.81 along the axis that points up, so (0, 0, -9.81) in a
    /// level forward-right-down frame.
    pub acc: [f32; 3],
    /// Magnetic field, uT, or another unit in which the earth's field is larger than 0.1. `None`
    /// for 6D operation and between the samples of a slower magnetometer.
    pub mag: Option<[f32; 3]>,
}

/// The estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Attitude<T = f32> {
    /// Body to earth (north, east, down); without a magnetometer, north is the heading at the
    /// start.
    pub orientation: Quaternion<T>,
    /// Rotation rate less the offset, body frame, rad/s.
    pub rate: [T; 3],
    /// Gyroscope offset, rad/s.
    pub bias: [T; 3],
    /// Health of the estimate.
    pub flags: Flags,
}

/// Health of an estimate. Each flag is about the last update, unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Flags {
    /// The start-up time is over: gravity, and the field with a magnetometer, have been averaged.
    pub initialised: bool,
    /// The body is at rest; its gyroscope offset is being learned.
    pub at_rest: bool,
    /// The accelerometer was ignored: free fall, parts of g, outside the gate, or not a number.
    pub acc_rejected: bool,
    /// The last field sample was disturbed, or not a number.
    pub mag_disturbed: bool,
    /// A rate is clipped, or clipped within the last seconds: corrections are faster and errors
    /// larger than usual.
    pub over_range: bool,
    /// The time step was not positive, or a rate not a number: the update was skipped.
    pub skipped: bool,
    /// Samples were missing for longer than the configured gap before this update.
    pub gap: bool,
}

impl<T: Real> Attitude<T> {
    /// Gravity in the body frame, m/s^2: 9.81 along the axis that points down.
    pub fn gravity(&self) -> [T; 3] {
        scaled(&self.orientation.up(), T::from_f32(-GRAVITY))
    }

    /// The acceleration of the body in its own frame, m/s^2, that a specific force shows: 0 at rest
    /// and in steady motion.
    pub fn linear_acceleration(&self, acc: &[f32; 3]) -> [T; 3] {
        let mut motion = acc.map(T::from_f32);
        add(&mut motion, &self.gravity());
        motion
    }

    /// The acceleration of the body in the earth frame: north, east, down.
    pub fn earth_acceleration(&self, acc: &[f32; 3]) -> [T; 3] {
        self.orientation.rotate(&self.linear_acceleration(acc))
    }
}
