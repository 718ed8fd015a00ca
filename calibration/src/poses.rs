//! Accelerometer offset and scale: at rest it reads gravity, whichever way it lies.
//!
//! With reading `a`, offset `o` and scale `s`, every pose says `sum of (s_i (a_i - o_i))^2 = g^2`.
//! Multiplied out that is linear in `A_i = s_i^2 / k` and `B_i = -A_i o_i`:
//! `sum of A_i a_i^2 + 2 B_i a_i = 1`, six unknowns and an equation a pose, with
//! `k = g^2 - sum of s_i^2 o_i^2` found afterwards. Six poses on the six faces are enough; more
//! directions average the noise.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::Correction;

/// Least share of gravity that some pose must show on every axis, up and down.
const LEAST_SHARE: f64 = 0.7;
/// Largest rms deviation of the corrected poses from gravity, as a share of it.
const LARGEST_RESIDUAL: f64 = 0.01;
/// Largest offset, as a share of gravity: the data sheet's 80 mg at most, and as much for
/// soldering.
const LARGEST_OFFSET: f64 = 0.16;
/// Largest deviation of a scale from one.
const LARGEST_SCALE: f64 = 0.1;

/// What else a person can do.
const REMEDY: &str = "rest it on all six faces, two seconds each";
/// Why poses are refused that agree with an offset or scale that no such sensor has.
const IMPLAUSIBLE: &str = "the accelerometer's offset or scale comes out larger than such a \
                           sensor has: the poses are not rests";

/// Least cosine between a reading and the direction of the face that it counts for.
const FACE_COS: f64 = 0.9;

/// How the sensor rests, by what points up; the nose is x, the right side y, the bottom z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Face {
    /// x up.
    NoseUp,
    /// x down.
    NoseDown,
    /// y up.
    RightUp,
    /// y down.
    LeftUp,
    /// z up.
    BottomUp,
    /// z down, as the body stands.
    TopUp,
}

impl Face {
    /// All six.
    pub const ALL: [Self; 6] =
        [Self::TopUp, Self::BottomUp, Self::NoseUp, Self::NoseDown, Self::RightUp, Self::LeftUp];

    fn name_and_up(self) -> (&'static str, Vector3<f64>) {
        match self {
            Self::NoseUp => ("nose up", Vector3::x()),
            Self::NoseDown => ("nose down", -Vector3::x()),
            Self::RightUp => ("right side up", Vector3::y()),
            Self::LeftUp => ("left side up", -Vector3::y()),
            Self::BottomUp => ("bottom up", Vector3::z()),
            Self::TopUp => ("top up", -Vector3::z()),
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        self.name_and_up().0
    }

    /// What points up then, along the sensor's axes: where an accelerometer reads gravity.
    pub fn up(self) -> Vector3<f64> {
        self.name_and_up().1
    }

    /// The face on which a sensor rests that reads this force, if it is near one.
    pub fn of(force: &Vector3<f64>) -> Option<Self> {
        let least = FACE_COS * force.norm();
        Self::ALL.into_iter().find(|face| least > 0.0 && face.up().dot(force) >= least)
    }
}

/// What the poses give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Poses {
    /// Offset and scale, m/s2.
    pub correction: Correction,
    /// Root of the mean squared deviation of the corrected poses from gravity, m/s2.
    pub residual: f64,
    /// The same of the poses as they were read, m/s2.
    pub before: f64,
    /// How many there were.
    pub count: usize,
}

/// Offset and scale out of the mean readings of poses at rest, m/s2; `gravity` in m/s2.
///
/// # Errors
/// Why the poses do not determine them.
pub fn fit(readings: &[Vector3<f64>], gravity: f64) -> Result<Poses, String> {
    let count = readings.len();
    if count < 6 {
        return Err(format!("{count} poses at rest are too few for the accelerometer: {REMEDY}"));
    }
    let least = LEAST_SHARE * gravity;
    for face in Face::ALL {
        let up = face.up();
        if !readings.iter().any(|reading| up.dot(reading) > least) {
            let face = face.name();
            return Err(format!("the accelerometer was never at rest with its {face}: {REMEDY}"));
        }
    }
    // In units of gravity, so that the equations are of the same size.
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    for reading in readings {
        let a = reading / gravity;
        let row = Vector6::new(a.x * a.x, a.y * a.y, a.z * a.z, 2.0 * a.x, 2.0 * a.y, 2.0 * a.z);
        normal += row * row.transpose();
        right += row;
    }
    let solution = normal.lu().solve(&right).ok_or(IMPLAUSIBLE)?;
    let squares = solution.fixed_rows::<3>(0).into_owned();
    let offset = -solution.fixed_rows::<3>(3).component_div(&squares);
    let k = 1.0 / (1.0 + squares.dot(&offset.component_mul(&offset)));
    let scale = (squares * k).map(libm::sqrt);
    let plausible =
        offset.amax() <= LARGEST_OFFSET && scale.iter().all(|s| (s - 1.0).abs() <= LARGEST_SCALE);
    if !plausible {
        return Err(IMPLAUSIBLE.to_owned());
    }
    let correction =
        Correction { offset: offset * gravity, matrix: Matrix3::from_diagonal(&scale) };
    let residual = correction.deviation(readings.iter(), gravity);
    if residual > LARGEST_RESIDUAL * gravity {
        return Err(format!(
            "the accelerometer's poses contradict each other by {residual:.2} m/s2: it moved in one of \
             them, or it is broken"
        ));
    }
    Ok(Poses {
        correction,
        residual,
        before: Correction::NONE.deviation(readings.iter(), gravity),
        count,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::STANDARD_GRAVITY;

    const OFFSET: Vector3<f64> = Vector3::new(0.78, -0.5, 0.3);
    const SCALE: Vector3<f64> = Vector3::new(1.02, 0.97, 1.01);

    /// What a sensor with these errors reads where it should read the six faces, a little askew.
    fn six() -> Vec<Vector3<f64>> {
        [
            [1.0, 0.1, 0.0],
            [-1.0, 0.0, 0.1],
            [0.0, 1.0, -0.1],
            [0.1, -1.0, 0.0],
            [0.0, 0.1, 1.0],
            [0.1, 0.0, -1.0],
        ]
        .map(|v| Vector3::from(v).normalize() * STANDARD_GRAVITY)
        .iter()
        .map(|force| force.component_div(&SCALE) + OFFSET)
        .collect()
    }

    #[test]
    fn six_faces_give_offset_and_scale() {
        let poses = fit(&six(), STANDARD_GRAVITY).unwrap();
        assert!((poses.correction.offset - OFFSET).norm() < 1e-9);
        assert!((poses.correction.matrix.diagonal() - SCALE).norm() < 1e-9);
        assert!(poses.residual < 1e-9);
    }

    #[test]
    fn a_face_is_known_by_the_force_even_where_the_offset_is_large() {
        for (reading, face) in six().iter().zip([
            Face::NoseUp,
            Face::NoseDown,
            Face::RightUp,
            Face::LeftUp,
            Face::BottomUp,
            Face::TopUp,
        ]) {
            assert_eq!(Face::of(reading), Some(face));
        }
        assert_eq!(Face::of(&Vector3::new(6.9, 6.9, 0.0)), None);
        assert_eq!(Face::of(&Vector3::zeros()), None);
    }

    #[test]
    fn what_does_not_determine_them_is_refused_with_the_pose_to_add() {
        let why = |readings: &[Vector3<f64>]| fit(readings, STANDARD_GRAVITY).unwrap_err();
        assert!(why(&six()[..5]).contains("5 poses"));
        for (missing, face) in [(0, "nose up"), (1, "nose down"), (4, "bottom up"), (5, "top up")] {
            let mut readings = six();
            readings[missing] = readings[2];
            assert!(why(&readings).contains(face), "{}", why(&readings));
        }
        let mut shaken: Vec<_> = six().into_iter().chain(six()).collect();
        shaken[8] *= 1.1;
        assert!(why(&shaken).contains("contradict"), "{}", why(&shaken));
        let far: Vec<_> = six().iter().map(|r| r + Vector3::new(-2.5, 0.0, 0.0)).collect();
        assert!(why(&far).contains("larger than"), "{}", why(&far));
    }
}
