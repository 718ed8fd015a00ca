//! Polarity and alignment of gyroscope, accelerometer and magnetometer against each other.
//!
//! A direction that is fixed in the world turns in the body by `dv = v x (M theta)`, with `theta`
//! the integral of the rate as read and `M` the matrix that corrects the reading. Gravity and field
//! each give `M` by least squares, nine unknowns out of all turns; three sensors that agree give
//! the identity.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Largest difference of an element to that of the identity; turns by hand are measured late and
/// with noise.
pub const TOLERANCE: f64 = 0.3;

/// A small turn: a direction before and after it, and the integral of the rate, rad, between the
/// two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Unit direction before.
    pub before: Vector3<f64>,
    /// Unit direction after.
    pub after: Vector3<f64>,
    /// Integral of the rate as read.
    pub angle: Vector3<f64>,
}

/// The matrix that the gyroscope's readings must be multiplied with to explain the turns; `None`
/// where the turns do not determine it.
pub fn gyro_by(turns: impl Iterator<Item = Turn>) -> Option<Matrix3<f64>> {
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    let mut right = SVector::<f64, 9>::zeros();
    for turn in turns {
        // The middle of the turn, so that the error is of third order.
        let middle = (turn.before + turn.after) / 2.0;
        let cross = middle.cross_matrix();
        let change = turn.after - turn.before;
        // change = cross * M * angle; M by columns is a vector of nine.
        let mut rows = SMatrix::<f64, 3, 9>::zeros();
        for (column, angle) in turn.angle.iter().enumerate() {
            rows.fixed_columns_mut::<3>(3 * column).copy_from(&(cross * *angle));
        }
        normal += rows.transpose() * rows;
        right += rows.transpose() * change;
    }
    let solution = normal.cholesky()?.solve(&right);
    Some(Matrix3::from_column_slice(solution.as_slice()))
}

/// Whether the matrix is the identity within [`TOLERANCE`].
pub fn agrees(matrix: &Matrix3<f64>) -> bool {
    (matrix - Matrix3::identity()).amax() <= TOLERANCE
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// Turns about changing axes, read by a gyroscope whose axes are `wrong`.
    fn turns(wrong: Matrix3<f64>) -> Vec<Turn> {
        let mut direction = Vector3::new(0.0, 0.0, -1.0);
        (0..300)
            .map(|i| {
                let i = f64::from(i);
                let angle =
                    Vector3::new((i * 0.1).sin(), (i * 0.07).cos(), (i * 0.031).sin()) * 0.1;
                let before = direction;
                // A body that turns by `angle` sees the world turn back.
                direction = Rotation3::new(-angle) * direction;
                Turn { before, after: direction, angle: wrong * angle }
            })
            .collect()
    }

    #[test]
    fn sensors_that_agree_give_the_identity() {
        let matrix = gyro_by(turns(Matrix3::identity()).into_iter()).unwrap();
        assert!((matrix - Matrix3::identity()).amax() < 0.01, "{matrix}");
        assert!(agrees(&matrix));
    }

    #[test]
    fn a_reversed_or_swapped_axis_is_found() {
        let reversed = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        let matrix = gyro_by(turns(reversed).into_iter()).unwrap();
        assert!((matrix - reversed).amax() < 0.01, "{matrix}");
        assert!(!agrees(&matrix));
        let swapped = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let matrix = gyro_by(turns(swapped).into_iter()).unwrap();
        assert!((matrix - swapped).amax() < 0.01, "{matrix}");
    }

    #[test]
    fn no_turns_determine_nothing() {
        assert_eq!(gyro_by(turns(Matrix3::zeros()).into_iter()), None);
    }
}
