//! What comes in, and what goes out.

use nalgebra::Vector3;

use crate::config::GRAVITY;
use crate::quaternion::Quaternion;
use crate::real::Real;
use crate::vector::scaled;

/// One sample of the sensors, all in the same body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// Rotation rate, rad/s: mean over the time since the last sample, right-handed about each
    /// axis.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub gyr: Vector3<f32>,
    /// Specific force, m/s^2: at rest 9.81 along the axis that points up, so (0, 0, -9.81) in a
    /// level forward-right-down frame.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub acc: Vector3<f32>,
    /// Magnetic field, uT (or any unit that makes the earth's larger than 0.1), when there is a
    /// fresh one; `None` for 6D operation and between the samples of a slower magnetometer.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub mag: Option<Vector3<f32>>,
}

/// The estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: nalgebra::Scalar + serde::Serialize",
        deserialize = "T: nalgebra::Scalar + serde::de::DeserializeOwned"
    ))
)]
pub struct Attitude<T = f32> {
    /// Body to earth (north, east, down); without a magnetometer north is where the estimate
    /// started.
    pub orientation: Quaternion<T>,
    /// Rotation rate less the offset, body frame, rad/s.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub rate: Vector3<T>,
    /// Gyroscope offset, rad/s.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub bias: Vector3<T>,
    /// Health of the estimate.
    pub flags: Flags,
}

/// Health of an estimate. Each flag is about the last update, unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Flags {
    /// Gravity (and, with a magnetometer, the field) has been averaged for the start-up time, once.
    pub initialised: bool,
    /// The body is at rest; its gyroscope offset is being learned.
    pub at_rest: bool,
    /// The accelerometer was ignored: free fall, outside the gate, or not a number.
    pub acc_rejected: bool,
    /// The last field sample was disturbed, or not a number.
    pub mag_disturbed: bool,
    /// A rate is clipped, or was within the last seconds: corrections are faster, and errors
    /// larger, than usual.
    pub over_range: bool,
    /// The time step was not positive, or a rate not a number: the update was skipped.
    pub skipped: bool,
    /// Samples were missing for longer than the configured gap before this update.
    pub gap: bool,
}

impl<T: Real> Attitude<T> {
    /// Gravity in the body frame, m/s^2: 9.81 along the axis that points down.
    pub fn gravity(&self) -> Vector3<T> {
        scaled(&self.orientation.up(), T::from_f32(-GRAVITY))
    }

    /// The acceleration of the body in its own frame, m/s^2, that a specific force shows: 0 at rest
    /// and in steady motion.
    pub fn linear_acceleration(&self, acc: &Vector3<f32>) -> Vector3<T> {
        let gravity = self.gravity();
        let part = |acc: f32, gravity: T| T::from_f32(acc) + gravity;
        Vector3::new(
            part(acc.x, gravity.x),
            part(acc.y, gravity.y),
            part(acc.z, gravity.z),
        )
    }

    /// The same in the earth frame: north, east, down.
    pub fn earth_acceleration(&self, acc: &Vector3<f32>) -> Vector3<T> {
        self.orientation.rotate(&self.linear_acceleration(acc))
    }
}
