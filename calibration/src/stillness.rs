//! The stretches of a recording in which the sensor lay still.

use std::ops::Range;

use nalgebra::Vector3;

use crate::{Sample, spread};

/// Length of the windows that are judged, s.
const WINDOW_S: f64 = 0.2;
/// A window is still up to these limits: standard deviation of rate (rad/s) and force (m/s2), mean
/// rate (rad/s), which may be all bias, and change of the mean force since the window before
/// (m/s2).
const RATE_NOISE: f64 = 0.012;
const ACC_NOISE: f64 = 0.15;
const RATE: f64 = 0.105;
const ACC_STEP: f64 = 0.1;

/// The stretches of rest of at least `least_s`, as ranges of indices. Their first and last window
/// are left out: the hand may have touched the sensor in them.
pub fn find(samples: &[Sample], least_s: f64) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut current: Option<(Range<usize>, Vector3<f64>)> = None;
    for window in windows(samples) {
        let force = still(&samples[window.clone()]);
        current = match (current, force) {
            (Some((range, before)), Some(force)) if (force - before).norm() <= ACC_STEP => {
                Some((range.start..window.end, force))
            }
            (ended, force) => {
                found.extend(ended.map(|(range, _)| range));
                force.map(|force| (window, force))
            }
        };
    }
    found.extend(current.map(|(range, _)| range));
    found
        .into_iter()
        .filter_map(|range| inner(samples, range))
        .filter(|range| length_s(&samples[range.clone()]) >= least_s)
        .collect()
}

/// Mean force of each rest.
pub fn forces(samples: &[Sample], rests: &[Range<usize>]) -> Vec<Vector3<f64>> {
    let force = |range: &Range<usize>| spread(samples[range.clone()].iter().map(|m| &m.acc));
    let forces = rests.iter().filter_map(force);
    forces.map(|(mean, _)| mean).collect()
}

/// Whether the sensor lies still.
pub fn is_still(samples: &[Sample]) -> bool {
    still(samples).is_some()
}

/// Length of a stretch, s.
pub fn length_s(samples: &[Sample]) -> f64 {
    match samples {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    }
}

/// Ranges of [`WINDOW_S`] each.
fn windows(samples: &[Sample]) -> Vec<Range<usize>> {
    let (mut windows, mut start) = (Vec::new(), 0);
    for (index, sample) in samples.iter().enumerate() {
        if sample.time_s - samples[start].time_s >= WINDOW_S {
            windows.push(start..index);
            start = index;
        }
    }
    windows
}

/// Mean force of a window that is still.
fn still(window: &[Sample]) -> Option<Vector3<f64>> {
    let (rate, rate_noise) = spread(window.iter().map(|m| &m.gyr))?;
    let (force, force_noise) = spread(window.iter().map(|m| &m.acc))?;
    let quiet =
        rate_noise.amax() <= RATE_NOISE && force_noise.amax() <= ACC_NOISE && rate.amax() <= RATE;
    quiet.then_some(force)
}

fn inner(samples: &[Sample], range: Range<usize>) -> Option<Range<usize>> {
    let (from, to) =
        (samples[range.start].time_s + WINDOW_S, samples[range.end - 1].time_s - WINDOW_S);
    let start = samples.partition_point(|m| m.time_s < from);
    let end = samples.partition_point(|m| m.time_s <= to);
    (end > start).then_some(start..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rests_are_found_between_turns() {
        let samples: Vec<Sample> = (0..1000)
            .map(|i| {
                let time_s = f64::from(i) * 0.01;
                let turning = (300..500).contains(&i);
                Sample {
                    time_s,
                    gyr: Vector3::new(if turning { 0.5 } else { 0.02 }, 0.0, 0.0),
                    acc: Vector3::new(0.0, 0.0, if i < 400 { -9.8 } else { 9.8 }),
                    mag: Vector3::zeros(),
                }
            })
            .collect();
        let rests = find(&samples, 1.0);
        assert_eq!(rests.len(), 2, "{rests:?}");
        assert!(rests[0].start >= 19 && rests[0].end <= 300);
        assert!(rests[1].start >= 500 && length_s(&samples[rests[1].clone()]) > 4.0);
        assert!(find(&samples, 6.0).is_empty());
    }
}
