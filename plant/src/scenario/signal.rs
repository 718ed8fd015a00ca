//! Inputs over time: as a scenario writes them, and as curves that can be evaluated.

use serde::{Deserialize, Deserializer, de::Error};
use toml::Value;

/// A value over time, in the unit of the key that it stands at.
///
/// ```toml
/// torque_n_m = 0.1                                          # the same at all times
/// torque_n_m = [[0.0, 0.0], [1.0, 0.1]]                     # times in s, and values
/// torque_n_m = { points = [[0, 0], [1, 0.1]], between = "hold" }
/// torque_n_m = { offset = 0.0, amplitude = 0.1, period_s = 2.0, phase_rad = 0.0 }
/// ```
///
/// A table's first value holds before its first time, its last one after the last.
#[derive(Clone, Debug, PartialEq)]
pub enum Signal {
    /// The same at all times.
    Constant(f64),
    /// Points in order of time.
    Table(Table),
    /// A sine.
    Sine(Sine),
}

/// Points in order of time.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Times, in s, and values.
    pub points: Vec<[f64; 2]>,
    /// What happens between points; if left out, smooth for an angle and straight for a load.
    pub between: Option<Between>,
}

/// How a table goes on from one point to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Between {
    /// A point's value holds until the next one's time.
    Hold,
    /// Straight lines.
    Straight,
    /// Cubics whose value, rate and curvature are continuous (a spline); its rate at the ends is
    /// that of the cubic through the four points there.
    Smooth,
}

/// `offset + amplitude sin(2 pi t / period_s + phase_rad)`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// Mean value.
    #[serde(default)]
    pub offset: f64,
    /// Amplitude.
    pub amplitude: f64,
    /// Period, in s.
    pub period_s: f64,
    /// Phase at t = 0, in rad.
    #[serde(default)]
    pub phase_rad: f64,
}

impl Default for Signal {
    fn default() -> Self {
        Self::Constant(0.0)
    }
}

impl<'de> Deserialize<'de> for Signal {
    /// Chooses by the value's shape, so that an error names the mistake inside that shape.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let into = |error: toml::de::Error| D::Error::custom(error.message());
        match Value::deserialize(deserializer)? {
            Value::Float(value) => Ok(Self::Constant(value)),
            Value::Integer(value) => Ok(Self::Constant(value as f64)),
            points @ Value::Array(_) => {
                Ok(Self::Table(Table { points: points.try_into().map_err(into)?, between: None }))
            }
            Value::Table(table) if table.contains_key("points") => {
                Value::Table(table).try_into().map(Self::Table).map_err(into)
            }
            Value::Table(table) => Value::Table(table).try_into().map(Self::Sine).map_err(into),
            other => Err(D::Error::custom(format!(
                "a {} is no input: a number, a table [[time, value], ...] or a sine is",
                other.type_str()
            ))),
        }
    }
}

impl Signal {
    /// What is wrong with it, if anything.
    pub(super) fn problem(&self) -> Option<String> {
        match self {
            Self::Constant(value) if value.is_finite() => None,
            Self::Constant(value) => Some(format!("{value} is not finite")),
            Self::Table(Table { points, .. }) => {
                if points.is_empty() {
                    return Some("the table has no points".into());
                }
                if let Some(i) = points.iter().position(|p| !(p[0] + p[1]).is_finite()) {
                    return Some(format!("point {} of the table is not finite", i + 1));
                }
                let i = points.windows(2).position(|pair| pair[1][0] <= pair[0][0])?;
                Some(format!(
                    "the table's times must increase: {} s (point {}) follows {} s",
                    points[i + 1][0],
                    i + 2,
                    points[i][0]
                ))
            }
            Self::Sine(sine) => {
                let values = [sine.offset, sine.amplitude, sine.period_s, sine.phase_rad];
                if values.iter().any(|value| !value.is_finite()) {
                    Some("the sine has a value that is not finite".into())
                } else if sine.period_s <= 0.0 {
                    Some(format!("period_s is {}, it must be above zero", sine.period_s))
                } else {
                    None
                }
            }
        }
    }

    /// The curve to evaluate; `between` serves tables that do not say how they go on.
    pub(super) fn curve(&self, between: Between) -> Curve {
        match self {
            Self::Constant(value) => Curve::Table {
                points: vec![[0.0, *value]],
                rates: vec![0.0],
                between: Between::Hold,
            },
            Self::Table(table) => Curve::Table {
                rates: spline_rates(&table.points),
                points: table.points.clone(),
                between: table.between.unwrap_or(between),
            },
            Self::Sine(sine) => Curve::Sine(*sine),
        }
    }
}

/// A signal ready to be evaluated.
#[derive(Clone, Debug)]
pub(super) enum Curve {
    /// Points with the spline's rates at them.
    Table { points: Vec<[f64; 2]>, rates: Vec<f64>, between: Between },
    /// A sine.
    Sine(Sine),
}

impl Curve {
    /// Times at which the curve has a kink or a jump.
    pub(super) fn knots(&self) -> impl Iterator<Item = f64> + '_ {
        let points: &[[f64; 2]] = match self {
            Self::Table { points, .. } => points,
            Self::Sine(_) => &[],
        };
        points.iter().map(|point| point[0])
    }

    /// The value at a time (s).
    pub(super) fn value(&self, time_s: f64) -> f64 {
        self.at(time_s)[0]
    }

    /// The value at a time (s) and its rate. On a point, the piece that begins there counts; on
    /// the last one, the piece that ends there.
    pub(super) fn at(&self, time_s: f64) -> [f64; 2] {
        let (points, rates, between) = match self {
            Self::Sine(sine) => {
                let turn = std::f64::consts::TAU / sine.period_s;
                let (sin, cos) = (turn * time_s + sine.phase_rad).sin_cos();
                return [sine.offset + sine.amplitude * sin, sine.amplitude * turn * cos];
            }
            Self::Table { points, rates, between } => (points, rates, *between),
        };
        let last = points.len() - 1;
        let after = points.partition_point(|point| point[0] <= time_s);
        if after == 0 || points[last][0] < time_s || last == 0 {
            return [points[after.saturating_sub(1)][1], 0.0];
        }
        if between == Between::Hold {
            return [points[after - 1][1], 0.0];
        }
        let i = (after - 1).min(last - 1);
        let ([t0, v0], [t1, v1]) = (points[i], points[i + 1]);
        let (h, rise) = (t1 - t0, v1 - v0);
        let x = (time_s - t0) / h;
        let (m0, m1) = match between {
            Between::Smooth => (h * rates[i], h * rates[i + 1]),
            _ => (rise, rise),
        };
        let (bend, twist) = (3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise);
        [v0 + x * (m0 + x * (bend + x * twist)), (m0 + x * (2.0 * bend + x * 3.0 * twist)) / h]
    }
}

/// Rates of the spline at its points: those that make the curvature continuous, by the usual
/// three-term equations
///
/// ```text
/// m[i-1]/a + 2 (1/a + 1/b) m[i] + m[i+1]/b = 3 (rise before / a^2 + rise after / b^2)
/// ```
///
/// with `a`, `b` the widths before and after point `i`, and the ends given.
fn spline_rates(points: &[[f64; 2]]) -> Vec<f64> {
    let n = points.len();
    if n < 2 {
        return vec![0.0; n];
    }
    let end = n.min(4);
    let mut rates = vec![0.0; n];
    rates[0] = polynomial_rate(&points[..end], points[0][0]);
    rates[n - 1] = polynomial_rate(&points[n - end..], points[n - 1][0]);
    // Forward sweep and back substitution; the matrix is diagonally dominant.
    let mut upper = vec![0.0; n];
    for i in 1..n - 1 {
        let [a, b] = [i, i + 1].map(|j| 1.0 / (points[j][0] - points[j - 1][0]));
        let [before, after] = [i, i + 1].map(|j| points[j][1] - points[j - 1][1]);
        let pivot = 2.0 * (a + b) - a * upper[i - 1];
        let right = 3.0 * (before * a * a + after * b * b);
        upper[i] = b / pivot;
        rates[i] = (right - a * rates[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        rates[i] -= upper[i] * rates[i + 1];
    }
    rates
}

/// Rate at a time (s) of the polynomial through the points: Lagrange's form, differentiated.
fn polynomial_rate(points: &[[f64; 2]], time_s: f64) -> f64 {
    let count = points.len();
    (0..count)
        .map(|i| {
            let rate: f64 = (0..count)
                .filter(|&k| k != i)
                .map(|k| {
                    let rest: f64 = (0..count)
                        .filter(|&j| j != i && j != k)
                        .map(|j| (time_s - points[j][0]) / (points[i][0] - points[j][0]))
                        .product();
                    rest / (points[i][0] - points[k][0])
                })
                .sum();
            points[i][1] * rate
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(points: &[[f64; 2]], between: Between) -> Curve {
        Signal::Table(Table { points: points.to_vec(), between: Some(between) })
            .curve(Between::Hold)
    }

    /// Through points of a cubic, unevenly spaced, the spline is that cubic.
    #[test]
    fn a_cubic_is_kept() {
        let cubic = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t - 4.0 * t * t * t;
        let points = [0.0, 0.1, 0.25, 0.5, 0.6, 1.0].map(|t| [t, cubic(t)]);
        let curve = table(&points, Between::Smooth);
        for i in 0..=100 {
            let t = f64::from(i) * 0.01;
            let [value, rate] = curve.at(t);
            assert!((value - cubic(t)).abs() < 1e-12, "{t}");
            assert!((rate - (6.0 * t - 2.0 - 12.0 * t * t)).abs() < 1e-11, "{t}");
        }
        assert_eq!(curve.at(2.0), [cubic(1.0), 0.0]);
        assert_eq!(curve.at(-1.0), [1.0, 0.0]);
    }

    /// A motion sampled at 1 kHz comes back to 1e-10, its rate to 1e-8.
    #[test]
    fn a_dense_table_is_the_motion_it_was_sampled_from() {
        let motion = Sine {
            offset: 0.4,
            amplitude: 0.4,
            period_s: 3.0,
            phase_rad: -std::f64::consts::FRAC_PI_2,
        };
        let truth = Signal::Sine(motion).curve(Between::Hold);
        let points: Vec<_> =
            (0..=3000).map(|i| f64::from(i) * 1e-3).map(|t| [t, truth.value(t)]).collect();
        let curve = table(&points, Between::Smooth);
        for i in 0..=29_999 {
            let t = f64::from(i) * 1e-4;
            let ([value, rate], [value_true, rate_true]) = (curve.at(t), truth.at(t));
            assert!((value - value_true).abs() < 1e-10, "{t}");
            assert!((rate - rate_true).abs() < 1e-8, "{t}: {rate} {rate_true}");
        }
        assert!(truth.value(0.0).abs() < 1e-16 && (truth.value(1.5) - 0.8).abs() < 1e-15);
    }

    #[test]
    fn straight_and_held_by_hand() {
        let points = [[1.0, 0.0], [2.0, 4.0]];
        let at = |between| [0.0, 1.0, 1.25, 2.0, 3.0].map(|t| table(&points, between).at(t));
        assert_eq!(
            at(Between::Straight),
            [[0.0, 0.0], [0.0, 4.0], [1.0, 4.0], [4.0, 4.0], [4.0, 0.0]]
        );
        assert_eq!(at(Between::Hold), [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [4.0, 0.0], [4.0, 0.0]]);
        assert_eq!(table(&points, Between::Smooth).at(1.5), [2.0, 4.0]);
        assert_eq!(table(&[[0.0, 3.0]], Between::Smooth).at(0.0), [3.0, 0.0]);
    }
}
