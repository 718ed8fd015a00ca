//! The drone with two rudders against Newton's law for mass points in the earth's axes.
//!
//! Nothing of the model's inertia, momentum or slopes is used here: each rod is two mass points,
//! and body 0 is the six points that make the whole what the parameters say. All move along a path
//! with the rates and accelerations that the model claims; their accelerations are differences of
//! their places. The sum of `r x m a` must be the moment of the forces, each put where it acts.

use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

use super::super::*;
use crate::Parameters;

/// Time between the places of a difference, s.
const APART_S: f64 = 5e-4;

/// A mass (kg) and its place (m).
type Point = (f64, Vector3<f64>);

/// A vector of a linkage's plane in the body's axes.
fn body(axis: usize, v: Vector2<f64>) -> Vector3<f64> {
    [Vector3::new(v.x, 0.0, -v.y), Vector3::new(0.0, -v.x, -v.y)][axis]
}

fn turned(angle: f64, x: f64, y: f64) -> Vector2<f64> {
    nalgebra::Rotation2::new(angle) * Vector2::new(x, y)
}

/// Crank, link and rudder of a linkage as two points each, body axes.
fn linkage(p: &Parameters, axis: usize, crank_rad: f64) -> Vec<Point> {
    let at = p.linkage().at(crank_rad);
    let [u1, u2, u3] = [
        turned(crank_rad, 0.0, 1.0),
        turned(at.link_rad(), -1.0, 0.0),
        turned(at.rudder_rad(), 0.0, 1.0),
    ];
    let pin = Vector2::from(p.rudder_axis_m);
    let servo = pin + Vector2::new(p.ground_length_m, 0.0);
    let joint = servo + p.crank_length_m * u1;
    let rods = [
        (p.crank_mass_kg, p.crank_inertia_kg_m2, servo + p.crank_cm_m * u1, u1),
        (p.link_mass_kg, p.link_inertia_kg_m2, joint + 0.5 * p.link_length_m * u2, u2),
        (p.rudder_mass_kg, p.rudder_inertia_kg_m2, pin + p.rudder_cm_m * u3, u3),
    ];
    rods.into_iter()
        .flat_map(|(mass, inertia, at, along)| {
            let reach = (inertia / mass).sqrt();
            [-reach, reach].map(|reach| (0.5 * mass, body(axis, at + reach * along)))
        })
        .collect()
}

/// Second moments about the pivot, kg m2.
fn second_moments(points: &[Point]) -> Matrix3<f64> {
    points.iter().map(|(mass, at)| *mass * at * at.transpose()).sum()
}

fn first_moment(points: &[Point]) -> Vector3<f64> {
    points.iter().map(|(mass, at)| *mass * at).sum()
}

/// Body 0, from what the whole is at zero rudders.
fn body_points(parameters: &TwoAxisParameters) -> Vec<Point> {
    let p = &parameters.one_axis;
    let zero = p.linkage().zero_rudder_crank_rad();
    let first = linkage(p, 0, zero);
    let both = [first.clone(), linkage(p, 1, zero)].concat();
    // The one-axis drone: its inertia is the trace of its second moments in the plane.
    let own = Vector2::from(p.body_cm_m);
    let pitch_inertia =
        second_moments(&first).trace() + p.body_inertia_kg_m2 + p.body_mass_kg * own.norm_squared();
    let balance = first_moment(&first) + p.body_mass_kg * body(0, own);
    let whole_mass = p.total_mass_kg();
    let half = 0.5 * parameters.axial_inertia_kg_m2;
    let second = Matrix3::from_diagonal(&Vector3::new(half, half, pitch_inertia - half))
        - second_moments(&both);
    let first = balance + Vector3::new(0.0, whole_mass * parameters.lateral_cm_m, 0.0)
        - first_moment(&both);
    let mass = whole_mass - both.iter().map(|(mass, _)| mass).sum::<f64>();
    let centre = first / mass;
    let about = (second - mass * centre * centre.transpose()).symmetric_eigen();
    (0..3)
        .flat_map(|k| {
            assert!(about.eigenvalues[k] > 0.0, "{}", about.eigenvalues);
            let reach = (3.0 * about.eigenvalues[k] / mass).sqrt();
            let along: Vector3<f64> = about.eigenvectors.column(k).into_owned();
            [-reach, reach].map(|reach| (mass / 6.0, centre + reach * along))
        })
        .collect()
}

/// Rates, accelerations and cranks at an instant.
struct Motion {
    attitude: UnitQuaternion<f64>,
    rates: Vector3<f64>,
    accelerations: Vector3<f64>,
    cranks: [Crank; 2],
    crank_acc_rad_s2: [f64; 2],
}

impl Motion {
    fn attitude_at(&self, time_s: f64) -> UnitQuaternion<f64> {
        let turn = self.rates * time_s + self.accelerations * (0.5 * time_s * time_s);
        self.attitude * UnitQuaternion::from_scaled_axis(turn)
    }

    /// All points in earth axes.
    fn points(&self, parameters: &TwoAxisParameters, body: &[Point], time_s: f64) -> Vec<Point> {
        let attitude = self.attitude_at(time_s);
        let linkages = [0, 1].map(|axis| {
            let Crank { angle_rad, rate_rad_s } = self.cranks[axis];
            let bend = 0.5 * self.crank_acc_rad_s2[axis] * time_s * time_s;
            linkage(&parameters.one_axis, axis, angle_rad + rate_rad_s * time_s + bend)
        });
        body.iter()
            .chain(linkages.iter().flatten())
            .map(|(mass, at)| (*mass, attitude * at))
            .collect()
    }

    /// `sum r x m a` about the pivot, and the slope of the rotors' momentum, earth axes, N m.
    fn inertial_moment(&self, parameters: &TwoAxisParameters) -> Vector3<f64> {
        let body = body_points(parameters);
        let [before2, before, now, after, after2] =
            [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| self.points(parameters, &body, k * APART_S));
        let mut sum = Vector3::zeros();
        for (k, (mass, at)) in now.iter().enumerate() {
            let near = 16.0 * (before[k].1 + after[k].1) - 30.0 * at;
            let bend = (near - before2[k].1 - after2[k].1) / (12.0 * APART_S * APART_S);
            sum += *mass * at.cross(&bend);
        }
        let rotors = |k: f64| {
            let momentum = Vector3::new(0.0, 0.0, parameters.rotor_momentum_kg_m2_s);
            self.attitude_at(k * APART_S) * momentum
        };
        let near = 8.0 * (rotors(1.0) - rotors(-1.0));
        sum + (near - rotors(2.0) + rotors(-2.0)) / (12.0 * APART_S)
    }

    /// Moment of all forces about the pivot, body axes, N m.
    fn moment(&self, parameters: &TwoAxisParameters) -> Vector3<f64> {
        let p = &parameters.one_axis;
        let weight: Vector3<f64> = self
            .points(parameters, &body_points(parameters), 0.0)
            .into_iter()
            .map(|(mass, at)| at.cross(&Vector3::new(0.0, 0.0, mass * p.gravity_m_s2)))
            .sum();
        let mut moment = self.attitude.inverse() * weight;
        for axis in [0, 1] {
            let rudder_rad = p.linkage().at(self.cranks[axis].angle_rad).rudder_rad();
            let plate = turned(rudder_rad, 1.0, 0.0) * -p.wash_efficiency * p.thrust_n;
            let below = turned(rudder_rad, 0.0, -p.pressure_centre_m);
            let at = body(axis, Vector2::from(p.rudder_axis_m) + below);
            moment += at.cross(&body(axis, plate * rudder_rad.sin()));
            let at = body(axis, Vector2::from(p.thrust_point_m));
            moment += at.cross(&Vector3::new(0.0, 0.0, -p.thrust_n));
        }
        let friction = p.pivot_friction_n_m_s;
        moment - Vector3::new(friction, friction, 0.0).component_mul(&self.rates)
    }
}

fn vector(reach: f64) -> impl Strategy<Value = Vector3<f64>> {
    proptest::array::uniform3(-reach..reach).prop_map(Vector3::from)
}

fn figures() -> impl Strategy<Value = TwoAxisParameters> {
    let small = proptest::array::uniform5(-0.01..0.01_f64);
    (small, 0.0..0.05_f64, -0.05..0.05_f64, 0.02..0.05_f64).prop_map(
        |([aside, crank, rudder, thrust, ahead], friction, rotor, axial)| TwoAxisParameters {
            one_axis: Parameters {
                crank_mass_kg: 0.02,
                link_mass_kg: 0.01,
                link_inertia_kg_m2: 5e-6,
                crank_cm_m: crank,
                rudder_cm_m: rudder,
                thrust_point_m: [thrust, 0.09],
                body_cm_m: [ahead, 0.02],
                pivot_friction_n_m_s: friction,
                ..Parameters::PHYS
            },
            lateral_cm_m: aside,
            axial_inertia_kg_m2: axial,
            rotor_momentum_kg_m2_s: rotor,
        },
    )
}

proptest! {
    #[test]
    fn the_accelerations_are_those_of_points_under_the_forces(
        parameters in figures(), attitude in vector(1.8), rates in vector(4.0),
        angle in proptest::array::uniform2(-1.1..1.1_f64),
        rate in proptest::array::uniform2(-5.0..5.0_f64),
        crank_acc_rad_s2 in proptest::array::uniform2(-200.0..200.0_f64),
    ) {
        let attitude = UnitQuaternion::from_scaled_axis(attitude);
        let mut drone = TwoAxisDrone::new(&parameters, attitude, [0.0; 3]).unwrap();
        drone.place_cranks(angle);
        drone.cranks = [0, 1].map(|axis| Crank::new(angle[axis], rate[axis]));
        drone.set_rates(rates.into());
        prop_assert!((Vector3::from(drone.rates_rad_s()) - rates).norm() < 1e-12);
        let motion = Motion {
            attitude,
            rates,
            accelerations: drone.acceleration_rad_s2(crank_acc_rad_s2).into(),
            cranks: drone.cranks,
            crank_acc_rad_s2,
        };
        let inertial = attitude.inverse() * motion.inertial_moment(&parameters);
        let missing = inertial - motion.moment(&parameters);
        prop_assert!(missing.norm() < 2e-7, "{missing}");
    }

    /// The steps follow the accelerations: a mean over a short step, either side of it.
    #[test]
    fn steps_follow_the_accelerations(
        parameters in figures(), attitude in vector(1.0), rates in vector(2.0),
        angle in proptest::array::uniform2(-0.8..0.8_f64),
        rate in proptest::array::uniform2(-5.0..5.0_f64),
    ) {
        const SHORT_S: f64 = 1e-5;
        let attitude = UnitQuaternion::from_scaled_axis(attitude);
        let mut drone = TwoAxisDrone::new(&parameters, attitude, [0.0; 3])
            .unwrap()
            .with_tether_stop(f64::INFINITY);
        drone.place_cranks(angle);
        drone.cranks = [0, 1].map(|axis| Crank::new(angle[axis], rate[axis]));
        drone.set_rates(rates.into());
        let (before, slope) = (Vector3::from(drone.rates_rad_s()), drone.acceleration_rad_s2([0.0; 2]));
        let end = drone.cranks.map(|crank| {
            Crank::new(crank.angle_rad + crank.rate_rad_s * SHORT_S, crank.rate_rad_s)
        });
        drone.step(SHORT_S, end);
        let mean = (Vector3::from(slope) + Vector3::from(drone.acceleration_rad_s2([0.0; 2]))) / 2.0;
        let found = (Vector3::from(drone.rates_rad_s()) - before) / SHORT_S;
        prop_assert!((found - mean).norm() < 1e-6 * (1.0 + mean.norm()), "{found} {mean}");
    }
}
