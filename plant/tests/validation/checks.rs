//! The checks: numbers and the ranges that they must lie in.

use plant::scenario::Row;
use plant::{Linkage, Parameters};

use super::newton_euler;
use super::runs::{Instant, Runs};

/// A number that must lie in a range, and the thesis' figure that it belongs to, if any.
pub(crate) struct Check {
    figure: Option<&'static str>,
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
}

impl Check {
    /// Whether it holds; NaN does not.
    pub(crate) fn holds(&self) -> bool {
        (self.low..=self.high).contains(&self.value)
    }

    /// As a row of the table in `docs/explanation/model.md`. Errors of rounding differ from machine
    /// to machine and have no value there.
    pub(crate) fn row(&self) -> String {
        let (low, high) = (self.low, self.high);
        let figure = self.figure.unwrap_or_default();
        let value = match low {
            0.0 => String::new(),
            _ => format!("{:.5}", self.value),
        };
        let middle = 0.5 * (low + high);
        let required = match (low, high) {
            (0.0, 0.0) => "0".to_owned(),
            (0.0, _) => format!("at most {high:e}"),
            _ if high - low > 1.0 => format!("{low} to {high}"),
            _ => format!("{} ± {:.0e}", short(middle), 0.5 * (high - low)),
        };
        format!("| {figure} | {} | {value} | {required} |\n", self.name)
    }
}

/// A middle of a range without the digits that rounding adds.
fn short(value: f64) -> f64 {
    (value * 1e8).round() / 1e8
}

/// All checks.
#[derive(Default)]
struct Checks(Vec<Check>);

impl Checks {
    fn of<const N: usize>(&mut self, figure: Option<&'static str>, numbers: [Check; N]) {
        self.0.extend(numbers.map(|number| Check { figure, ..number }));
    }
}

fn number(name: &'static str, value: f64) -> Check {
    Check { figure: None, name, value, low: f64::NEG_INFINITY, high: f64::INFINITY }
}

impl Check {
    fn near(self, value: f64, tolerance: f64) -> Self {
        self.within(value - tolerance, value + tolerance)
    }

    fn within(self, low: f64, high: f64) -> Self {
        Self { low, high, ..self }
    }

    /// The limit of an error, which is not negative.
    fn at_most(self, high: f64) -> Self {
        self.within(0.0, high)
    }
}

/// Largest size of `of` over a motion.
fn largest<T>(rows: &[T], of: impl Fn(&T) -> f64) -> f64 {
    rows.iter().map(|row| of(row).abs()).fold(0.0, f64::max)
}

/// Largest of `of` over a motion.
fn top(rows: &[Row], of: fn(&Row) -> f64) -> f64 {
    rows.iter().map(of).fold(f64::NEG_INFINITY, f64::max)
}

/// Smallest of `of` over a motion.
fn bottom(rows: &[Row], of: fn(&Row) -> f64) -> f64 {
    rows.iter().map(of).fold(f64::INFINITY, f64::min)
}

fn end(rows: &[Row]) -> &Row {
    rows.last().unwrap()
}

/// All checks, in the order of the thesis' figures, then the balances.
pub(crate) fn all(runs: &Runs) -> Vec<Check> {
    let mut checks = Checks::default();
    linkage(&mut checks, runs);
    loads(&mut checks, runs);
    balances(&mut checks, runs);
    checks.0
}

/// How far the loop is from closing, in m, for the angles of crank, link and rudder.
fn residual(linkage: &Linkage, angles: [f64; 3]) -> [f64; 2] {
    let [(s1, c1), (s2, c2), (s3, c3)] = angles.map(f64::sin_cos);
    [
        linkage.ground_m - linkage.crank_m * s1 - linkage.link_m * c2 + linkage.arm_m * s3,
        linkage.crank_m * c1 - linkage.link_m * s2 - linkage.arm_m * c3,
    ]
}

/// Link and rudder angles by Newton-Raphson from a start `(theta2, theta3)`, as the thesis solves
/// the loop; from a neighbouring solution it needs four to six iterations.
fn newton_raphson(linkage: &Linkage, crank: f64, (mut link, mut rudder): (f64, f64)) -> (f64, f64) {
    for _ in 0..6 {
        let [x, y] = residual(linkage, [crank, link, rudder]);
        let ((s2, c2), (s3, c3)) = (link.sin_cos(), rudder.sin_cos());
        let determinant = (link - rudder).cos();
        let step = (
            (s3 * x - c3 * y) / linkage.link_m / determinant,
            (c2 * x + s2 * y) / linkage.arm_m / determinant,
        );
        link -= step.0;
        rudder -= step.1;
        if step.0.abs().max(step.1.abs()) < 1e-14 {
            return (link, rudder);
        }
    }
    panic!("no solution at a crank angle of {crank}");
}

fn linkage(checks: &mut Checks, runs: &Runs) {
    let linkage = Parameters::PHYS.linkage();
    let (low, high) = linkage.dead_points().unwrap();
    let open = |row: &Row| {
        let [x, y] = residual(&linkage, [row.theta1, row.theta2, row.theta3]);
        x.hypot(y)
    };
    let mut start = (-0.2014, 0.0106);
    let mut apart = 0.0_f64;
    for row in &runs.sweep {
        start = newton_raphson(&linkage, row.theta1, start);
        let difference = (start.0 - row.theta2).hypot(start.1 - row.theta3);
        apart = apart.max(difference);
    }
    let sweep = runs.sweep.as_slice();
    checks.of(
        Some("5.8"),
        [number("crank at its end, rad", top(sweep, |r| r.theta1)).near(0.8, 1e-9)],
    );
    checks.of(
        Some("5.9"),
        [
            number("link, most, rad", top(sweep, |r| r.theta2)).near(-0.20130, 5e-6),
            number("link, least, rad", bottom(sweep, |r| r.theta2)).near(-0.24277, 5e-6),
        ],
    );
    checks.of(
        Some("5.10"),
        [
            number("rudder at the start, rad", sweep[0].theta3).near(0.01067, 5e-6),
            number("rudder at its end, rad", top(sweep, |r| r.theta3)).near(0.39946, 5e-6),
        ],
    );
    checks.of(
        Some("5.8-5.10"),
        [
            number(
                "rudder's way back to where it began, rad",
                (end(sweep).theta3 - sweep[0].theta3).abs(),
            )
            .at_most(1e-12),
            number("gap of the closed loop, m", largest(sweep, open)).at_most(1e-15),
            number("closed form against Newton-Raphson, rad", apart).at_most(1e-14),
        ],
    );
    checks.of(
        None,
        [
            number("crank at zero rudder, rad", linkage.zero_rudder_crank_rad())
                .near(-0.0191473, 5e-8),
            number("upper dead point: crank, deg", high.0.to_degrees()).near(71.43, 5e-3),
            number("upper dead point: rudder, deg", high.1.to_degrees()).near(27.81, 5e-3),
            number("lower dead point: crank, deg", low.0.to_degrees()).near(-116.34, 5e-3),
            number("lower dead point: rudder, deg", low.1.to_degrees()).near(-42.30, 5e-3),
        ],
    );
}

fn loads(checks: &mut Checks, runs: &Runs) {
    let moved = |row: &Row| {
        let angles = (row.theta0 - 0.3).abs() + (row.theta1 - 0.1).abs();
        angles + row.w0.abs() + row.w1.abs()
    };
    let pitch = |r: &Row| r.theta0;
    checks.of(
        Some("5.11"),
        [number("motion without forces, rad", largest(&runs.still, moved)).at_most(0.0)],
    );
    checks.of(
        Some("5.12"),
        [
            number(
                "gravity, centre of mass at the pivot: pitch after 5 s from 0.1, rad",
                end(&runs.balanced).theta0,
            )
            .near(0.096, 1e-3),
            number(
                "gravity, body balanced at the pivot: far end of the swing from 0.2, rad",
                bottom(&runs.pendulum, pitch),
            )
            .near(-0.205, 2e-3),
            number(
                "gravity, centre of mass 2 cm above: it falls, reaching rad",
                largest(&runs.top_heavy, pitch),
            )
            .within(2.0, 100.0),
        ],
    );
    checks.of(
        Some("5.13"),
        [
            number("thrust and 0.1 N m: crank settles at rad", end(&runs.torque).theta1)
                .near(0.263, 2e-3),
            number("thrust and 0.1 N m: pitch after 2 s, rad", end(&runs.torque).theta0)
                .near(-16.29, 0.05),
            number(
                "thrust and 6 V against a stop at 0.8 rad: crank touches rad",
                top(&runs.stopped, |r| r.theta1),
            )
            .near(0.85, 0.005),
            number(
                "thrust and 6 V against a stop: rudder touches rad",
                top(&runs.stopped, |r| r.theta3),
            )
            .near(0.417, 0.002),
            number(
                "thrust and 6 V against a stop: pitch after 1 s, rad",
                end(&runs.stopped).theta0,
            )
            .near(-9.5, 0.1),
        ],
    );
}

fn balances(checks: &mut Checks, runs: &Runs) {
    let first = |instants: &[Instant]| *instants.first().unwrap();
    let (coasting, driven) = (first(&runs.coasting), first(&runs.driven));
    let energy = |instants: &[Instant], start: Instant| {
        let scale = largest(instants, |i| i.kinetic_j);
        largest(instants, |i| {
            i.kinetic_j + i.potential_j - start.kinetic_j - start.potential_j - i.work_j
        }) / scale
    };
    let momentum = |instants: &[Instant], start: Instant| {
        let scale = largest(instants, |i| i.momentum);
        largest(instants, |i| i.momentum - start.momentum - i.impulse) / scale
    };
    // The fourteen equations with all reactions, derived apart, at every instant of the tumble.
    let mut apart = 0.0_f64;
    for instant in &runs.driven {
        let torque = 0.05 * (5.0 * instant.time_s).sin();
        let full = newton_euler::dynamics(&runs.mechanism, &instant.state, torque)
            .unwrap()
            .accelerations_rad_s2;
        let reduced = runs.mechanism.accelerations(&instant.state, torque);
        let size = reduced[0].hypot(reduced[1]).max(1.0);
        apart = apart.max((full[0] - reduced[0]).hypot(full[1] - reduced[1]) / size);
    }
    checks.of(
        None,
        [
            number(
                "energy of a free tumble over 5 s, relative drift",
                energy(&runs.coasting, coasting),
            )
            .at_most(1e-9),
            number(
                "energy under wash, thrust, friction and servo against their work, relative",
                energy(&runs.driven, driven),
            )
            .at_most(1e-9),
            number(
                "momentum of a free tumble against gravity's impulse, relative",
                momentum(&runs.coasting, coasting),
            )
            .at_most(1e-9),
            number(
                "momentum under everything against the impulse of all moments, relative",
                momentum(&runs.driven, driven),
            )
            .at_most(1e-9),
            number("14 Newton-Euler equations against the reduced form, relative", apart)
                .at_most(1e-9),
        ],
    );
}

#[test]
fn a_number_outside_its_range_or_none_fails() {
    let holds = |value| number("x", value).near(1.0, 0.02).holds();
    assert!(holds(1.01) && !holds(1.03) && !holds(f64::NAN));
}
