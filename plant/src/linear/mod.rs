//! Linear analysis: the plant at a point, its poles and zeros, and the margins of the whole loop.
//!
//! | module | what |
//! |---|---|
//! | here | state space at any point, equilibria, controllability, observability |
//! | [`transfer`] | transfer functions: poles, zeros, products, root locus |
//! | [`frequency`] | the pitch loop with its delays: Bode, Nyquist, margins |

pub mod frequency;
pub mod transfer;

use std::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, Matrix4, RowVector4, Schur, Vector4};

use crate::free::State;
use crate::mechanism::Mechanism;
use crate::root;
use transfer::TransferFunction;

/// Moment of the weight below which a drone counts as balanced about its pivot, in N m: the
/// link's own weight shifts that much as the crank turns.
const BALANCED_N_M: f64 = 1e-3;
/// Relative size below which a singular value counts as zero in a rank.
const RANK_TOLERANCE: f64 = 1e-12;

/// A linear model `x' = A x + B u`, `y = C x` with `x = (th0, w0, th1, v1)` measured from the
/// point it was taken at, `u` the servo's torque in N m, `y = th0`.
#[derive(Clone, Debug, PartialEq)]
pub struct StateSpace {
    /// System matrix.
    pub a: Matrix4<f64>,
    /// Input column.
    pub b: Vector4<f64>,
    /// Output row.
    pub c: RowVector4<f64>,
}

/// A point at which the drone can rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equilibrium {
    /// Pitch and crank at rest.
    pub state: State,
    /// Torque of the servo that holds the crank there, in N m.
    pub torque_n_m: f64,
}

impl Equilibrium {
    fn at(mechanism: &Mechanism, pitch_rad: f64, crank_rad: f64) -> Self {
        let at = mechanism.configuration(crank_rad);
        Self {
            state: State { pitch_rad, crank_rad, ..State::default() },
            torque_n_m: -mechanism.crank_load(&at, pitch_rad, 0.0),
        }
    }
}

/// Rank of a test matrix and what it was decided on.
#[derive(Clone, Debug, PartialEq)]
pub struct Rank {
    /// The rank; 4 is full.
    pub rank: usize,
    /// Singular values of the scaled matrix, largest first.
    pub singular_values: Vec<f64>,
}

/// The equilibrium at a pitch (rad): the crank angle whose wash balances gravity, between the
/// rudder's dead points.
///
/// `None` if the rudder is too weak to hold the drone there.
pub fn equilibrium(mechanism: &Mechanism, pitch_rad: f64) -> Option<Equilibrium> {
    let ((low, _), (high, _)) = mechanism.linkage().dead_points()?;
    let load = |crank: f64| mechanism.pitch_load(&mechanism.configuration(crank), pitch_rad, 0.0);
    // The moment falls as the rudder turns from one dead point to the other.
    let crank_rad = root::between(load, low, high, 1e-15)?;
    Some(Equilibrium::at(mechanism, pitch_rad, crank_rad))
}

/// The equilibrium at a crank angle (rad): the pitch at which the drone's weight balances the
/// wash, the nearest to upright.
///
/// `None` if the weight cannot: it is balanced about the pivot, to 1 mN m, or too light.
pub fn equilibrium_at_crank(mechanism: &Mechanism, crank_rad: f64) -> Option<Equilibrium> {
    let at = mechanism.configuration(crank_rad);
    let [x, y] = at.first_moment;
    // thrust_moment = g (cos th0 x - sin th0 y) = g |P| cos(th0 + phase)
    let weight = mechanism.parameters().gravity_m_s2 * x.hypot(y);
    if weight < BALANCED_N_M || at.thrust_moment.abs() > weight {
        return None;
    }
    let opening = (at.thrust_moment / weight).acos();
    let pitch_rad = [opening, -opening]
        .map(|angle| angle - y.atan2(x))
        .map(|angle| angle - (angle / TAU).round() * TAU)
        .into_iter()
        .min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
    Some(Equilibrium::at(mechanism, pitch_rad, crank_rad))
}

/// The linear model at a point, which need not be an equilibrium.
///
/// Derivatives are fourth-order central differences, good to about ten digits.
pub fn linearise(mechanism: &Mechanism, point: &State, torque_n_m: f64) -> StateSpace {
    let slope = |f: &dyn Fn(f64) -> [f64; 2]| {
        const H: f64 = 1e-3;
        let (m2, m1, p1, p2) = (f(-2.0 * H), f(-H), f(H), f(2.0 * H));
        [0, 1].map(|i| (m2[i] - 8.0 * m1[i] + 8.0 * p1[i] - p2[i]) / (12.0 * H))
    };
    // Order of `State`'s array: th0, th1, w0, v1; of the linear model: th0, w0, th1, v1.
    let columns = [0, 2, 1, 3].map(|index| {
        slope(&|h| {
            let mut x = point.to_array();
            x[index] += h;
            mechanism.accelerations(&State::from_array(x), torque_n_m)
        })
    });
    let input = slope(&|h| mechanism.accelerations(point, torque_n_m + h));
    let mut a = Matrix4::zeros();
    a[(0, 1)] = 1.0;
    a[(2, 3)] = 1.0;
    for (column, [pitch, crank]) in columns.into_iter().enumerate() {
        a[(1, column)] = pitch;
        a[(3, column)] = crank;
    }
    StateSpace {
        a,
        b: Vector4::new(0.0, input[0], 0.0, input[1]),
        c: RowVector4::new(1.0, 0.0, 0.0, 0.0),
    }
}

impl StateSpace {
    /// Eigenvalues of A, in rad/s, ordered by real and imaginary part.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        sorted(eigenvalues(self.dynamic()))
    }

    /// A as a matrix of any size.
    fn dynamic(&self) -> DMatrix<f64> {
        DMatrix::from_column_slice(4, 4, self.a.as_slice())
    }

    /// Zeros from input to output, in rad/s.
    pub fn zeros(&self) -> Vec<Complex<f64>> {
        self.transfer_function().zeros()
    }

    /// Transfer function from input to output, by Leverrier's recursion for the adjugate.
    pub fn transfer_function(&self) -> TransferFunction {
        let mut adjugate = Matrix4::identity();
        let mut denominator = vec![1.0];
        let mut numerator = Vec::new();
        for k in 1..=4 {
            numerator.push((self.c * adjugate * self.b)[0]);
            let product = self.a * adjugate;
            let coefficient = -product.trace() / f64::from(k);
            denominator.push(coefficient);
            adjugate = product + Matrix4::identity() * coefficient;
        }
        TransferFunction::new(numerator, denominator)
    }

    /// Rank of the controllability matrix `[B, AB, A2B, A3B]`.
    pub fn controllability(&self) -> Rank {
        let time = self.time_scale();
        let mut column = self.b;
        let columns = std::array::from_fn::<_, 4, _>(|_| {
            let scaled = column;
            column = self.a * column * time;
            scaled
        });
        rank(Matrix4::from_columns(&columns))
    }

    /// Rank of the observability matrix `[C; CA; CA2; CA3]`.
    pub fn observability(&self) -> Rank {
        let time = self.time_scale();
        let mut row = self.c;
        let rows = std::array::from_fn::<_, 4, _>(|_| {
            let scaled = row;
            row = row * self.a * time;
            scaled
        });
        rank(Matrix4::from_rows(&rows))
    }

    /// A time (s) of the size of the fastest motion. Counting time in it does not change a rank,
    /// and keeps powers of A from drowning the slow part in rounding.
    fn time_scale(&self) -> f64 {
        let fastest =
            eigenvalues(self.dynamic()).iter().map(|pole| pole.norm()).fold(0.0, f64::max);
        if fastest > 0.0 { 1.0 / fastest } else { 1.0 }
    }
}

/// Eigenvalues of a square matrix by the QR iteration.
///
/// At full precision the iteration may not end, so that it has a limit, and past it a tolerance ten
/// times as wide. The eigenvalues of a matrix that is not finite are not numbers.
pub(crate) fn eigenvalues(matrix: DMatrix<f64>) -> Vec<Complex<f64>> {
    const ITERATIONS: usize = 500;
    let unknown = vec![Complex::new(f64::NAN, f64::NAN); matrix.nrows()];
    if matrix.iter().any(|x| !x.is_finite()) {
        return unknown;
    }
    (0..8)
        .map(|power| f64::EPSILON * 10.0_f64.powi(power))
        .find_map(|tolerance| Schur::try_new(matrix.clone(), tolerance, ITERATIONS))
        .map_or(unknown, |schur| schur.complex_eigenvalues().iter().copied().collect())
}

/// Orders complex numbers by real part, then imaginary part.
pub(crate) fn sorted(mut values: Vec<Complex<f64>>) -> Vec<Complex<f64>> {
    values.sort_by(|x, y| x.re.total_cmp(&y.re).then(x.im.total_cmp(&y.im)));
    values
}

/// Rank of a matrix, rows and columns scaled to their largest entry first.
fn rank(mut matrix: Matrix4<f64>) -> Rank {
    for i in 0..4 {
        let scale = matrix.row(i).amax();
        if scale > 0.0 {
            matrix.row_mut(i).scale_mut(1.0 / scale);
        }
    }
    for i in 0..4 {
        let scale = matrix.column(i).amax();
        if scale > 0.0 {
            matrix.column_mut(i).scale_mut(1.0 / scale);
        }
    }
    let mut singular_values: Vec<f64> = matrix.singular_values().iter().copied().collect();
    singular_values.sort_by(|x, y| y.total_cmp(x));
    let floor = RANK_TOLERANCE * singular_values[0];
    Rank { rank: singular_values.iter().filter(|s| **s > floor).count(), singular_values }
}
