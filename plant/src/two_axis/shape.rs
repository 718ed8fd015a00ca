//! What of the drone depends on its cranks: inertia, first moment of mass, and the momentum of
//! linkages that turn in the body.
//!
//! A linkage lies in a plane through the pivot that contains the thrust axis, and each of its
//! bodies is taken to be as thin as a rod along its length. It has no inertia about that length,
//! and the same about either axis across it.

use nalgebra::{Matrix3, Vector3};

use crate::mechanism::{Configuration, Mechanism};
use crate::parameters::Parameters;

/// Inertia about the pivot and first moment of mass of a part of the drone, body axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    /// In kg m2.
    pub(super) inertia: Matrix3<f64>,
    /// In kg m.
    pub(super) first_moment: Vector3<f64>,
}

/// The whole drone at two crank angles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub(super) linkages: [Configuration; 2],
    /// About the pivot, in kg m2.
    pub(super) inertia: Matrix3<f64>,
    pub(super) inverse: Matrix3<f64>,
    /// Of all mass, in kg m.
    pub(super) first_moment: Vector3<f64>,
}

impl Shape {
    /// At crank angles in rad.
    pub(super) fn at(mechanism: &Mechanism, body: &Body, cranks_rad: [f64; 2]) -> Self {
        let linkages = cranks_rad.map(|crank| mechanism.configuration(crank));
        let moving = moving(mechanism.parameters(), &linkages);
        let inertia = body.inertia + moving.inertia;
        Self {
            linkages,
            inertia,
            // The inertia of bodies with mass in three directions has an inverse.
            inverse: inertia.try_inverse().unwrap_or_else(Matrix3::zeros),
            first_moment: body.first_moment + moving.first_moment,
        }
    }

    /// Momentum of the linkages that turn in the body at these speeds, rad/s; kg m2/s.
    fn relative(&self, [pitch, roll]: [f64; 2]) -> Vector3<f64> {
        let [first, second] = &self.linkages;
        Vector3::new(second.m01 * roll, first.m01 * pitch, 0.0)
    }

    /// Momentum of the whole drone at these speeds of the cranks and rates of the body, rad/s.
    pub(super) fn momentum(&self, speeds: [f64; 2], rates: &Vector3<f64>) -> Vector3<f64> {
        self.inertia * rates + self.relative(speeds)
    }

    /// Rates of the body that give it this momentum, rad/s.
    pub(super) fn rates(&self, speeds: [f64; 2], momentum: &Vector3<f64>) -> Vector3<f64> {
        self.inverse * (momentum - self.relative(speeds))
    }
}

/// Inertia and first moment of what moves of both linkages, body axes.
pub(super) fn moving(p: &Parameters, linkages: &[Configuration; 2]) -> Body {
    let [body_x, body_y] = p.body_cm_m.map(|at| p.body_mass_kg * at);
    let [[x, y], [l, u]] = linkages.map(|at| {
        let [x, y] = at.first_moment;
        [x - body_x, y - body_y]
    });
    Body {
        inertia: inertia_of(&linkages.map(|at| at.second_moments)),
        first_moment: Vector3::new(x, -l, -y - u),
    }
}

/// Inertia of both linkages from the second moments in their planes.
fn inertia_of(&[[xx, xy, yy], [ll, lu, uu]]: &[[f64; 3]; 2]) -> Matrix3<f64> {
    // Second moments about the body's axes: forward is x, left is -y, and up is -z.
    let second = Matrix3::new(xx, 0.0, -xy, 0.0, ll, lu, -xy, lu, yy + uu);
    Matrix3::identity() * second.trace() - second
}
