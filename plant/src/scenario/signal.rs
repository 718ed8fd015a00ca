//! Inputs over time.

use serde::{Deserialize, Serialize};

use crate::drone::Crank;

use super::ScenarioError;

/// A value over time: constant, or a table of times (s) and values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Signal {
    /// The same at all times.
    Constant(f64),
    /// Points in order of time; the ends hold before and after.
    Table(Vec<[f64; 2]>),
}

impl Signal {
    /// Checks that values are finite and times increase.
    pub(super) fn validate(&self) -> Result<(), ScenarioError> {
        let points = match self {
            Self::Constant(value) if value.is_finite() => return Ok(()),
            Self::Constant(_) => return Err(ScenarioError::Table(0)),
            Self::Table(points) => points,
        };
        if points.is_empty() {
            return Err(ScenarioError::Table(0));
        }
        for (i, [time, value]) in points.iter().enumerate() {
            let ordered = i == 0 || *time > points[i - 1][0];
            if !(time.is_finite() && value.is_finite() && ordered) {
                return Err(ScenarioError::Table(i));
            }
        }
        Ok(())
    }

    /// The points at which the signal bends.
    pub(super) fn knots(&self) -> &[[f64; 2]] {
        match self {
            Self::Constant(_) => &[],
            Self::Table(points) => points,
        }
    }

    /// The value at a time (s), straight between points.
    pub fn straight(&self, time_s: f64) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Table(points) => match around(points, time_s) {
                Around::Outside(value) => value,
                Around::Between(i) => {
                    let ([t0, v0], [t1, v1]) = (points[i], points[i + 1]);
                    v0 + (v1 - v0) * (time_s - t0) / (t1 - t0)
                }
            },
        }
    }

    /// The value as an angle and its rate at a time (s), by cubics through the points whose rate at
    /// a point is that of the parabola through it and its neighbours.
    pub fn smooth(&self, time_s: f64) -> Crank {
        let still = |angle_rad| Crank {
            angle_rad,
            rate_rad_s: 0.0,
        };
        let points = match self {
            Self::Constant(value) => return still(*value),
            Self::Table(points) => points,
        };
        let i = match around(points, time_s) {
            Around::Outside(value) => return still(value),
            Around::Between(i) => i,
        };
        let ([t0, v0], [t1, v1]) = (points[i], points[i + 1]);
        let h = t1 - t0;
        let (m0, m1) = (h * rate_at(points, i), h * rate_at(points, i + 1));
        let x = (time_s - t0) / h;
        let (rise, bend) = (v1 - v0, 3.0 * (v1 - v0) - 2.0 * m0 - m1);
        let twist = m0 + m1 - 2.0 * rise;
        Crank {
            angle_rad: v0 + x * (m0 + x * (bend + x * twist)),
            rate_rad_s: (m0 + x * (2.0 * bend + x * 3.0 * twist)) / h,
        }
    }
}

/// Where a time lies in a table.
enum Around {
    /// Before or after all points: the value that holds there.
    Outside(f64),
    /// Between this point and the next.
    Between(usize),
}

fn around(points: &[[f64; 2]], time_s: f64) -> Around {
    let after = points.partition_point(|point| point[0] <= time_s);
    let last = points.len() - 1;
    match after {
        0 => Around::Outside(points[0][1]),
        // The last point itself still belongs to the last piece, which gives it its rate.
        _ if after > last && (points[last][0] < time_s || last == 0) => {
            Around::Outside(points[last][1])
        }
        _ => Around::Between((after - 1).min(last - 1)),
    }
}

/// Rate at a point: of the parabola through it and its neighbours, one-sided at the ends.
fn rate_at(points: &[[f64; 2]], i: usize) -> f64 {
    let slope = |a: usize| (points[a + 1][1] - points[a][1]) / (points[a + 1][0] - points[a][0]);
    let width = |a: usize| points[a + 1][0] - points[a][0];
    let last = points.len() - 1;
    if last == 1 {
        return slope(0);
    }
    // A parabola's slope at an end is its first chord's, extrapolated by half the change between
    // chords over their mean distance.
    if i == 0 {
        return slope(0) - (slope(1) - slope(0)) * width(0) / (width(0) + width(1));
    }
    if i == last {
        let (a, b) = (last - 2, last - 1);
        return slope(b) + (slope(b) - slope(a)) * width(b) / (width(a) + width(b));
    }
    let (before, after) = (width(i - 1), width(i));
    (slope(i - 1) * after + slope(i) * before) / (before + after)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Through points of a parabola, unevenly spaced, the cubics are that parabola.
    #[test]
    fn a_parabola_is_kept() {
        let parabola = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t;
        let points = [0.0, 0.1, 0.25, 0.5, 0.6, 1.0].map(|t| [t, parabola(t)]);
        let signal = Signal::Table(points.to_vec());
        for i in 0..=100 {
            let t = f64::from(i) * 0.01;
            let crank = signal.smooth(t);
            assert!((crank.angle_rad - parabola(t)).abs() < 1e-12, "{t}");
            assert!((crank.rate_rad_s - (6.0 * t - 2.0)).abs() < 1e-11, "{t}");
        }
        assert_eq!(
            signal.smooth(2.0),
            Crank {
                angle_rad: 2.0,
                rate_rad_s: 0.0
            }
        );
        assert_eq!(
            signal.smooth(-1.0),
            Crank {
                angle_rad: 1.0,
                rate_rad_s: 0.0
            }
        );
    }

    #[test]
    fn straight_lines_by_hand() {
        let signal = Signal::Table(vec![[1.0, 0.0], [2.0, 4.0]]);
        assert_eq!(
            [0.0, 1.0, 1.25, 2.0, 3.0].map(|t| signal.straight(t)),
            [0.0, 0.0, 1.0, 4.0, 4.0]
        );
        assert_eq!(
            signal.smooth(1.5),
            Crank {
                angle_rad: 2.0,
                rate_rad_s: 4.0
            }
        );
        assert_eq!(Signal::Table(vec![[0.0, 3.0]]).smooth(0.0).angle_rad, 3.0);
    }
}
