//! The four-bar linkage from the servo's crank to the rudder.
//!
//! With `u1 = R(theta1)(0, 1)`, `u2 = R(theta2)(-1, 0)`, `u3 = R(theta3)(0, 1)` and the servo axis
//! a distance `Lg` to the right of the rudder axis, the loop closes when
//!
//! ```text
//! Phi = [ Lg - L1 sin th1 - L2 cos th2 + L3 sin th3 ]
//!       [      L1 cos th1 - L2 sin th2 - L3 cos th3 ] = 0
//! ```
//!
//! With the drone's lengths the crank is the shortest bar and `L1 + L2 < L3 + Lg`: a crank-rocker
//! (Grashof), whose crank turns fully and whose rudder swings between two dead points.

use nalgebra::Vector2;

/// The linkage's four lengths, which are not checked here:
/// [`Parameters::validate`](crate::Parameters::validate) does that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linkage {
    /// Of the servo's crank, `L1`, in m.
    pub crank_m: f64,
    /// Of the link between crank and rudder arm, `L2`, in m.
    pub link_m: f64,
    /// Of the rudder's arm, `L3`, in m.
    pub arm_m: f64,
    /// From the rudder's axis to the servo's, `Lg`, in m.
    pub ground_m: f64,
}

/// A vector in the plane, in the frame of body 0.
pub(crate) type Planar = Vector2<f64>;

/// `J v`: the vector turned by +90 deg.
pub(crate) fn turned(v: Planar) -> Planar {
    Planar::new(-v.y, v.x)
}

/// The linkage at one crank angle.
///
/// Velocities follow from the ratios, `v3 = rudder_ratio * v1`; accelerations from ratios and
/// curvatures, `a3 = rudder_ratio * a1 + rudder_curvature * v1^2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkageState {
    /// Crank angle `theta1`, in rad.
    pub crank_rad: f64,
    /// Unit vector `u1` from the servo's axis to the crank's end, in the frame of body 0.
    pub crank: Vector2<f64>,
    /// Unit vector `u2` from the crank's end to the arm's.
    pub link: Vector2<f64>,
    /// Unit vector `u3` from the rudder's axis to the arm's end.
    pub arm: Vector2<f64>,
    /// `G2 = d theta2 / d theta1`.
    pub link_ratio: f64,
    /// `G3 = d theta3 / d theta1`.
    pub rudder_ratio: f64,
    /// `H2 = d2 theta2 / d theta1^2`, in 1/rad.
    pub link_curvature: f64,
    /// `H3 = d2 theta3 / d theta1^2`, in 1/rad.
    pub rudder_curvature: f64,
}

impl LinkageState {
    /// Link angle `theta2`, in rad.
    pub fn link_rad(&self) -> f64 {
        (-self.link.y).atan2(-self.link.x)
    }

    /// Rudder angle `theta3`, in rad.
    pub fn rudder_rad(&self) -> f64 {
        (-self.arm.x).atan2(self.arm.y)
    }

    /// Sine of the transmission angle, the one between link and rudder arm: 1 when they stand
    /// square, 0 when they lie in line and the crank can go no further.
    pub fn transmission(&self) -> f64 {
        self.link.perp(&self.arm).abs()
    }
}

impl Linkage {
    /// Whether link and arm can meet at this crank angle (rad).
    pub fn closes_at(&self, crank_rad: f64) -> bool {
        let (sin, cos) = crank_rad.sin_cos();
        let span = (self.ground_m - self.crank_m * sin).hypot(self.crank_m * cos);
        span < self.link_m + self.arm_m && span > (self.link_m - self.arm_m).abs()
    }

    /// Directions, ratios and curvatures at a crank angle (rad), in closed form. Not numbers where
    /// the linkage does not close.
    pub fn at(&self, crank_rad: f64) -> LinkageState {
        let (l1, l2, l3) = (self.crank_m, self.link_m, self.arm_m);
        let (sin, cos) = crank_rad.sin_cos();
        let crank = Planar::new(-sin, cos);
        // The triangle of rudder axis, crank's end and arm's end has known sides: the law of
        // cosines gives the arm's share along the side to the crank's end, and across it.
        let crank_end = Planar::new(self.ground_m, 0.0) + l1 * crank;
        let inverse = 1.0 / crank_end.norm_squared();
        let along = (1.0 + (l3 * l3 - l2 * l2) * inverse) / (2.0 * l3);
        let across = (inverse - along * along).sqrt();
        let arm = along * crank_end + across * turned(crank_end);
        let link = (l3 * arm - crank_end) / l2;

        // L1 u1 + L2 u2 - L3 u3 does not change: its first and its second derivative vanish.
        let determinant = l2 * l3 * link.perp(&arm);
        let (to_link, to_rudder) = (l3 / determinant, l2 / determinant);
        let link_ratio = -l1 * crank.perp(&arm) * to_link;
        let rudder_ratio = -l1 * crank.perp(&link) * to_rudder;
        let bent = l1 * crank + l2 * link_ratio * link_ratio * link
            - l3 * rudder_ratio * rudder_ratio * arm;
        LinkageState {
            crank_rad,
            crank,
            link,
            arm,
            link_ratio,
            rudder_ratio,
            link_curvature: bent.dot(&arm) * to_link,
            rudder_curvature: bent.dot(&link) * to_rudder,
        }
    }

    /// The crank angle for a rudder angle (rad), on the branch where both turn the same way.
    /// `None` beyond the dead points.
    pub fn crank_for_rudder(&self, rudder_rad: f64) -> Option<f64> {
        let (sin, cos) = rudder_rad.sin_cos();
        // B as seen from the servo axis, x mirrored; the crank's end must lie link_m from it.
        let (x, y) = (self.ground_m + self.arm_m * sin, self.arm_m * cos);
        let reach = x.hypot(y);
        let sine = (self.crank_m * self.crank_m + reach * reach - self.link_m * self.link_m)
            / (2.0 * self.crank_m * reach);
        (sine.abs() <= 1.0).then(|| sine.asin() - y.atan2(x))
    }

    /// The crank angle `th1z` at which the rudder is at zero, in rad; not a number for a linkage
    /// that [`Parameters::validate`](crate::Parameters::validate) refuses.
    pub fn zero_rudder_crank_rad(&self) -> f64 {
        self.crank_for_rudder(0.0).unwrap_or(f64::NAN)
    }

    /// The dead points of the rudder as `((crank, rudder), (crank, rudder))`, lowest rudder angle
    /// first, in rad: there crank and link lie in line and the rudder turns back.
    ///
    /// `None` when the crank cannot turn fully (the linkage is no crank-rocker).
    pub fn dead_points(&self) -> Option<((f64, f64), (f64, f64))> {
        let at_reach = |reach: f64| {
            let (l3, lg) = (self.arm_m, self.ground_m);
            let sine = (reach * reach - lg * lg - l3 * l3) / (2.0 * lg * l3);
            (sine.abs() <= 1.0).then(|| sine.asin())
        };
        let low = at_reach(self.link_m - self.crank_m)?;
        let high = at_reach(self.link_m + self.crank_m)?;
        // At a dead point the arcsine of the inverse stands at -90 or +90 deg.
        let quarter = std::f64::consts::FRAC_PI_2;
        let arm = |rudder: f64| {
            (self.arm_m * rudder.cos()).atan2(self.ground_m + self.arm_m * rudder.sin())
        };
        Some(((-quarter - arm(low), low), (quarter - arm(high), high)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Parameters;
    use proptest::prelude::*;

    fn linkage() -> Linkage {
        Parameters::PHYS.linkage()
    }

    /// How far the loop is from closing, `Phi`, in m, for the angles of crank, link and rudder.
    fn residual(linkage: &Linkage, angles: [f64; 3]) -> [f64; 2] {
        let [(s1, c1), (s2, c2), (s3, c3)] = angles.map(f64::sin_cos);
        [
            linkage.ground_m - linkage.crank_m * s1 - linkage.link_m * c2 + linkage.arm_m * s3,
            linkage.crank_m * c1 - linkage.link_m * s2 - linkage.arm_m * c3,
        ]
    }

    /// Reference: crank, link and rudder angle in deg and G3.
    #[test]
    fn angles_and_ratio_match_the_table() {
        for (crank, link, rudder, ratio) in [
            (-65.0, -15.96, -32.25, 0.379),
            (-60.0, -15.29, -30.28, 0.409),
            (-45.0, -13.63, -23.57, 0.482),
            (-30.0, -12.48, -15.95, 0.531),
            (0.0, -11.54, 0.61, 0.557),
            (30.0, -12.44, 16.33, 0.468),
            (45.0, -13.81, 22.59, 0.358),
            (60.0, -16.08, 26.73, 0.182),
            (65.0, -17.08, 27.46, 0.107),
        ] {
            let state = linkage().at(f64::to_radians(crank));
            assert!((state.link_rad().to_degrees() - link).abs() < 0.0051);
            assert!((state.rudder_rad().to_degrees() - rudder).abs() < 0.0051);
            assert!((state.rudder_ratio - ratio).abs() < 0.0006);
        }
    }

    #[test]
    fn zero_rudder_and_dead_points() {
        let zero = linkage().zero_rudder_crank_rad();
        assert!((zero + 0.0191473).abs() < 5e-8, "{zero}");
        assert!(linkage().at(zero).rudder_rad().abs() < 1e-15);
        let ((crank, rudder), (crank2, rudder2)) = linkage().dead_points().unwrap();
        assert!((crank.to_degrees() + 116.34).abs() < 0.005);
        assert!((rudder.to_degrees() + 42.30).abs() < 0.005);
        assert!((crank2.to_degrees() - 71.43).abs() < 0.005);
        assert!((rudder2.to_degrees() - 27.81).abs() < 0.005);
        assert!(linkage().at(crank2).rudder_ratio.abs() < 1e-9);
        // At a dead point crank and link lie in line; link and arm still stand apart.
        assert!(linkage().at(crank2).transmission() > 0.6);
        assert_eq!(linkage().crank_for_rudder(rudder2 + 1e-6), None);
    }

    /// The reference polynomial fits the rudder angle to 2.4e-4 rad over the servo's travel.
    #[test]
    fn polynomial_fit_holds() {
        let coefficients =
            [0.01060403, 0.55690931, -0.02232675, -0.06715217, -0.01420137, -0.00681357];
        let mut worst = 0.0_f64;
        for i in -65..=65 {
            let x = f64::to_radians(f64::from(i));
            let fit = coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c);
            worst = worst.max((fit - linkage().at(x).rudder_rad()).abs());
        }
        assert!((2.0e-4..2.5e-4).contains(&worst), "{worst}");
    }

    proptest! {
        /// The crank turns fully: the loop closes everywhere, and the ratios and curvatures are
        /// the derivatives that they claim to be.
        #[test]
        fn derivatives_match_differences(crank in -3.2..3.2_f64) {
            let linkage = linkage();
            let state = linkage.at(crank);
            let residual = residual(&linkage, [crank, state.link_rad(), state.rudder_rad()]);
            prop_assert!(residual[0].abs().max(residual[1].abs()) < 1e-15);
            let h = 1e-5;
            let (before, after) = (linkage.at(crank - h), linkage.at(crank + h));
            let slope = |f: fn(&LinkageState) -> f64| (f(&after) - f(&before)) / (2.0 * h);
            prop_assert!((slope(|s| s.link_rad()) - state.link_ratio).abs() < 1e-8);
            prop_assert!((slope(|s| s.rudder_rad()) - state.rudder_ratio).abs() < 1e-8);
            prop_assert!((slope(|s| s.link_ratio) - state.link_curvature).abs() < 1e-8);
            prop_assert!((slope(|s| s.rudder_ratio) - state.rudder_curvature).abs() < 1e-8);
        }

        #[test]
        fn the_inverse_is_one(crank in -1.1..1.1_f64) {
            let linkage = linkage();
            let back = linkage.crank_for_rudder(linkage.at(crank).rudder_rad()).unwrap();
            prop_assert!((back - crank).abs() < 1e-13);
        }
    }
}
