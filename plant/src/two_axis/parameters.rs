//! The figures of the drone with two rudders, and what they say about its body.

use nalgebra::{Matrix3, Vector3};

use super::shape::{self, Body};
use crate::mechanism::Mechanism;
use crate::parameters::{Checked, ParameterError, Parameters, finite, named, positive};

/// The figures of the drone with two rudders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoAxisParameters {
    /// The one-axis drone: linkages, loads, balance and inertia in pitch, and in roll alike.
    pub one_axis: Parameters,
    /// Distance of the total centre of mass from the thrust axis to the right, in m. The whole has
    /// the mass of the one-axis drone: body 0 is lighter by the second linkage.
    pub lateral_cm_m: f64,
    /// Inertia about the thrust axis at zero rudders, in kg m2; an estimate.
    pub axial_inertia_kg_m2: f64,
    /// Momentum of propellers that do not cancel, about the body's z, in kg m2/s.
    pub rotor_momentum_kg_m2_s: f64,
}

impl TwoAxisParameters {
    /// The recommended one-axis drone with a second rudder.
    pub const PHYS: Self = Self::of(Parameters::PHYS);

    /// With the linkages and loads of a one-axis drone, whose pivot's friction counts in pitch and
    /// roll.
    pub const fn of(one_axis: Parameters) -> Self {
        Self { one_axis, lateral_cm_m: 0.0, axial_inertia_kg_m2: 0.03, rotor_momentum_kg_m2_s: 0.0 }
    }

    /// The mechanism of either axis, and the body without its linkages, both checked.
    pub(super) fn checked(&self) -> Checked<(Mechanism, Body)> {
        positive(&named!(self; axial_inertia_kg_m2))?;
        finite(&named!(self; lateral_cm_m, rotor_momentum_kg_m2_s))?;
        let mechanism = Mechanism::new(&self.one_axis)?;
        let zero = mechanism.configuration(mechanism.linkage().zero_rudder_crank_rad());
        let linkages = shape::moving(&self.one_axis, &[zero, zero]);
        let [ahead, up] = zero.first_moment;
        let aside = self.one_axis.total_mass_kg() * self.lateral_cm_m;
        let whole = Vector3::new(zero.m00, zero.m00, self.axial_inertia_kg_m2);
        let body = Body {
            // The whole has its principal axes along the body's at zero rudders.
            inertia: Matrix3::from_diagonal(&whole) - linkages.inertia,
            first_moment: Vector3::new(ahead, aside, -up) - linkages.first_moment,
        };
        // No mass in any direction may be negative.
        if body.inertia.cholesky().is_none() {
            return Err(ParameterError::OutOfRange {
                parameter: "axial_inertia_kg_m2",
                value: self.axial_inertia_kg_m2,
                must: "more than that of the linkages",
            });
        }
        Ok((mechanism, body))
    }
}
