//! Inertia and loads of the closed chain as functions of the crank angle.
//!
//! The linkage leaves two degrees of freedom, the pitch `th0` and the crank `th1`. With `p_i(th1)`
//! the centres of mass in the frame of body 0, `p_i'` their derivatives and `G = (0, 1, G2, G3)`,
//!
//! ```text
//! M00 = sum m |p|^2 + I      M01 = sum m (J p).p' + I G      M11 = sum m |p'|^2 + I G^2
//! ```
//!
//! do not depend on `th0`, and the momentum `p0 = M00 w0 + M01 v1` obeys `dp0/dt = Q0`.

use crate::linkage::{Linkage, LinkageState, Planar, turned};
use crate::parameters::{Checked, Parameters};

/// The four bodies and their linkage: valid parameters, ready to be evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct Mechanism {
    parameters: Parameters,
    linkage: Linkage,
}

/// The mechanism at one crank angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Configuration {
    /// The linkage's directions, ratios and curvatures.
    pub linkage: LinkageState,
    /// Inertia about the pivot, in kg m2.
    pub m00: f64,
    /// Coupling of crank and pitch, in kg m2.
    pub m01: f64,
    /// Inertia that the crank feels, in kg m2.
    pub m11: f64,
    /// `d M00 / d th1`, in kg m2/rad.
    pub m00_slope: f64,
    /// `d M01 / d th1`, in kg m2/rad.
    pub m01_slope: f64,
    /// `d M11 / d th1`, in kg m2/rad.
    pub m11_slope: f64,
    /// First moment of mass about the pivot, `P = sum m p`, in kg m, body frame.
    pub first_moment: [f64; 2],
    /// `dP / d th1`, in kg m/rad.
    pub first_moment_slope: [f64; 2],
    /// Second moments of the moving bodies' mass about the pivot, `xx`, `xy` and `yy`, in kg m2:
    /// the trace is their part of `m00`. A body's own mass lies along its length, as a rod's.
    pub second_moments: [f64; 3],
    /// Pitch moment of wash and thrust about the pivot, in N m.
    pub thrust_moment: f64,
    /// Torque of the wash on the crank, in N m.
    pub wash_torque: f64,
}

impl Configuration {
    /// Inertia that the crank feels while the drone is free to turn the other way, in kg m2.
    pub fn crank_inertia(&self) -> f64 {
        self.m11 - self.m01 * self.m01 / self.m00
    }
}

impl Mechanism {
    /// Checks the parameters and builds the mechanism.
    ///
    /// # Errors
    /// As [`Parameters::validate`].
    pub fn new(parameters: &Parameters) -> Checked<Self> {
        parameters.validate()?;
        Ok(Self { parameters: *parameters, linkage: parameters.linkage() })
    }

    /// The same mechanism under another thrust (N), which is not checked.
    pub fn with_thrust(&self, thrust_n: f64) -> Self {
        Self { parameters: Parameters { thrust_n, ..self.parameters }, ..self.clone() }
    }

    /// The parameters.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The linkage.
    pub fn linkage(&self) -> &Linkage {
        &self.linkage
    }

    /// Everything that depends on the crank angle (rad) alone.
    pub fn configuration(&self, crank_rad: f64) -> Configuration {
        let p = &self.parameters;
        let linkage = self.linkage.at(crank_rad);
        let (g2, g3) = (linkage.link_ratio, linkage.rudder_ratio);
        let (h2, h3) = (linkage.link_curvature, linkage.rudder_curvature);
        let [u1, u2, u3] = [linkage.crank, linkage.link, linkage.arm];
        let (servo, rudder) = (Planar::from(p.servo_axis_m()), Planar::from(p.rudder_axis_m));
        let half = p.link_length_m / 2.0;

        // Of each moving body: p, p' and p''.
        let crank_end = p.crank_length_m * u1;
        let crank = [servo + p.crank_cm_m * u1, p.crank_cm_m * turned(u1), -p.crank_cm_m * u1];
        let link = [
            servo + crank_end + half * u2,
            turned(crank_end) + half * g2 * turned(u2),
            -crank_end + half * (h2 * turned(u2) - g2 * g2 * u2),
        ];
        let fin = [
            rudder + p.rudder_cm_m * u3,
            p.rudder_cm_m * g3 * turned(u3),
            p.rudder_cm_m * (h3 * turned(u3) - g3 * g3 * u3),
        ];
        // Mass, inertia, ratio, curvature, motion, direction.
        let bodies = [
            (p.crank_mass_kg, p.crank_inertia_kg_m2, 1.0, 0.0, crank, u1),
            (p.link_mass_kg, p.link_inertia_kg_m2, g2, h2, link, u2),
            (p.rudder_mass_kg, p.rudder_inertia_kg_m2, g3, h3, fin, u3),
        ];

        let body_cm = Planar::from(p.body_cm_m);
        let mut m00 = p.body_mass_kg * body_cm.norm_squared() + p.body_inertia_kg_m2;
        let (mut m01, mut m11) = (0.0, 0.0);
        let (mut m00_slope, mut m01_slope, mut m11_slope) = (0.0, 0.0, 0.0);
        let mut first_moment = p.body_mass_kg * body_cm;
        let mut first_moment_slope = Planar::zeros();
        let mut second_moments = [0.0; 3];
        for (mass, inertia, ratio, curvature, [at, slope, bend], along) in bodies {
            for (k, (i, j)) in [(0, 0), (0, 1), (1, 1)].into_iter().enumerate() {
                second_moments[k] += mass * at[i] * at[j] + inertia * along[i] * along[j];
            }
            m00 += mass * at.norm_squared() + inertia;
            m01 += mass * turned(at).dot(&slope) + inertia * ratio;
            m11 += mass * slope.norm_squared() + inertia * ratio * ratio;
            m00_slope += 2.0 * mass * at.dot(&slope);
            // (J p').p' vanishes, so only the second derivative remains.
            m01_slope += mass * turned(at).dot(&bend) + inertia * curvature;
            m11_slope += 2.0 * (mass * slope.dot(&bend) + inertia * ratio * curvature);
            first_moment += mass * at;
            first_moment_slope += mass * slope;
        }

        let (force, arm) = wash(p, u3);
        let thrust = Planar::new(0.0, p.thrust_n);
        Configuration {
            linkage,
            m00,
            m01,
            m11,
            m00_slope,
            m01_slope,
            m11_slope,
            first_moment: first_moment.into(),
            first_moment_slope: first_moment_slope.into(),
            second_moments,
            thrust_moment: (rudder + arm).perp(&force)
                + Planar::from(p.thrust_point_m).perp(&thrust),
            wash_torque: arm.perp(&force) * g3,
        }
    }

    /// Generalised load on the pitch, `Q0`, in N m: wash, thrust, gravity and pivot friction, at
    /// pitch `pitch_rad` and pitch rate `rate_rad_s`.
    pub fn pitch_load(&self, at: &Configuration, pitch_rad: f64, rate_rad_s: f64) -> f64 {
        let p = &self.parameters;
        let (sin, cos) = pitch_rad.sin_cos();
        let [x, y] = at.first_moment;
        at.thrust_moment
            - p.gravity_m_s2 * (cos * x - sin * y)
            - p.pivot_friction_n_m_s * rate_rad_s
    }

    /// Load on the crank without friction and servo torque, in N m: wash and gravity through the
    /// linkage. Positive turns the crank counter-clockwise.
    pub fn hinge_torque(&self, at: &Configuration, pitch_rad: f64) -> f64 {
        let (sin, cos) = pitch_rad.sin_cos();
        let [x, y] = at.first_moment_slope;
        at.wash_torque - self.parameters.gravity_m_s2 * (sin * x + cos * y)
    }

    /// Generalised load on the crank, `Q1`, in N m, without the servo's torque: hinge torque and
    /// the friction of servo shaft and rudder axis, at the crank rate `crank_rate_rad_s`.
    pub fn crank_load(&self, at: &Configuration, pitch_rad: f64, crank_rate_rad_s: f64) -> f64 {
        let p = &self.parameters;
        let g3 = at.linkage.rudder_ratio;
        self.hinge_torque(at, pitch_rad)
            - (p.crank_friction_n_m_s + p.rudder_friction_n_m_s * g3 * g3) * crank_rate_rad_s
    }
}

/// Force of the wash on the rudder and the lever from the rudder axis to where it acts.
///
/// The rudder is a plate in the wash: the force stands on it and grows with the sine of its angle.
fn wash(p: &Parameters, arm: Planar) -> (Planar, Planar) {
    let (sin, cos) = (-arm.x, arm.y);
    let normal = p.wash_efficiency * p.thrust_n * sin;
    (-normal * Planar::new(cos, sin), -p.pressure_centre_m * arm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn phys_at_zero_rudder_has_the_reference_inertia() {
        let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
        let at = mechanism.configuration(mechanism.linkage().zero_rudder_crank_rad());
        assert!((at.m00 - 0.12699).abs() < 5e-6);
        assert!((at.m01 - 1.224e-3).abs() < 5e-7);
        assert!((at.m11 - 6.85e-4).abs() < 5e-7);
        // Pitch acceleration for each radian of crank: 31.6 1/s2.
        let tilted = mechanism.configuration(at.linkage.crank_rad + 1e-6);
        let gain = (tilted.thrust_moment - at.thrust_moment) / 1e-6 / at.m00;
        assert!((gain + 31.6).abs() < 0.05, "{gain}");
    }

    /// Plate force by hand: N = 30 sin 0.3 at 0.045 m below the axis.
    #[test]
    fn wash_weathervanes_the_rudder_and_turns_the_drone_back() {
        let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
        let crank = mechanism.linkage().crank_for_rudder(0.3).unwrap();
        let at = mechanism.configuration(crank);
        let normal = 30.0 * 0.3_f64.sin();
        let moment = -normal * (0.195 * 0.3_f64.cos() + 0.045);
        assert!((at.thrust_moment - moment).abs() < 1e-12);
        let torque = -0.045 * normal * at.linkage.rudder_ratio;
        assert!((at.wash_torque - torque).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn slopes_match_differences(crank in -3.0..3.0_f64, offset in -0.02..0.02_f64) {
            let p = Parameters { crank_cm_m: offset, rudder_cm_m: 0.5 * offset, ..Parameters::PHYS };
            let mechanism = Mechanism::new(&p).unwrap();
            let at = mechanism.configuration(crank);
            let h = 1e-5;
            let (before, after) =
                (mechanism.configuration(crank - h), mechanism.configuration(crank + h));
            let slope = |f: fn(&Configuration) -> f64| (f(&after) - f(&before)) / (2.0 * h);
            prop_assert!((slope(|c| c.m00) - at.m00_slope).abs() < 1e-9);
            prop_assert!((slope(|c| c.m01) - at.m01_slope).abs() < 1e-9);
            prop_assert!((slope(|c| c.m11) - at.m11_slope).abs() < 1e-9);
            prop_assert!((slope(|c| c.first_moment[0]) - at.first_moment_slope[0]).abs() < 1e-9);
            prop_assert!((slope(|c| c.first_moment[1]) - at.first_moment_slope[1]).abs() < 1e-9);
        }
    }
}
