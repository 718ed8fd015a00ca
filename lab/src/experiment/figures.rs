//! The errors of every estimator in an experiment, next to those that the thesis published.

use nalgebra::Vector3;
use serde::Serialize;

use super::candidates::{CANDIDATES, Candidate, Origin};
use super::parts::Part;
use super::truth::{Angles, Kind, TimedSample};
use report::table::Table;

/// Largest mean deviation of an axis, deg: the thesis' requirement.
const MOST_MEAN_DEG: f64 = 1.5;
/// Largest combined RMSE at rest, and largest RMSE of an axis in motion, deg.
const MOST_STATIC_DEG: f64 = 0.4;
const MOST_MOTION_DEG: f64 = 0.5;

/// Names of the axes.
pub const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// Everything, as printed by `--json`.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// Its name on the command line.
    pub experiment: &'static str,
    /// Seed of all that is random.
    pub seed: u64,
    /// Samples over which errors are taken.
    pub samples: u64,
    /// A row for each estimator.
    pub estimators: Vec<Row>,
    /// Whether every requirement holds.
    pub met: bool,
    /// What was missed, in words.
    pub missed: Vec<String>,
}

/// An estimator's errors, deg.
#[derive(Debug, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// Whether it has to meet the requirements.
    pub required: bool,
    /// Errors of roll.
    pub roll: Axis,
    /// Errors of pitch.
    pub pitch: Axis,
    /// Errors of yaw.
    pub yaw: Axis,
    /// Root of the sum of the axes' mean squares.
    pub combined_rmse_deg: f64,
    /// What the thesis measured with it.
    pub thesis: Option<Published>,
    /// Its errors in the parts of an experiment that has parts.
    pub parts: Vec<PartErrors>,
}

/// Errors in a part, deg.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PartErrors {
    /// What acts in it.
    pub part: String,
    /// Root mean square of the angle between the true and the estimated vertical.
    pub tilt_rmse_deg: f64,
    /// The largest such angle.
    pub tilt_max_deg: f64,
    /// Root mean square of the heading's error.
    pub yaw_rmse_deg: f64,
    /// Time from the end of an acceleration to that from which the tilt was within
    /// [`RECOVERED_DEG`], s.
    pub recovered_s: Option<f64>,
}

/// A tilt that is recovered, deg.
const RECOVERED_DEG: f64 = 1.0;

impl PartErrors {
    fn of(part: &Part, samples: &[TimedSample], angles: &[Angles]) -> Self {
        let (mut tilts, mut yaws, mut most) = (Sums::default(), Sums::default(), 0.0_f64);
        let mut recovered_s = part.released_s().map(|_| 0.0);
        let mut n = 0.0;
        for (sample, estimate) in samples.iter().zip(angles) {
            if !part.counts(sample.time_s) || estimate[0].is_nan() {
                continue;
            }
            n += 1.0;
            let tilt = tilt_deg(estimate, &sample.reference_deg);
            tilts.add(tilt);
            yaws.add(estimate[2] - sample.reference_deg[2]);
            most = most.max(tilt);
            if let (Some(recovered), Some(released)) = (&mut recovered_s, part.released_s())
                && tilt > RECOVERED_DEG
            {
                *recovered = (sample.time_s - released).max(0.0);
            }
        }
        let rmse = |sums: &Sums| {
            let (mean, std) = sums.mean_and_std(n);
            mean.hypot(std)
        };
        Self {
            part: part.name(),
            tilt_rmse_deg: rmse(&tilts),
            tilt_max_deg: most,
            yaw_rmse_deg: rmse(&yaws),
            recovered_s,
        }
    }
}

/// Angle between the verticals of two attitudes, deg.
fn tilt_deg(one: &Angles, other: &Angles) -> f64 {
    let up = |[roll, pitch, _]: &Angles| {
        let ((sr, cr), (sp, cp)) = (roll.to_radians().sin_cos(), pitch.to_radians().sin_cos());
        Vector3::new(-sp, sr * cp, cr * cp)
    };
    up(one).angle(&up(other)).to_degrees()
}

/// Figures of an axis. The first three are of the error, estimate less reference; the last two are
/// of the estimate itself, as in the thesis' tables 6.1 and 6.2.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
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
    Published {
        signal_mean_deg: mean,
        signal_std_deg: std,
        combined_rmse_deg: combined,
    }
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

impl Row {
    fn of(
        kind: Kind,
        index: usize,
        candidate: &Candidate,
        samples: &[TimedSample],
        angles: &[Angles],
    ) -> Self {
        let axis = |axis: usize| {
            Axis::of(
                samples
                    .iter()
                    .zip(angles)
                    .filter(|(sample, _)| kind.counts(sample.time_s))
                    .map(|(sample, angles)| (angles[axis], sample.reference_deg[axis])),
            )
        };
        let [roll, pitch, yaw] = [axis(0), axis(1), axis(2)];
        let table: &[Published] = match kind {
            Kind::Static => &STATIC,
            Kind::Motion => &MOTION,
            _ => &[],
        };
        let parts = kind.parts();
        Self {
            name: candidate.name,
            required: candidate.origin == Origin::Required,
            roll,
            pitch,
            yaw,
            combined_rmse_deg: roll.rmse_deg.hypot(pitch.rmse_deg).hypot(yaw.rmse_deg),
            thesis: table.get(index).copied(),
            parts: parts
                .iter()
                .map(|part| PartErrors::of(part, samples, angles))
                .collect(),
        }
    }

    /// Roll, pitch and yaw.
    pub fn axes(&self) -> [Axis; 3] {
        [self.roll, self.pitch, self.yaw]
    }

    fn missed(&self, kind: Kind) -> Vec<String> {
        let mut missed = Vec::new();
        if !matches!(kind, Kind::Static | Kind::Motion) {
            return missed;
        }
        let mut at_most = |what: &str, value: f64, most: f64| {
            if value.is_nan() || value > most {
                missed.push(format!(
                    "{}: {what} {value:.3} deg, at most {most} deg",
                    self.name
                ));
            }
        };
        for (name, axis) in AXES.iter().zip(self.axes()) {
            at_most(&format!("mean {name}"), axis.mean_deg.abs(), MOST_MEAN_DEG);
            if kind == Kind::Motion {
                at_most(&format!("RMSE {name}"), axis.rmse_deg, MOST_MOTION_DEG);
            }
        }
        if kind == Kind::Static {
            at_most("combined RMSE", self.combined_rmse_deg, MOST_STATIC_DEG);
        }
        missed
    }
}

impl Figures {
    /// From what each candidate estimated.
    pub fn new(kind: Kind, seed: u64, samples: &[TimedSample], estimates: &[Vec<Angles>]) -> Self {
        let estimators: Vec<Row> = CANDIDATES
            .iter()
            .zip(estimates)
            .enumerate()
            .map(|(index, (candidate, angles))| Row::of(kind, index, candidate, samples, angles))
            .collect();
        let missed: Vec<String> = estimators
            .iter()
            .filter(|row| row.required)
            .flat_map(|row| row.missed(kind))
            .collect();
        let counted = samples.iter().filter(|sample| kind.counts(sample.time_s));
        Self {
            experiment: kind.name(),
            seed,
            samples: counted.count() as u64,
            estimators,
            met: missed.is_empty(),
            missed,
        }
    }

    /// Errors for people, a line for each estimator.
    pub fn text(&self) -> String {
        match self.parts() {
            parts if parts.is_empty() => self.errors().text(),
            parts => parts.text(),
        }
    }

    /// RMSE of the tilt in each part, and after an acceleration the time until it was recovered;
    /// empty for an experiment without parts.
    pub fn parts(&self) -> Table {
        let mut head = vec!["tilt RMSE, deg".to_owned()];
        head.extend(self.estimators.iter().map(|row| row.name.to_owned()));
        let cell = |errors: &PartErrors| {
            let recovered = errors.recovered_s;
            let recovered = recovered.map(|s| format!(", {s:.1} s"));
            format!(
                "{:.2}{}",
                errors.tilt_rmse_deg,
                recovered.unwrap_or_default()
            )
        };
        let first = self.estimators.first();
        let parts = first.into_iter().flat_map(|row| &row.parts).enumerate();
        let rows: Vec<Vec<String>> = parts
            .map(|(index, part)| {
                let errors = self.estimators.iter().map(|row| row.parts.get(index));
                let cells = errors.map(|errors| errors.map_or(String::new(), cell));
                std::iter::once(part.part.clone()).chain(cells).collect()
            })
            .collect();
        Table::new(head, rows).right_aligned()
    }

    /// Errors: mean, standard deviation and RMSE of each axis, and combined.
    pub fn errors(&self) -> Table {
        let row = |row: &Row| {
            let mut cells = vec![row.name.to_owned()];
            for axis in row.axes() {
                cells.extend([axis.mean_deg, axis.std_deg, axis.rmse_deg].map(figure));
            }
            cells.push(figure(row.combined_rmse_deg));
            cells.push(
                row.thesis
                    .map_or(String::new(), |thesis| figure(thesis.combined_rmse_deg)),
            );
            cells
        };
        Table::new(ERROR_COLUMNS, self.estimators.iter().map(row)).right_aligned()
    }

    /// Mean and deviation of the estimates as in the thesis' tables 6.1 and 6.2, below each the
    /// thesis' own row where there is one.
    pub fn signals(&self) -> Table {
        let mut rows = Vec::new();
        for row in &self.estimators {
            let mut line = |name: String, mean: Angles, std: Angles| {
                let mut cells = vec![name];
                for (mean, std) in mean.into_iter().zip(std) {
                    cells.extend([figure(mean), figure(std)]);
                }
                rows.push(cells);
            };
            let axes = row.axes();
            line(
                row.name.to_owned(),
                axes.map(|axis| axis.signal_mean_deg),
                axes.map(|axis| axis.signal_std_deg),
            );
            if let Some(thesis) = &row.thesis {
                line(
                    "as published".to_owned(),
                    thesis.signal_mean_deg,
                    thesis.signal_std_deg,
                );
            }
        }
        Table::new(SIGNAL_COLUMNS, rows)
    }
}

/// Columns of [`Figures::errors`].
const ERROR_COLUMNS: [&str; 12] = [
    "error, deg",
    "roll mean",
    "std",
    "RMSE",
    "pitch mean",
    "std",
    "RMSE",
    "yaw mean",
    "std",
    "RMSE",
    "combined RMSE",
    "thesis",
];

/// Columns of [`Figures::signals`].
const SIGNAL_COLUMNS: [&str; 7] = [
    "estimate, deg",
    "roll mean",
    "std",
    "pitch mean",
    "std",
    "yaw mean",
    "std",
];

fn figure(value: f64) -> String {
    format!("{value:.3}")
}

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
            let deviation = [
                row.signal_mean_deg[0],
                row.signal_mean_deg[1],
                row.signal_mean_deg[2] - 200.0,
            ];
            let sum: f64 = deviation.iter().map(|d| d * d).sum::<f64>()
                + row.signal_std_deg.iter().map(|s| s * s).sum::<f64>();
            let combined = row.combined_rmse_deg;
            assert!(
                (sum.sqrt() - combined).abs() < 0.02,
                "{row:?}: {}",
                sum.sqrt()
            );
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
        let row = Row {
            name: "Mahony",
            required: true,
            roll: axis(0.0, 0.1),
            pitch: axis(1.6, 0.1),
            yaw: axis(0.0, 0.3),
            combined_rmse_deg: 1.64,
            thesis: None,
            parts: Vec::new(),
        };
        assert_eq!(
            row.missed(Kind::Static),
            [
                "Mahony: mean pitch 1.600 deg, at most 1.5 deg",
                "Mahony: combined RMSE 1.640 deg, at most 0.4 deg"
            ]
        );
        assert!(row.missed(Kind::Motion)[1].contains("RMSE pitch 1.603"));
    }
}
