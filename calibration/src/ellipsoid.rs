//! Magnetometer hard and soft iron: in a uniform field, the readings of a sensor turned through all
//! directions lie on an ellipsoid.
//!
//! With `d(m) = [x2, y2, z2, 2yz, 2xz, 2xy, 2x, 2y, 2z]` the ellipsoid is `d(m) . p = 1`, linear in
//! nine unknowns. With `Q` and `u` out of `p`, its centre is `-Q^-1 u` (the hard iron), and the
//! symmetric root of `Q`, scaled, turns it into a sphere (the soft iron). Any rotation leaves the
//! sphere a sphere; where the soft iron is not symmetric, gravity determines the rotation, because
//! the angle between gravity and field, the dip, is the same in every pose.
//!
//! D. Li and H. Griffiths give the fit (*Geometric Modeling and Processing* 2004); noise biases it
//! by the square of its share of the field, 0.01 % at 0.6 of 50 uT.

use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Matrix4, Rotation3, SMatrix, SVector, Vector3, Vector4};

use crate::coverage::{Coverage, extent};
use crate::{Correction, spread};

/// Least share of all directions that must have been seen.
pub const LEAST_COVERAGE: f64 = 0.6;
/// Fewest readings.
const FEWEST: usize = 200;
/// Largest root mean square deviation from the sphere, as a share of its radius.
const LARGEST_RESIDUAL: f64 = 0.05;
/// A reading that is more standard deviations off is not used.
const OUTLIER: f64 = 4.0;
/// Largest ratio of the ellipsoid's axes.
const LARGEST_RATIO: f64 = 3.0;
/// Earth's field, uT, with a good margin.
const EARTH_UT: RangeInclusive<f64> = 15.0..=100.0;
/// Rounds of the search for the rotation; it converges quadratically.
const ROUNDS: usize = 10;

type Vector9 = SVector<f64, 9>;
type Matrix9 = SMatrix<f64, 9, 9>;

/// What a magnetometer turned through all directions gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    /// Hard iron, uT, and the inverse of the soft iron, which keeps the mean field strength.
    pub correction: Correction,
    /// Strength of the corrected field, uT.
    pub strength: f64,
    /// Root mean square deviation of the corrected strength from that, uT.
    pub residual: f64,
    /// Readings that were used, and those that lay too far off.
    pub used: usize,
    /// See `used`.
    pub outliers: usize,
    /// Directions that were seen.
    pub coverage: Coverage,
}

/// Hard and soft iron out of readings, uT, each of which is a measurement of its own (no repeats).
///
/// # Errors
/// Why the readings do not determine them.
pub fn fit(readings: &[Vector3<f64>]) -> Result<Ellipsoid, String> {
    const NO_ELLIPSOID: &str = "the magnetometer's readings lie on no ellipsoid: \
                                too few directions, or iron or currents that move";
    if readings.len() < FEWEST {
        let count = readings.len();
        return Err(format!(
            "{count} magnetometer readings are too few, {FEWEST} are needed: turn it for a minute"
        ));
    }
    // A reading far from all others would bend the first fit.
    let (mean, deviation_ut) = spread(readings.iter()).ok_or(NO_ELLIPSOID)?;
    let sane = |m: &Vector3<f64>| (m - mean).norm() <= OUTLIER * deviation_ut.norm();
    let Some((mut correction, mut strength)) = sphere(readings, sane) else {
        // The usual cause is that it was not turned enough, and a person can do better.
        must_cover(&Coverage::about_middle(readings.iter().filter(|m| sane(m))))?;
        return Err(NO_ELLIPSOID.to_owned());
    };
    let first = correction.deviation(readings.iter().filter(|m| sane(m)), strength);
    let rough = (correction, strength);
    let near = |m: &Vector3<f64>| {
        (rough.0.apply(m).norm() - rough.1).abs() <= OUTLIER * first.max(f64::MIN_POSITIVE)
    };
    if let Some((finer, radius)) = sphere(readings, near) {
        (correction, strength) = (finer, radius);
    }
    let used = readings.iter().filter(|m| near(m));
    let residual = correction.deviation(used.clone(), strength);
    let coverage: Coverage = used.clone().map(|reading| correction.apply(reading)).collect();
    let used = used.count();
    must_cover(&coverage)?;
    if residual > LARGEST_RESIDUAL * strength {
        return Err(format!(
            "the magnetometer's readings lie {:.1} % off any ellipsoid, {:.0} % may be: iron or \
             currents move beside it",
            residual / strength * 100.0,
            LARGEST_RESIDUAL * 100.0
        ));
    }
    let axes = correction.matrix.symmetric_eigenvalues();
    let ratio = axes.max() / axes.min();
    if ratio > LARGEST_RATIO {
        return Err(format!(
            "the field is {ratio:.1} times stronger one way than another, {LARGEST_RATIO} may be: \
             take iron away from the sensor"
        ));
    }
    if !EARTH_UT.contains(&strength) {
        let (least, most) = (EARTH_UT.start(), EARTH_UT.end());
        return Err(format!(
            "a field of {strength:.0} uT is not the earth's ({least:.0} to {most:.0} uT): move away \
             from magnets"
        ));
    }
    Ok(Ellipsoid {
        correction,
        strength,
        residual,
        used,
        outliers: readings.len() - used,
        coverage,
    })
}

/// Refuses directions that are too little of the sphere.
fn must_cover(coverage: &Coverage) -> Result<(), String> {
    let share = coverage.share();
    if share >= LEAST_COVERAGE {
        return Ok(());
    }
    Err(format!(
        "the magnetometer has seen {:.0} % of all directions, {:.0} % are needed: turn it slowly \
         about every axis, upside down too",
        share * 100.0,
        LEAST_COVERAGE * 100.0
    ))
}

/// Rotates the correction so that the angle between gravity and field is the same in every pose,
/// which matters where the soft iron is not symmetric. `pairs` are directions up (the corrected
/// accelerometer) and corrected fields. Gives the correction, the dip in rad, and the root mean
/// square deviation of the dip in rad; `None` where the pairs do not determine the rotation.
pub fn align<'a>(
    correction: &Correction,
    pairs: impl Iterator<Item = &'a (Vector3<f64>, Vector3<f64>)> + Clone,
) -> Option<(Correction, f64, f64)> {
    let mut rotation = Rotation3::identity();
    let mut sine = pairs.clone().map(|pair| dip_sine(&rotation, pair)).sum::<f64>()
        / pairs.clone().count().max(1) as f64;
    for _ in 0..ROUNDS {
        // (t x f) . up = t . (f x up): the change of each pair's sine with a small turn t.
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for pair in pairs.clone() {
            let field = rotation * pair.1.normalize();
            let turn = field.cross(&-pair.0.normalize());
            let row = Vector4::new(turn.x, turn.y, turn.z, -1.0);
            normal += row * row.transpose();
            right -= row * (dip_sine(&rotation, pair) - sine);
        }
        let step = normal.lu().solve(&right)?;
        rotation = Rotation3::new(step.fixed_rows::<3>(0).into_owned()) * rotation;
        sine += step.w;
    }
    let count = pairs.clone().count() as f64;
    let squares: f64 =
        pairs.map(|pair| dip_sine(&rotation, pair) - sine).map(|off| off * off).sum();
    let dip = libm::asin(sine.clamp(-1.0, 1.0));
    let deviation = libm::sqrt(squares / count) / libm::cos(dip).max(0.1);
    let turned =
        Correction { offset: correction.offset, matrix: rotation.matrix() * correction.matrix };
    // Soft iron makes a small rotation only: a large one means that the equations have no solution.
    (deviation.is_finite() && rotation.angle() < 0.5).then_some((turned, dip, deviation))
}

/// Sine of the dip that a pair shows: up times field, downwards.
fn dip_sine(rotation: &Rotation3<f64>, (up, field): &(Vector3<f64>, Vector3<f64>)) -> f64 {
    -up.normalize().dot(&(rotation * field.normalize()))
}

/// The ellipsoid through the readings that are `wanted`: its correction and its mean radius.
fn sphere(
    readings: &[Vector3<f64>],
    wanted: impl Fn(&Vector3<f64>) -> bool,
) -> Option<(Correction, f64)> {
    // About their middle, and in units of their size, so that the equations are of the same size.
    let wanted = readings.iter().filter(|m| wanted(m));
    let (middle, size) = extent(wanted.clone());
    let (mut normal, mut right) = (Matrix9::zeros(), Vector9::zeros());
    for reading in wanted {
        let m = (reading - middle) / size;
        let row = Vector9::from([
            m.x * m.x,
            m.y * m.y,
            m.z * m.z,
            2.0 * m.y * m.z,
            2.0 * m.x * m.z,
            2.0 * m.x * m.y,
            2.0 * m.x,
            2.0 * m.y,
            2.0 * m.z,
        ]);
        normal += row * row.transpose();
        right += row;
    }
    let p = normal.cholesky()?.solve(&right);
    let &[xx, yy, zz, yz, xz, xy, x, y, z] = p.data.0.first()?;
    let quadric = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let linear = Vector3::new(x, y, z);
    let centre = -quadric.lu().solve(&linear)?;
    let k = 1.0 + centre.dot(&(quadric * centre));
    let eigen = (quadric / k).symmetric_eigen();
    if !(eigen.eigenvalues.min() > 0.0 && eigen.eigenvalues.max().is_finite()) {
        return None;
    }
    let roots = Matrix3::from_diagonal(&eigen.eigenvalues.map(libm::sqrt));
    // Maps the ellipsoid onto the unit sphere; scaled so that it keeps volumes, and so the mean
    // strength.
    let root = eigen.eigenvectors * roots * eigen.eigenvectors.transpose();
    let radius = 1.0 / libm::cbrt(root.determinant());
    let correction = Correction { offset: middle + centre * size, matrix: root * radius };
    Some((correction, radius * size))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HARD: Vector3<f64> = Vector3::new(40.0, -40.0, 30.0);

    fn soft(skew: f64) -> Matrix3<f64> {
        Matrix3::new(1.1, 0.1, -0.05, 0.1 - skew, 0.9, 0.08, -0.05, 0.08 + skew, 1.05)
    }

    /// Attitudes all round, and what a sensor with these errors reads of gravity and field.
    fn turned(skew: f64) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let (sin, cos) = 70.0_f64.to_radians().sin_cos();
        let field = Vector3::new(cos, 0.0, sin) * 50.0;
        (0..1000)
            .map(|i| {
                let i = f64::from(i);
                let r = Rotation3::from_euler_angles(i * 0.37, i * 0.113, i * 0.021);
                let up = r * Vector3::new(0.0, 0.0, -1.0);
                (up, soft(skew) * (r * field) + HARD)
            })
            .collect()
    }

    fn readings(turned: &[(Vector3<f64>, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        turned.iter().map(|(_, m)| *m).collect()
    }

    #[test]
    fn a_symmetric_soft_iron_is_found_exactly() {
        let ellipsoid = fit(&readings(&turned(0.0))).unwrap();
        assert!((ellipsoid.correction.offset - HARD).norm() < 1e-6);
        let through = ellipsoid.correction.matrix * soft(0.0);
        let scale = libm::cbrt(soft(0.0).determinant());
        assert!((through / scale - Matrix3::identity()).norm() < 1e-6);
        assert!((ellipsoid.strength - 50.0 * scale).abs() < 1e-6);
        assert!(ellipsoid.residual < 1e-6 && ellipsoid.outliers == 0);
    }

    #[test]
    fn gravity_finds_the_rotation_of_one_that_is_not() {
        let turned = turned(0.2);
        let ellipsoid = fit(&readings(&turned)).unwrap();
        let pairs: Vec<_> =
            turned.iter().map(|(up, m)| (*up, ellipsoid.correction.apply(m))).collect();
        let (correction, dip, deviation) = align(&ellipsoid.correction, pairs.iter()).unwrap();
        assert!((dip.to_degrees() - 70.0).abs() < 1e-4, "{}", dip.to_degrees());
        assert!(deviation < 1e-6);
        let through = correction.matrix * soft(0.2);
        let scale = libm::cbrt(soft(0.2).determinant());
        assert!((through / scale - Matrix3::identity()).norm() < 1e-5, "{through}");
    }

    #[test]
    fn single_wrong_readings_do_not_count() {
        let mut readings = readings(&turned(0.0));
        readings[100] += Vector3::new(100.0, 0.0, 0.0);
        readings[600] = -readings[600] * 2.0;
        let ellipsoid = fit(&readings).unwrap();
        assert_eq!(ellipsoid.outliers, 2);
        assert!((ellipsoid.correction.offset - HARD).norm() < 1e-6);
    }

    #[test]
    fn poor_readings_are_refused_with_the_reason() {
        let why = |readings: &[Vector3<f64>]| fit(readings).unwrap_err();
        let all = readings(&turned(0.0));
        assert!(why(&all[..100]).contains("too few"));
        let ring: Vec<_> = (0..400)
            .map(|i| f64::from(i) * 0.05)
            .map(|a| Vector3::new(17.0 * a.cos(), 17.0 * a.sin(), 47.0))
            .collect();
        assert!(why(&ring).contains("of all directions"), "{}", why(&ring));
        let half: Vec<_> = all.iter().filter(|m| m.z > 40.0).copied().collect();
        assert!(why(&half).contains("of all directions"), "{}", why(&half));
        let far: Vec<_> = all.iter().map(|m| m * 10.0).collect();
        assert!(why(&far).contains("not the earth's"), "{}", why(&far));
        let shaken: Vec<_> = (0..)
            .zip(&all)
            .map(|(i, m)| {
                m + Vector3::new([12.0, -12.0, 0.0][i % 3], [0.0, 11.0, -11.0][i % 3], 0.0)
            })
            .collect();
        assert!(why(&shaken).contains("off any ellipsoid"), "{}", why(&shaken));
        let long: Vec<_> =
            all.iter().map(|m| (m - HARD).component_mul(&Vector3::new(4.0, 1.0, 1.0))).collect();
        assert!(why(&long).contains("stronger one way"), "{}", why(&long));
    }
}
