//! How acceleration shifts the gyroscope's offset.
//!
//! At rest with the specific force `f`, in g, it reads `rate = b + M f`. A pose gives three
//! equations for the twelve unknowns, weighted by its length; six faces determine them.

use nalgebra::{Matrix3, Matrix4, Matrix4x3, Vector3, Vector4};

/// Noise of the gyroscope, rad/s/sqrt(Hz): 0.014 deg/s/sqrt(Hz) (BNO055 data sheet, table 0-2).
const NOISE: f64 = 0.014 * core::f64::consts::PI / 180.0;

/// By how much its offset wanders between two poses, rad/s: 6.5 deg/h.
const WANDER: f64 = 6.5 / 3600.0 * core::f64::consts::PI / 180.0;

/// A pose at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Specific force, g.
    pub force: Vector3<f64>,
    /// Mean rate, rad/s.
    pub rate: Vector3<f64>,
    /// Length, s.
    pub seconds: f64,
}

/// The shift of the rates by specific force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerG {
    /// rad/s for each g; a column for each axis of the force.
    pub matrix: Matrix3<f64>,
    /// Standard deviation of a part of it, rad/s for each g.
    pub deviation: f64,
}

/// The shift out of poses; `None` where they do not show it for every axis.
pub fn fit(poses: &[Pose]) -> Option<PerG> {
    let (mut normal, mut right) = (Matrix4::zeros(), Matrix4x3::zeros());
    for Pose { force, rate, seconds } in poses {
        let row = Vector4::new(1.0, force.x, force.y, force.z);
        normal += row * row.transpose() * *seconds;
        right += row * rate.transpose() * *seconds;
    }
    let inverse = normal.try_inverse()?;
    let solution = inverse * right;
    let largest = inverse.diagonal().rows(1, 3).max();
    Some(PerG {
        matrix: solution.fixed_rows::<3>(1).transpose(),
        // The mean of T seconds of white noise has the variance NOISE^2 / (2 T). Of two poses that
        // differ by 2 g, half the difference counts.
        deviation: libm::sqrt(0.5 * (NOISE * NOISE * largest + WANDER * WANDER)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::poses::Face;

    fn six(seconds: f64) -> Vec<Pose> {
        let matrix = Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0) * 1e-3;
        let offset = Vector3::new(0.01, -0.02, 0.03);
        let pose =
            |face: Face| Pose { force: face.up(), rate: offset + matrix * face.up(), seconds };
        Face::ALL.map(pose).into()
    }

    /// Two opposite faces of 8 s each: half the difference of two means, each good to
    /// 0.014 / sqrt(16) = 0.0035 deg/s.
    #[test]
    fn six_faces_give_the_matrix_and_how_well_it_is_known() {
        let found = fit(&six(8.0)).unwrap();
        let expected = Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0) * 1e-3;
        assert!((found.matrix - expected).amax() < 1e-12, "{found:?}");
        let deviation = f64::hypot(0.0035, 6.5 / 3600.0) / f64::sqrt(2.0);
        assert!((found.deviation.to_degrees() - deviation).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn poses_in_a_plane_do_not_show_it() {
        assert_eq!(fit(&six(8.0)[..4]), None);
        assert_eq!(fit(&[]), None);
    }
}
