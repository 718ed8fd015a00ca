//! The errors of every estimator in an experiment, next to those that the thesis published.

use serde::Serialize;

use super::candidates::{CANDIDATES, Candidate, Origin};
use super::truth::{Angles, Kind, TimedSample};
use report::measure::Limit::{self, AtMost, Within};
use report::measure::{Figure, Figures, data, figure, rows};
use report::table::Table;

/// Largest mean deviation of an axis, deg: the thesis' requirement.
const MOST_MEAN_DEG: f64 = 1.5;
/// Largest combined RMSE at rest, and largest RMSE of an axis in motion, deg.
const MOST_STATIC_DEG: f64 = 0.4;
const MOST_MOTION_DEG: f64 = 0.5;

/// Names of the axes.
pub const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// An estimator's errors, deg.
#[derive(Debug)]
pub struct Estimator {
    /// Its name.
    pub name: &'static str,
    /// Whether it has to meet the requirements.
    required: bool,
    /// Errors of roll, pitch and yaw.
    axes: [Axis; 3],
    /// Root of the sum of the axes' mean squares.
    combined_rmse_deg: f64,
    /// What the thesis measured with it.
    thesis: Option<Published>,
}

/// Figures of an axis. The first three are of the error, estimate less reference; the last two are
/// of the estimate itself, as in the thesis' tables 6.1 and 6.2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Mean error, deg.
    pub mean_deg: f64,
    /// Standard deviation of the error, deg.
    pub std_deg: f64,
    /// Root mean square of the error, deg.
    pub rmse_deg: f64,
    /// Mean of the estimate, deg.
    pub signal_mean_deg: f64,
    /// Standard deviation of the estimate, deg.
    pub signal_std_deg: f64,
}

/// A row of the thesis' tables: mean and standard deviation of the estimate (6.1, 6.2), combined
/// RMSE (6.3), deg.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Published {
    /// Means of roll, pitch, yaw.
    pub signal_mean_deg: Angles,
    /// Standard deviations of roll, pitch, yaw.
    pub signal_std_deg: Angles,
    /// RMSE of all axes together.
    pub combined_rmse_deg: f64,
}

const fn published(mean: Angles, std: Angles, combined: f64) -> Published {
    Published { signal_mean_deg: mean, signal_std_deg: std, combined_rmse_deg: combined }
}

/// Tables 6.1 and 6.3, in the order of [`CANDIDATES`].
const STATIC: [Published; 4] = [
    published([-0.191, 0.109, 197.02], [0.086, 0.100, 1.781], 3.4796),
    published([0.478, 1.311, 200.51], [0.207, 0.096, 3.128], 3.4712),
    published([0.086, -0.022, 200.26], [0.071, 0.033, 0.268], 0.3898),
    published([0.175, -1.304, 200.54], [0.125, 0.043, 0.624], 1.5579),
];

/// Tables 6.2 and 6.3.
const MOTION: [Published; 4] = [
    published([5.011, -1.598, 178.86], [1.657, 30.641, 0.770], 8.557),
    published([0.995, 0.041, 185.51], [1.445, 29.496, 3.940], 8.057),
    published([-0.060, 0.575, 178.46], [1.805, 29.547, 0.389], 3.3193),
    published([-0.605, 0.026, 181.3], [0.652, 28.882, 1.124], 4.6223),
];

impl Axis {
    /// Out of pairs of estimate and reference; an estimate is NaN until the estimator has started.
    fn of(pairs: impl Iterator<Item = (f64, f64)>) -> Self {
        let (mut n, mut error, mut signal) = (0.0, Sums::default(), Sums::default());
        for (estimate, reference) in pairs.filter(|(estimate, _)| !estimate.is_nan()) {
            n += 1.0;
            error.add(estimate - reference);
            signal.add(estimate);
        }
        let ((mean_deg, std_deg), (signal_mean_deg, signal_std_deg)) =
            (error.mean_and_std(n), signal.mean_and_std(n));
        Self {
            mean_deg,
            std_deg,
            rmse_deg: mean_deg.hypot(std_deg),
            signal_mean_deg,
            signal_std_deg,
        }
    }
}

/// Sums of the difference to the first value and of its square: exact for a small deviation.
#[derive(Default)]
struct Sums {
    origin: Option<f64>,
    sum: f64,
    squares: f64,
}

impl Sums {
    fn add(&mut self, value: f64) {
        let x = value - *self.origin.get_or_insert(value);
        self.sum += x;
        self.squares += x * x;
    }

    fn mean_and_std(&self, n: f64) -> (f64, f64) {
        let mean = self.sum / n;
        let variance = (self.squares / n - mean * mean).max(0.0);
        (self.origin.unwrap_or(f64::NAN) + mean, variance.sqrt())
    }
}

impl Estimator {
    fn of(
        kind: Kind,
        index: usize,
        candidate: &Candidate,
        samples: &[TimedSample],
        angles: &[Angles],
    ) -> Self {
        let counted = samples.iter().zip(angles);
        let counted = counted.filter(|(sample, _)| kind.counts(sample.time_s));
        let axes = [0, 1, 2].map(|axis| {
            let pairs = counted.clone();
            Axis::of(pairs.map(|(sample, angles)| (angles[axis], sample.reference_deg[axis])))
        });
        let [roll, pitch, yaw] = axes.map(|axis| axis.rmse_deg);
        let table = match kind {
            Kind::Static => &STATIC,
            Kind::Motion => &MOTION,
        };
        Self {
            name: candidate.name,
            required: candidate.origin == Origin::Required,
            axes,
            combined_rmse_deg: roll.hypot(pitch).hypot(yaw),
            thesis: table.get(index).copied(),
        }
    }

    /// All of each candidate.
    pub fn all(kind: Kind, samples: &[TimedSample], estimates: &[Vec<Angles>]) -> Vec<Self> {
        let candidates = CANDIDATES.iter().zip(estimates).enumerate();
        let of = |(index, (candidate, angles)): (usize, (_, &Vec<Angles>))| {
            Self::of(kind, index, candidate, samples, angles)
        };
        candidates.map(of).collect()
    }

    /// Its figures, held to what is required of it.
    fn figures(&self, kind: Kind) -> [Figure; 7] {
        let held = |is_held: bool, limit: Limit| (is_held && self.required).then_some(limit);
        let mean = self.required.then_some(Within(-MOST_MEAN_DEG, MOST_MEAN_DEG));
        let rmse = held(kind == Kind::Motion, AtMost(MOST_MOTION_DEG));
        let combined = held(kind == Kind::Static, AtMost(MOST_STATIC_DEG));
        let deg = |key, deg: f64, label: &str| figure(key, deg).shown(label, "", 3);
        let axis = |axis: usize| {
            let (name, of) = (AXES[axis], self.axes[axis]);
            figure(
                name,
                [
                    deg("mean_deg", of.mean_deg, &format!("{name} mean")).limit(mean),
                    deg("std_deg", of.std_deg, "std"),
                    deg("rmse_deg", of.rmse_deg, "RMSE").limit(rmse),
                    figure("signal_mean_deg", of.signal_mean_deg),
                    figure("signal_std_deg", of.signal_std_deg),
                ],
            )
        };
        let thesis = self.thesis.map(|thesis| {
            vec![
                data("signal_mean_deg", &thesis.signal_mean_deg),
                data("signal_std_deg", &thesis.signal_std_deg),
                deg("combined_rmse_deg", thesis.combined_rmse_deg, "thesis"),
            ]
        });
        [
            figure("name", self.name).shown("error, deg", "", 0),
            figure("required", self.required),
            axis(0),
            axis(1),
            axis(2),
            deg("combined_rmse_deg", self.combined_rmse_deg, "combined RMSE").limit(combined),
            figure("thesis", thesis).shown("thesis", "", 3).or(""),
        ]
    }
}

/// All figures: under `estimators` a row for each.
pub fn figures(kind: Kind, seed: u64, samples: &[TimedSample], all: &[Estimator]) -> Figures {
    let counted = samples.iter().filter(|sample| kind.counts(sample.time_s)).count();
    Figures::from([
        figure("experiment", kind.name()),
        figure("seed", seed),
        figure("samples", counted),
        rows("estimators", all.iter().map(|estimator| estimator.figures(kind))),
    ])
}

/// Mean and deviation of the estimates as in the thesis' tables 6.1 and 6.2, below each the thesis'
/// own row where there is one.
pub fn signals(all: &[Estimator]) -> Table {
    let line = |name: &str, mean: Angles, std: Angles| {
        let pairs = mean.into_iter().zip(std);
        let cells = pairs.flat_map(|(mean, std)| [mean, std].map(|deg| format!("{deg:.3}")));
        std::iter::once(name.to_owned()).chain(cells).collect::<Vec<_>>()
    };
    let rows = all.iter().flat_map(|Estimator { name, axes, thesis, .. }| {
        let mean = axes.map(|axis| axis.signal_mean_deg);
        let own = line(name, mean, axes.map(|axis| axis.signal_std_deg));
        let published = thesis
            .map(|thesis| line("as published", thesis.signal_mean_deg, thesis.signal_std_deg));
        std::iter::once(own).chain(published)
    });
    Table::new(SIGNAL_COLUMNS, rows)
}

/// Columns of [`signals`].
const SIGNAL_COLUMNS: [&str; 7] =
    ["estimate, deg", "roll mean", "std", "pitch mean", "std", "yaw mean", "std"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_deviation_and_rmse_of_a_known_error() {
        let axis = Axis::of([(f64::NAN, 200.0), (201.0, 200.0), (203.0, 200.0)].into_iter());
        let expected = Axis {
            mean_deg: 2.0,
            std_deg: 1.0,
            rmse_deg: 5f64.sqrt(),
            signal_mean_deg: 202.0,
            signal_std_deg: 1.0,
        };
        assert_eq!(axis, expected);
    }

    /// The thesis' combined figure at rest is the root of the sum of squares of its table 6.1.
    #[test]
    fn the_published_tables_agree_with_the_definition() {
        for row in STATIC {
            let deviation =
                [row.signal_mean_deg[0], row.signal_mean_deg[1], row.signal_mean_deg[2] - 200.0];
            let sum: f64 = deviation.iter().map(|d| d * d).sum::<f64>()
                + row.signal_std_deg.iter().map(|s| s * s).sum::<f64>();
            let combined = row.combined_rmse_deg;
            assert!((sum.sqrt() - combined).abs() < 0.02, "{row:?}: {}", sum.sqrt());
        }
    }

    #[test]
    fn what_is_missed_is_named() {
        let axis = |mean_deg: f64, std_deg: f64| Axis {
            mean_deg,
            std_deg,
            rmse_deg: mean_deg.hypot(std_deg),
            signal_mean_deg: 0.0,
            signal_std_deg: 0.0,
        };
        let estimator = Estimator {
            name: "Mahony",
            required: true,
            axes: [axis(0.0, 0.1), axis(-1.6, 0.1), axis(0.0, 0.3)],
            combined_rmse_deg: 1.64,
            thesis: None,
        };
        let missed = |kind| figures(kind, 1, &[], std::slice::from_ref(&estimator)).missed_keys();
        let mean = "estimators[0].pitch.mean_deg";
        assert_eq!(missed(Kind::Static), [mean, "estimators[0].combined_rmse_deg"]);
        assert_eq!(missed(Kind::Motion), [mean, "estimators[0].pitch.rmse_deg"]);
    }
}
