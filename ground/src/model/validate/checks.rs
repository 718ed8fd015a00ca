//! The checks: a number, and the range that it must lie in.

use anyhow::{Context, Result};
use plant::scenario::Row;
use plant::{Linkage, Parameters};
use serde::Serialize;

use super::runs::{Instant, Runs};

/// A number that must lie in a range.
#[derive(Serialize)]
pub struct Check {
    /// The thesis' figure that it belongs to, if any.
    pub figure: Option<&'static str>,
    /// What was measured, with its unit.
    pub name: &'static str,
    /// The number.
    pub value: f64,
    /// The least and the greatest that it may be.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Whether it lies there.
    pub passed: bool,
}

impl Check {
    /// A number that must lie within `tolerance` of `expected`.
    fn near(
        figure: Option<&'static str>,
        name: &'static str,
        value: f64,
        expected: f64,
        tolerance: f64,
    ) -> Self {
        Self::between(
            figure,
            name,
            value,
            expected - tolerance,
            expected + tolerance,
        )
    }

    /// An error that must not exceed `most`.
    fn most(figure: Option<&'static str>, name: &'static str, value: f64, most: f64) -> Self {
        Self::between(figure, name, value, 0.0, most)
    }

    fn between(
        figure: Option<&'static str>,
        name: &'static str,
        value: f64,
        low: f64,
        high: f64,
    ) -> Self {
        Self {
            figure,
            name,
            value,
            low,
            high,
            passed: (low..=high).contains(&value),
        }
    }

    /// The number and its range, rounded for a person.
    pub fn cells(&self) -> [String; 2] {
        let range = if self.low == 0.0 && self.high == 0.0 {
            "exactly 0".into()
        } else if self.low == 0.0 {
            format!("at most {}", short(self.high))
        } else {
            let (middle, half) = (0.5 * (self.low + self.high), 0.5 * (self.high - self.low));
            if half < 0.1 * middle.abs() {
                format!("{} ± {half:.0e}", short(middle))
            } else {
                format!("{} to {}", short(self.low), short(self.high))
            }
        };
        [short(self.value), range]
    }

    /// In one line.
    pub fn said(&self) -> String {
        let [value, range] = self.cells();
        let figure = self
            .figure
            .map_or(String::new(), |f| format!("figure {f}, "));
        format!("{figure}{}: {value} ({range})", self.name)
    }
}

/// A number as people read it: a few decimals, or a power of ten where those say nothing.
fn short(value: f64) -> String {
    if value == 0.0 {
        "0".into()
    } else if value.abs() < 1e-3 {
        format!("{value:.1e}")
    } else if value.abs() < 0.1 {
        format!("{value:.7}")
    } else {
        format!("{value:.5}")
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

fn end(rows: &[Row]) -> Result<&Row> {
    rows.last().context("a motion without rows")
}

/// All checks, in the order of the thesis' figures, then the balances.
pub fn all(runs: &Runs) -> Result<Vec<Check>> {
    let mut checks = linkage(runs)?;
    checks.extend(loads(runs)?);
    checks.extend(balances(runs)?);
    Ok(checks)
}

fn linkage(runs: &Runs) -> Result<Vec<Check>> {
    let linkage = Linkage::new(&Parameters::PHYS);
    let (low, high) = linkage
        .dead_points()
        .context("the recommended linkage is a crank-rocker")?;
    let open = |row: &Row| {
        let [x, y] = linkage.residual([row.theta1, row.theta2, row.theta3]);
        x.hypot(y)
    };
    let mut start = (-0.2014, 0.0106);
    let mut apart = 0.0_f64;
    for row in &runs.sweep {
        let root = linkage
            .newton_raphson(row.theta1, start)
            .context("Newton and Raphson's method does not converge")?;
        start = (root.link_rad, root.rudder_rad);
        let difference = (root.link_rad - row.theta2).hypot(root.rudder_rad - row.theta3);
        apart = apart.max(difference);
    }
    let sweep = runs.sweep.as_slice();
    Ok(vec![
        Check::near(
            Some("5.8"),
            "crank at its end, rad",
            top(sweep, |r| r.theta1),
            0.8,
            1e-9,
        ),
        Check::near(
            Some("5.9"),
            "link, most, rad",
            top(sweep, |r| r.theta2),
            -0.20130,
            5e-6,
        ),
        Check::near(
            Some("5.9"),
            "link, least, rad",
            bottom(sweep, |r| r.theta2),
            -0.24277,
            5e-6,
        ),
        Check::near(
            Some("5.10"),
            "rudder at the start, rad",
            sweep[0].theta3,
            0.01067,
            5e-6,
        ),
        Check::near(
            Some("5.10"),
            "rudder at its end, rad",
            top(sweep, |r| r.theta3),
            0.39946,
            5e-6,
        ),
        Check::most(
            Some("5.8-5.10"),
            "rudder's way back to where it began, rad",
            (end(sweep)?.theta3 - sweep[0].theta3).abs(),
            1e-12,
        ),
        Check::most(
            Some("5.8-5.10"),
            "gap of the closed loop, m",
            largest(sweep, open),
            1e-15,
        ),
        Check::most(
            Some("5.8-5.10"),
            "closed form against Newton-Raphson, rad",
            apart,
            1e-14,
        ),
        Check::near(
            None,
            "crank at zero rudder, rad",
            linkage.zero_rudder_crank_rad(),
            -0.0191473,
            5e-8,
        ),
        Check::near(
            None,
            "upper dead point: crank, deg",
            high.0.to_degrees(),
            71.43,
            5e-3,
        ),
        Check::near(
            None,
            "upper dead point: rudder, deg",
            high.1.to_degrees(),
            27.81,
            5e-3,
        ),
        Check::near(
            None,
            "lower dead point: crank, deg",
            low.0.to_degrees(),
            -116.34,
            5e-3,
        ),
        Check::near(
            None,
            "lower dead point: rudder, deg",
            low.1.to_degrees(),
            -42.30,
            5e-3,
        ),
    ])
}

fn loads(runs: &Runs) -> Result<Vec<Check>> {
    let moved = |row: &Row| {
        let angles = (row.theta0 - 0.3).abs() + (row.theta1 - 0.1).abs();
        angles + row.w0.abs() + row.w1.abs()
    };
    let pitch = |r: &Row| r.theta0;
    Ok(vec![
        Check::most(
            Some("5.11"),
            "motion without forces, rad",
            largest(&runs.still, moved),
            0.0,
        ),
        Check::near(
            Some("5.12"),
            "gravity, centre of mass at the pivot: pitch after 5 s from 0.1, rad",
            end(&runs.balanced)?.theta0,
            0.096,
            1e-3,
        ),
        Check::near(
            Some("5.12"),
            "gravity, body balanced at the pivot: far end of the swing from 0.2, rad",
            bottom(&runs.pendulum, pitch),
            -0.205,
            2e-3,
        ),
        Check::between(
            Some("5.12"),
            "gravity, centre of mass 2 cm above: it falls, reaching rad",
            largest(&runs.top_heavy, pitch),
            2.0,
            100.0,
        ),
        Check::near(
            Some("5.13"),
            "thrust and 0.1 N m: crank settles at rad",
            end(&runs.torque)?.theta1,
            0.263,
            2e-3,
        ),
        Check::near(
            Some("5.13"),
            "thrust and 0.1 N m: pitch after 2 s, rad",
            end(&runs.torque)?.theta0,
            -16.29,
            0.05,
        ),
        Check::near(
            Some("5.13"),
            "thrust and 6 V against a stop at 0.8 rad: crank touches rad",
            top(&runs.stopped, |r| r.theta1),
            0.85,
            0.005,
        ),
        Check::near(
            Some("5.13"),
            "thrust and 6 V against a stop: rudder touches rad",
            top(&runs.stopped, |r| r.theta3),
            0.417,
            0.002,
        ),
        Check::near(
            Some("5.13"),
            "thrust and 6 V against a stop: pitch after 1 s, rad",
            end(&runs.stopped)?.theta0,
            -9.5,
            0.1,
        ),
    ])
}

fn balances(runs: &Runs) -> Result<Vec<Check>> {
    let first = |instants: &[Instant]| instants.first().copied().context("a motion without rows");
    let (coasting, driven) = (first(&runs.coasting)?, first(&runs.driven)?);
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
        let full = runs
            .mechanism
            .dynamics(&instant.state, torque)
            .context("the 14 equations have no solution")?
            .accelerations_rad_s2;
        let reduced = runs.mechanism.accelerations(&instant.state, torque);
        let size = reduced[0].hypot(reduced[1]).max(1.0);
        apart = apart.max((full[0] - reduced[0]).hypot(full[1] - reduced[1]) / size);
    }
    Ok(vec![
        Check::most(
            None,
            "energy of a free tumble over 5 s, relative drift",
            energy(&runs.coasting, coasting),
            1e-9,
        ),
        Check::most(
            None,
            "energy under wash, thrust, friction and servo against their work, relative",
            energy(&runs.driven, driven),
            1e-9,
        ),
        Check::most(
            None,
            "momentum of a free tumble against gravity's impulse, relative",
            momentum(&runs.coasting, coasting),
            1e-9,
        ),
        Check::most(
            None,
            "momentum under everything against the impulse of all moments, relative",
            momentum(&runs.driven, driven),
            1e-9,
        ),
        Check::most(
            None,
            "14 Newton-Euler equations against the reduced form, relative",
            apart,
            1e-9,
        ),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_outside_its_range_or_none_fails() {
        assert!(Check::near(None, "x", 1.01, 1.0, 0.02).passed);
        assert!(!Check::near(None, "x", 1.03, 1.0, 0.02).passed);
        assert!(!Check::most(None, "x", f64::NAN, 1.0).passed);
        assert!(Check::most(None, "x", 0.0, 0.0).passed);
        assert_eq!(
            Check::most(Some("5.11"), "motion, rad", 2e-5, 0.0).said(),
            "figure 5.11, motion, rad: 2.0e-5 (exactly 0)"
        );
    }
}
