//! Runs a filter over a whole recording, in both directions of time.

use tvc_fusion::offline::{self, TimedSample};
use tvc_fusion::{Filter, Quaternion};

use crate::estimate::{by_name, config, double, refused, sample};
use crate::score::unit;
use crate::settings::Gains;
use crate::{Choice, Facts, FilterName, Mode, RecordedSample, Scalar, Setting};

/// The orientations at all samples, sensor to north-east-down, `[w, x, y, z]`, of unit length, by a
/// filter that knows what comes later.
///
/// The VQF class has gains of its own here (`preset=offline`), unless another preset is chosen.
///
/// # Errors
/// A setting that is not there or out of range; fixed point.
pub fn smooth(
    choice: &Choice,
    facts: &Facts,
    samples: &[RecordedSample],
) -> Result<Vec<[f64; 4]>, String> {
    let mut choice = choice.clone();
    if choice.filter == FilterName::Vqf {
        // A preset that is chosen stands behind it, and counts.
        let preset = Setting { key: "preset".to_owned(), value: "offline".to_owned() };
        choice.settings.insert(0, preset);
    }
    match choice.scalar {
        Scalar::F32 => by_name!(choice.filter, f32, run(&choice, facts, samples)),
        Scalar::F64 => by_name!(choice.filter, f64, run(&choice, facts, samples)),
        Scalar::Fixed => Err("fixed point does not run offline: choose f32 or f64".to_owned()),
    }
}

fn run<F: Filter<Gains: Gains>>(
    choice: &Choice,
    facts: &Facts,
    samples: &[RecordedSample],
) -> Result<Vec<[f64; 4]>, String> {
    let config = config::<F::Gains>(choice, facts)?;
    let mut last_s = None;
    let timed: Vec<_> = samples
        .iter()
        .map(|recorded| {
            let last_s = last_s.replace(recorded.time_s);
            let dt_s = last_s.map_or(facts.period_s, |last_s| recorded.time_s - last_s);
            let mag_ut = recorded.mag_ut.filter(|_| choice.mode == Mode::NineD);
            TimedSample { dt_s: dt_s as f32, sample: sample(recorded, mag_ut) }
        })
        .collect();
    let attitudes =
        offline::smooth::<F>(&config, &timed).map_err(|error| refused(choice, error))?;
    let wxyz = |Quaternion { w, x, y, z }: Quaternion<F::Real>| [w, x, y, z].map(double);
    Ok(attitudes.into_iter().map(|attitude| unit(wxyz(attitude.orientation))).collect())
}
