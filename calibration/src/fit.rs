//! The fits, one after another: each uses what the one before has found.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use crate::alignment::{self, Turn};
use crate::ellipsoid::{self, Ellipsoid};
use crate::per_g::{self, PerG, Pose};
use crate::poses::{self, Poses};
use crate::rest::{self, LEAST_S, Rest};
use crate::{AXES, Correction, Readings, Sample, Sensor, level, spread, stillness};

/// Shortest rest that counts as a pose, s.
const POSE_S: f64 = 1.0;
/// A sample measures the direction of gravity if its strength is within this share of gravity.
const QUASI_STATIC: f64 = 0.04;
/// Fewest such samples with a new field for the rotation of the soft iron.
const FEWEST_PAIRS: usize = 200;
/// Time between the ends of a turn, s, and its least angle, rad.
const TURN_S: f64 = 0.2;
const LEAST_TURN: f64 = 0.05;
/// Fewest turns for a verdict on polarity.
const FEWEST_TURNS: usize = 30;

/// What to calibrate, and what is known of the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Only these; all if there are none.
    pub only: Vec<Sensor>,
    /// Gravity where it was recorded, m/s2.
    pub gravity: f64,
    /// A time at which the body was at rest and level, s since the first sample; otherwise it was
    /// after [`Readings::level_from_s`].
    pub level_s: Option<f64>,
}

impl Wanted {
    /// Whether this is to be calibrated.
    pub fn has(&self, sensor: Sensor) -> bool {
        self.only.is_empty() || self.only.contains(&sensor)
    }
}

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// The rest that gave the gyroscope's bias.
    pub rest: Option<Rest>,
    /// The accelerometer's poses.
    pub poses: Option<Poses>,
    /// How acceleration shifts the gyroscope's offset.
    pub per_g: Option<PerG>,
    /// The magnetometer's ellipsoid, turned by gravity.
    pub ellipsoid: Option<Ellipsoid>,
    /// Dip of the corrected field and its deviation, rad.
    pub dip: Option<(f64, f64)>,
    /// What the gyroscope must be multiplied with by gravity, and by the field.
    pub by_gravity: Option<Matrix3<f64>>,
    /// See `by_gravity`.
    pub by_field: Option<Matrix3<f64>>,
    /// Roll and pitch of the mount, rad.
    pub mount: Option<(f64, f64)>,
    /// Why something could not be calibrated.
    pub refused: Vec<String>,
}

impl Found {
    /// What a fit has found; otherwise keeps why not.
    fn or_refused<T>(&mut self, fitted: Result<T, String>) -> Option<T> {
        fitted.map_err(|why| self.refused.push(why)).ok()
    }

    /// Correction of the gyroscope.
    pub fn gyr(&self) -> Correction {
        let offset = self.rest.map_or(Vector3::zeros(), |rest| rest.bias);
        Correction { offset, ..Correction::NONE }
    }

    /// Correction of the accelerometer.
    pub fn acc(&self) -> Correction {
        self.poses.map_or(Correction::NONE, |poses| poses.correction)
    }

    /// Correction of the magnetometer.
    pub fn mag(&self) -> Correction {
        self.ellipsoid.map_or(Correction::NONE, |ellipsoid| ellipsoid.correction)
    }
}

/// Calibrates what is wanted, as far as the readings allow it; [`Found::refused`] says what they do
/// not.
pub fn fit(readings: &Readings, wanted: &Wanted) -> Found {
    let mut found = Found::default();
    let samples = &readings.samples;
    let rests = stillness::find(samples, POSE_S);
    // Without the bias the other sensors can still be calibrated, and all refusals be said at once.
    match tombstone(samples) {
        Ok(rest) => found.rest = Some(rest),
        Err(why) if wanted.has(Sensor::Gyr) => found.refused.push(why.to_string()),
        Err(_) => {}
    }
    if wanted.has(Sensor::Acc) {
        let poses = poses::fit(&stillness::forces(samples, &rests), wanted.gravity);
        found.poses = found.or_refused(poses);
        let acc = found.acc();
        let pose = |range: &Range<usize>| {
            let samples = &samples[range.clone()];
            Some(Pose {
                force: acc.apply(&spread(samples.iter().map(|m| &m.acc))?.0) / wanted.gravity,
                rate: spread(samples.iter().map(|m| &m.gyr))?.0,
                seconds: stillness::length_s(samples),
            })
        };
        let rests: Vec<Pose> = rests.iter().filter_map(pose).collect();
        found.per_g = found.poses.and_then(|_| per_g::fit(&rests));
    }
    if wanted.has(Sensor::Mag) {
        found.ellipsoid = found.or_refused(ellipsoid::fit(&readings.fields()));
    }
    turn_by_gravity(&mut found, readings, wanted.gravity);
    check_polarity(&mut found, readings, wanted.gravity);
    if let Some(level) = level_rest(readings, &rests, wanted) {
        let force = found.or_refused(level);
        found.mount = force.map(|force| level::mount(&found.acc().apply(&force)));
    }
    found
}

/// The force with the body level: in the rest that is named, or in the last one after a person was
/// asked to stand it level. `None` if it is not wanted.
fn level_rest(
    readings: &Readings,
    rests: &[Range<usize>],
    wanted: &Wanted,
) -> Option<Result<Vector3<f64>, String>> {
    let samples = &readings.samples;
    let asked_s = readings.level_from_s.filter(|_| wanted.has(Sensor::Level));
    let (range, why) = match (wanted.level_s, asked_s) {
        (Some(at_s), _) => (
            rests.iter().find(|range| {
                samples[range.start].time_s <= at_s && at_s <= samples[range.end - 1].time_s
            }),
            format!(
                "the sensor was not at rest at {at_s} s: --level needs the time of a rest of {POSE_S} s"
            ),
        ),
        (None, Some(from_s)) => (
            rests.iter().rfind(|range| samples[range.start].time_s >= from_s),
            "the body did not rest when it was to stand level".to_owned(),
        ),
        (None, None) => return None,
    };
    let force = range.and_then(|range| spread(samples[range.clone()].iter().map(|m| &m.acc)));
    Some(force.map(|(mean, _)| mean).ok_or(why))
}

/// The bias out of the longest rest; where there is none, the reason in the recording's beginning.
fn tombstone(samples: &[Sample]) -> Result<Rest, rest::RestError> {
    let rests = stillness::find(samples, 0.0).into_iter().map(|range| &samples[range]);
    let longest = rests.max_by(|a, b| stillness::length_s(a).total_cmp(&stillness::length_s(b)));
    let short = rest::bias(longest.unwrap_or_default());
    if let Err(rest::RestError::Short(_)) = short {
        let until = samples.partition_point(|m| m.time_s <= 2.0 * LEAST_S);
        if let Err(motion @ rest::RestError::Motion(_)) = rest::bias(&samples[..until]) {
            return Err(motion);
        }
    }
    short
}

/// Adds the rotation that the ellipsoid alone does not show, where gravity and field determine it.
fn turn_by_gravity(found: &mut Found, readings: &Readings, gravity: f64) {
    let Some(mut ellipsoid) = found.ellipsoid else {
        return;
    };
    let acc = found.acc();
    let pairs: Vec<_> = readings
        .fresh
        .iter()
        .map(|i| &readings.samples[*i])
        .map(|m| (acc.apply(&m.acc), ellipsoid.correction.apply(&m.mag)))
        .filter(|(up, _)| (up.norm() / gravity - 1.0).abs() <= QUASI_STATIC)
        .collect();
    if pairs.len() < FEWEST_PAIRS {
        return;
    }
    // An accelerometer reads the force that holds it up.
    if let Some((correction, dip, deviation)) =
        ellipsoid::align(&ellipsoid.correction, pairs.iter())
    {
        ellipsoid.correction = correction;
        found.ellipsoid = Some(ellipsoid);
        found.dip = Some((dip, deviation));
    }
}

fn check_polarity(found: &mut Found, readings: &Readings, gravity: f64) {
    let (gyr, acc, mag) = (found.gyr(), found.acc(), found.mag());
    let all: Vec<usize> = (0..readings.samples.len()).collect();
    let static_force = |m: &Sample| {
        let force = acc.apply(&m.acc);
        ((force.norm() / gravity - 1.0).abs() <= QUASI_STATIC).then(|| force.normalize())
    };
    found.by_gravity = polarity(&turns(&readings.samples, &all, &gyr, static_force));
    if found.ellipsoid.is_some() {
        let field = |m: &Sample| Some(mag.apply(&m.mag).normalize());
        found.by_field = polarity(&turns(&readings.samples, &readings.fresh, &gyr, field));
    }
    for (what, matrix) in [("accelerometer", found.by_gravity), ("magnetometer", found.by_field)] {
        if let Some(matrix) = matrix.filter(|matrix| !alignment::agrees(matrix)) {
            found.refused.push(format!(
                "gyroscope and {what} disagree about the axes: {}; check the axis map",
                disagreement(&matrix)
            ));
        }
    }
}

/// The worst axis, in words.
fn disagreement(matrix: &Matrix3<f64>) -> String {
    let (axis, _) = (matrix - Matrix3::identity()).iamax_full();
    let row = matrix.row(axis);
    format!(
        "a turn about {} is read as {:+.1} x {:+.1} y {:+.1} z",
        AXES[axis], row[0], row[1], row[2]
    )
}

fn polarity(turns: &[Turn]) -> Option<Matrix3<f64>> {
    if turns.len() < FEWEST_TURNS {
        return None;
    }
    alignment::gyro_by(turns.iter().copied())
}

/// Turns of a direction that stands still in the world, between samples of `indices`.
fn turns(
    samples: &[Sample],
    indices: &[usize],
    gyr: &Correction,
    direction: impl Fn(&Sample) -> Option<Vector3<f64>>,
) -> Vec<Turn> {
    let mut turns = Vec::new();
    let mut start = 0;
    for (at, index) in indices.iter().enumerate() {
        let (from, to) = (indices[start], *index);
        if samples[to].time_s - samples[from].time_s < TURN_S {
            continue;
        }
        start = at;
        let angle: Vector3<f64> = samples[from..=to]
            .windows(2)
            .map(|pair| {
                let rate = (gyr.apply(&pair[0].gyr) + gyr.apply(&pair[1].gyr)) / 2.0;
                rate * (pair[1].time_s - pair[0].time_s)
            })
            .sum();
        let (Some(before), Some(after)) = (direction(&samples[from]), direction(&samples[to]))
        else {
            continue;
        };
        if angle.norm() >= LEAST_TURN {
            turns.push(Turn { before, after, angle });
        }
    }
    turns
}
