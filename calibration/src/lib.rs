//! Calibration: from recorded samples to offsets, scales and soft iron, or to the reason why not.
//!
//! It runs on the host, in `f64`; the firmware applies the result (its module `mount`). Vectors are
//! along the sensor's axes, in m/s2, rad/s and uT.
//!
//! | fit | from | gives |
//! |---|---|---|
//! | [`rest`] | ten seconds without any motion (the tombstone test) | gyroscope bias |
//! | [`poses`] | rest on six faces, or in more directions | accelerometer offset and scale |
//! | [`per_g`] | the same rests | shift of the gyroscope's offset by acceleration |
//! | [`ellipsoid`] | a turn through all directions | magnetometer hard and soft iron |
//! | [`alignment`] | the same turn | polarity and alignment of the sensors against each other |
//! | [`level`] | rest with the body level | mount rotation |
//!
//! [`fit`] does them all, one after another, on [`Readings`]; [`stillness`] finds the rests in
//! them. [`prompt`] is what a person is asked to do so that there is something to fit.
#![forbid(unsafe_code)]

pub mod alignment;
pub mod coverage;
pub mod ellipsoid;
pub mod fit;
pub mod level;
pub mod per_g;
pub mod poses;
pub mod prompt;
mod readings;
pub mod rest;
pub mod stillness;

pub use fit::{Found, Wanted};
pub use readings::{Reading, Readings, Sample};

use nalgebra::{Matrix3, Vector3};

/// Names of the axes.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Standard gravity, m/s2.
pub const STANDARD_GRAVITY: f64 = 9.806_65;

/// What is calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Sensor {
    /// Gyroscope: bias.
    Gyr,
    /// Accelerometer: offset and scale.
    Acc,
    /// Magnetometer: hard and soft iron.
    Mag,
    /// Mount: roll and pitch, with the body level.
    Level,
}

/// What a sensor should have read: `matrix * (reading - offset)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// Reading at zero input, in the sensor's unit.
    pub offset: Vector3<f64>,
    /// Scale, misalignment and, of the magnetometer, soft iron.
    pub matrix: Matrix3<f64>,
}

impl Correction {
    /// A sensor that reads what it should.
    pub const NONE: Self = Self {
        offset: Vector3::new(0.0, 0.0, 0.0),
        matrix: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    };

    /// What the sensor should have read.
    pub fn apply(&self, reading: &Vector3<f64>) -> Vector3<f64> {
        self.matrix * (reading - self.offset)
    }

    /// Root of the mean squared deviation of the corrected readings from `strength`.
    fn deviation<'a>(
        &self,
        readings: impl Iterator<Item = &'a Vector3<f64>>,
        strength: f64,
    ) -> f64 {
        let (mut squares, mut count) = (0.0, 0.0);
        for reading in readings {
            let off = self.apply(reading).norm() - strength;
            squares += off * off;
            count += 1.0;
        }
        libm::sqrt(squares / f64::max(count, 1.0))
    }
}

/// Mean of vectors, and the standard deviation along each axis; `None` of nothing.
pub fn spread<'a>(
    vectors: impl Iterator<Item = &'a Vector3<f64>>,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let mut count = 0.0;
    let (mut mean, mut squares) = (Vector3::zeros(), Vector3::zeros());
    // Welford's recurrence: no cancellation of large squares.
    for vector in vectors {
        count += 1.0;
        let before: Vector3<f64> = vector - mean;
        mean += before / count;
        squares += before.component_mul(&(vector - mean));
    }
    (count > 0.0).then(|| (mean, (squares / count).map(libm::sqrt)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_by_hand() {
        let vectors = [Vector3::new(1.0, 5.0, 0.0), Vector3::new(3.0, 5.0, -4.0)];
        let (mean, deviation) = spread(vectors.iter()).unwrap();
        assert_eq!(mean, Vector3::new(2.0, 5.0, -2.0));
        assert_eq!(deviation, Vector3::new(1.0, 0.0, 2.0));
        assert_eq!(spread([].iter()), None);
    }

    #[test]
    fn a_correction_takes_off_the_offset_first() {
        let correction = Correction {
            offset: Vector3::new(1.0, 0.0, 0.0),
            matrix: Matrix3::from_diagonal(&Vector3::new(2.0, 1.0, 1.0)),
        };
        let corrected = correction.apply(&Vector3::new(3.0, 4.0, 5.0));
        assert_eq!(corrected, Vector3::new(4.0, 4.0, 5.0));
    }
}
