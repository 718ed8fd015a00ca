//! Errors of an estimated attitude against an optical reference, by the definition of BROAD
//! (Laidig et al. 2021).
//!
//! With `e = q_est * conj(q_ref)`, the error in the earth's frame (z up):
//!
//! ```text
//! total       = 2 acos |e_w|
//! heading     = 2 atan |e_z / e_w|
//! inclination = 2 acos sqrt(e_w^2 + e_z^2)
//! ```
//!
//! Each is given as the root of its mean square over the samples of the movement that have a
//! reference. Nothing is aligned.

use tvc_fusion::Quaternion;

/// Root mean square errors over a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Whole rotation, deg.
    pub total_deg: f64,
    /// About the vertical, deg.
    pub heading_deg: f64,
    /// Of the vertical, deg.
    pub inclination_deg: f64,
    /// Samples that count.
    pub samples: usize,
}

/// Collects errors.
#[derive(Clone, Debug, Default)]
pub struct Scorer {
    squares: [f64; 3],
    samples: usize,
}

impl Scorer {
    /// Takes an estimate (body to north-east-down) and its reference (body to east-north-up).
    pub fn add(&mut self, estimate_ned: [f64; 4], reference_enu: [f64; 4]) {
        let [w, x, y, z] = unit(enu_from_ned(estimate_ned));
        let estimate = Quaternion { w, x, y, z };
        let [w, x, y, z] = unit(reference_enu);
        let Quaternion { w, z, .. } = estimate.mul(&Quaternion { w, x: -x, y: -y, z: -z });
        let total = 2.0 * w.abs().min(1.0).acos();
        let heading = 2.0 * (z / w).abs().atan();
        let inclination = 2.0 * w.hypot(z).min(1.0).acos();
        for (square, error) in self.squares.iter_mut().zip([total, heading, inclination]) {
            *square += error * error;
        }
        self.samples += 1;
    }

    /// The score; `None` without samples.
    pub fn score(&self) -> Option<Score> {
        if self.samples == 0 {
            return None;
        }
        let rms = |i: usize| (self.squares[i] / self.samples as f64).sqrt().to_degrees();
        Some(Score {
            total_deg: rms(0),
            heading_deg: rms(1),
            inclination_deg: rms(2),
            samples: self.samples,
        })
    }
}

/// The same attitude with its earth axes turned from north-east-down to east-north-up: half a turn
/// about the horizontal between north and east. `[w, x, y, z]`, body to earth.
pub fn enu_from_ned([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [-x - y, w + z, w - z, y - x].map(|c| c * std::f64::consts::FRAC_1_SQRT_2)
}

/// The same direction with the length one.
pub(crate) fn unit(q: [f64; 4]) -> [f64; 4] {
    let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    q.map(|c| c / norm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Quaternion, UnitQuaternion, Vector3};

    fn parts(q: UnitQuaternion<f64>) -> [f64; 4] {
        [q.w, q.i, q.j, q.k]
    }

    /// Errors put in on purpose, by an independent library, come out.
    #[test]
    fn known_errors_come_out() {
        let to_enu = UnitQuaternion::from_quaternion(Quaternion::new(0.0, 1.0, 1.0, 0.0));
        let reference = UnitQuaternion::from_euler_angles(0.3, -0.5, 1.1);
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.10);
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.05);
        let mut scorer = Scorer::default();
        let estimate = to_enu.inverse() * heading * tilt * reference;
        scorer.add(parts(estimate), parts(reference));
        let score = scorer.score().unwrap();
        assert!((score.heading_deg - 0.10_f64.to_degrees()).abs() < 1e-9);
        assert!((score.inclination_deg - 0.05_f64.to_degrees()).abs() < 1e-9);
        let total = (heading * tilt).angle().to_degrees();
        assert!((score.total_deg - total).abs() < 1e-9);
    }

    #[test]
    fn errors_are_root_mean_squares() {
        let mut scorer = Scorer::default();
        let level = [0.0, 1.0, 1.0, 0.0];
        for degrees in [3.0_f64, 4.0] {
            let half = 0.5 * degrees.to_radians();
            let reference = [half.cos(), 0.0, 0.0, half.sin()];
            scorer.add(level, reference);
        }
        let score = scorer.score().unwrap();
        assert!((score.heading_deg - 12.5_f64.sqrt()).abs() < 1e-9);
        assert!(score.inclination_deg < 1e-6);
        assert_eq!(score.samples, 2);
        assert_eq!(Scorer::default().score(), None);
    }
}
