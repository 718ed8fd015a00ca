//! Newton and Euler's equations of the four bodies, all reactions included.
//!
//! Fourteen unknowns: the forces at the pivot D and the joints O, A, B, C, and the accelerations
//! of the four coordinates. Eight rows are Newton's law of each body, four Euler's about each
//! centre of mass, two the linkage's closing twice differentiated. Everything is resolved in the
//! frame of body 0; gravity turns with the pitch.
//!
//! Written independently of the reduced form in `plant::mechanism` and `plant::free`, which it is
//! compared with.

use nalgebra::{SMatrix, SVector, Vector2};
use plant::Mechanism;
use plant::free::State;

/// A vector in the plane, in the frame of body 0.
type Planar = Vector2<f64>;

const UNKNOWNS: usize = 14;
/// Columns of the unknowns.
const D: usize = 0;
const O: usize = 2;
const A: usize = 4;
const B: usize = 6;
const C: usize = 8;
const ACC: usize = 10;

type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;

/// Forces in the joints and accelerations.
///
/// Forces are in N, in the frame of body 0. `pivot` acts on body 0; `servo` on the crank at O;
/// `crank_end` on the crank at A (from the link); `link_end` on the link at B (from the rudder
/// arm); `rudder_axis` on the rudder at C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dynamics {
    /// Force of the pivot on body 0.
    pub(crate) pivot: [f64; 2],
    /// Force of body 0 on the crank at the servo axis.
    pub(crate) servo: [f64; 2],
    /// Force of the link on the crank.
    pub(crate) crank_end: [f64; 2],
    /// Force of the rudder arm on the link.
    pub(crate) link_end: [f64; 2],
    /// Force of body 0 on the rudder at its axis.
    pub(crate) rudder_axis: [f64; 2],
    /// Accelerations of `theta0..3`, in rad/s2.
    pub(crate) accelerations_rad_s2: [f64; 4],
}

/// `J v`: the vector turned by +90 deg.
fn turned(v: Planar) -> Planar {
    Planar::new(-v.y, v.x)
}

/// All reactions and accelerations under a servo torque (N m).
///
/// `None` if the system has no unique solution: a linkage stretched out at a dead point of
/// its own, which valid parameters do not reach.
pub(crate) fn dynamics(mechanism: &Mechanism, state: &State, torque_n_m: f64) -> Option<Dynamics> {
    let (matrix, right) = equations(mechanism, state, torque_n_m);
    let x = solve_scaled(matrix, right)?;
    let force = |at: usize| [x[at], x[at + 1]];
    Some(Dynamics {
        pivot: force(D),
        servo: force(O),
        crank_end: force(A),
        link_end: force(B),
        rudder_axis: force(C),
        accelerations_rad_s2: std::array::from_fn(|i| x[ACC + i]),
    })
}

/// The 14 equations as matrix and right-hand side.
fn equations(mechanism: &Mechanism, state: &State, torque_n_m: f64) -> (Matrix, Vector) {
    let p = mechanism.parameters();
    let at = mechanism.linkage().at(state.crank_rad);
    let (w0, v1) = (state.pitch_rate_rad_s, state.crank_rate_rad_s);
    let (v2, v3) = (at.link_ratio * v1, at.rudder_ratio * v1);
    let [w1, w2, w3] = [v1, v2, v3].map(|v| (w0 + v) * (w0 + v));
    let w00 = w0 * w0;

    let turn = |angle: f64, x: f64, y: f64| nalgebra::Rotation2::new(angle) * Planar::new(x, y);
    let u1 = turn(at.crank_rad, 0.0, 1.0);
    let u2 = turn(at.link_rad(), -1.0, 0.0);
    let u3 = turn(at.rudder_rad(), 0.0, 1.0);
    let (r_o, r_c) = (Planar::from(p.servo_axis_m()), Planar::from(p.rudder_axis_m));
    let (r0, thrust_at) = (Planar::from(p.body_cm_m), Planar::from(p.thrust_point_m));
    let (q1, q3) = (p.crank_cm_m * u1, p.rudder_cm_m * u3);
    let (a1, a2) = (p.crank_length_m * u1, 0.5 * p.link_length_m * u2);
    let arm = p.arm_length_m * u3;
    let [m0, m1, m2, m3] = [p.body_mass_kg, p.crank_mass_kg, p.link_mass_kg, p.rudder_mass_kg];
    let (sin, cos) = state.pitch_rad.sin_cos();
    let gravity = -p.gravity_m_s2 * Planar::new(sin, cos);
    let thrust = Planar::new(0.0, p.thrust_n);
    let (sin, cos) = at.rudder_rad().sin_cos();
    let normal = p.wash_efficiency * p.thrust_n * sin;
    let wash_force = -normal * Planar::new(cos, sin);
    let wash_at = -p.pressure_centre_m * u3;

    let mut system = System::default();
    // Newton: sum of forces minus mass times acceleration of the centre of mass.
    system.force(0, D, 1.0);
    system.force(0, O, -1.0);
    system.force(0, C, -1.0);
    system.inertia(0, m0, [(0, r0)]);
    system.load(0, -m0 * (w00 * r0 + gravity) - thrust);

    system.force(2, O, 1.0);
    system.force(2, A, 1.0);
    system.inertia(2, m1, [(0, r_o + q1), (1, q1)]);
    system.load(2, -m1 * (w00 * r_o + w1 * q1 + gravity));

    system.force(4, A, -1.0);
    system.force(4, B, 1.0);
    system.inertia(4, m2, [(0, r_o + a1 + a2), (1, a1), (2, a2)]);
    system.load(4, -m2 * (w00 * r_o + w1 * a1 + w2 * a2 + gravity));

    system.force(6, B, -1.0);
    system.force(6, C, 1.0);
    system.inertia(6, m3, [(0, r_c + q3), (3, q3)]);
    system.load(6, -m3 * (w00 * r_c + w3 * q3 + gravity) - wash_force);

    // Euler: moments about each centre of mass.
    let (b0, b1, b3) =
        (p.pivot_friction_n_m_s * w0, p.crank_friction_n_m_s * v1, p.rudder_friction_n_m_s * v3);
    system.moment(8, D, -r0);
    system.moment(8, O, -(r_o - r0));
    system.moment(8, C, -(r_c - r0));
    system.spin(8, p.body_inertia_kg_m2, None);
    system.right[8] = torque_n_m - (thrust_at - r0).perp(&thrust) + b0 - b1 - b3;

    system.moment(9, O, -q1);
    system.moment(9, A, a1 - q1);
    system.spin(9, p.crank_inertia_kg_m2, Some(1));
    system.right[9] = -torque_n_m + b1;

    system.moment(10, A, a2);
    system.moment(10, B, a2);
    system.spin(10, p.link_inertia_kg_m2, Some(2));

    system.moment(11, B, -(arm - q3));
    system.moment(11, C, -q3);
    system.spin(11, p.rudder_inertia_kg_m2, Some(3));
    system.right[11] = -(wash_at - q3).perp(&wash_force) + b3;

    // The loop stays closed: minus the derivative of each bar's end, bar by bar.
    let link = p.link_length_m * u2;
    for (column, bar) in [(1, a1), (2, link), (3, -arm)] {
        let turned = turned(bar);
        system.matrix[(12, ACC + column)] = turned.x;
        system.matrix[(13, ACC + column)] = turned.y;
    }
    let centripetal = v1 * v1 * a1 + v2 * v2 * link - v3 * v3 * arm;
    system.right[12] = centripetal.x;
    system.right[13] = centripetal.y;
    (system.matrix, system.right)
}

/// The equations under construction.
#[derive(Default)]
struct System {
    matrix: Matrix,
    right: Vector,
}

impl System {
    /// A joint's force in two Newton rows.
    fn force(&mut self, row: usize, joint: usize, sign: f64) {
        self.matrix[(row, joint)] = sign;
        self.matrix[(row + 1, joint + 1)] = sign;
    }

    /// Minus mass times the acceleration that each coordinate gives through its lever.
    fn inertia<const N: usize>(&mut self, row: usize, mass: f64, levers: [(usize, Planar); N]) {
        for (coordinate, lever) in levers {
            let acceleration = mass * turned(lever);
            self.matrix[(row, ACC + coordinate)] -= acceleration.x;
            self.matrix[(row + 1, ACC + coordinate)] -= acceleration.y;
        }
    }

    /// Known terms of two Newton rows.
    fn load(&mut self, row: usize, value: Planar) {
        self.right[row] = value.x;
        self.right[row + 1] = value.y;
    }

    /// Moment `lever x joint force` in an Euler row.
    fn moment(&mut self, row: usize, joint: usize, lever: Planar) {
        self.matrix[(row, joint)] = -lever.y;
        self.matrix[(row, joint + 1)] = lever.x;
    }

    /// Minus inertia times angular acceleration: pitch, and the body's own coordinate.
    fn spin(&mut self, row: usize, inertia: f64, own: Option<usize>) {
        self.matrix[(row, ACC)] = -inertia;
        if let Some(coordinate) = own {
            self.matrix[(row, ACC + coordinate)] = -inertia;
        }
    }
}

/// Solves after dividing each row by its largest entry: entries span 1 to 1e-7.
fn solve_scaled(mut matrix: Matrix, mut right: Vector) -> Option<Vector> {
    for row in 0..UNKNOWNS {
        let scale = 1.0 / matrix.row(row).amax();
        matrix.row_mut(row).scale_mut(scale);
        right[row] *= scale;
    }
    matrix.full_piv_lu().solve(&right)
}
