//! Recordings of a sensor, and tables.

use std::path::Path;

use recordings::{Choice, Estimate, FilterName, Mode, Recording, Scalar, Scorer, Source, smooth};
use tvc_nano::Axis;

use super::{Outcome, expect, usable, with_file};
use ::report::campaign::merge;
use design::{identify, montecarlo};
use ground::vehicle::calibrate::readings;
use lab::faults::{self, report, summary, table};

/// A table for `tvc identify` and `tvc calibrate --from`.
pub fn table(bytes: &[u8], _: u64) -> Outcome {
    with_file(bytes, "csv", as_table)
}

/// As [`table`], of a file.
pub fn as_table(path: &Path) -> Outcome {
    usable(identify::read(path, None, Axis::Pitch))?;
    usable(readings::read(path)).map(drop)
}

/// A recording of either form, through a filter, offline, and its scores.
pub fn recording(bytes: &[u8], number: u64) -> Outcome {
    let _ = Recording::parse("input", bytes);
    with_file(bytes, "imuq", |path| fused(path, number))
}

fn fused(path: &Path, number: u64) -> Outcome {
    let Ok(mut source) = Source::open(path) else {
        return Ok(());
    };
    let kinds = [Scalar::F32, Scalar::F64, Scalar::Fixed];
    let (kind, filter) = (number as usize % 3, number as usize / 3 % FilterName::ALL.len());
    let choice = Choice {
        filter: FilterName::ALL[filter],
        scalar: kinds[kind],
        mode: if number.is_multiple_of(2) { Mode::NineD } else { Mode::SixD },
        settings: Vec::new(),
    };
    let Ok(mut estimate) = Estimate::new(&choice, source.facts()) else {
        return Ok(());
    };
    let (mut scorer, mut samples) = (Scorer::default(), Vec::new());
    while let Ok(Some(sample)) = source.next_sample() {
        let ned = estimate.update(&sample);
        let norm = ned.iter().map(|c| c * c).sum::<f64>();
        expect((norm - 1.0).abs() < 1e-3, "an estimate that is no rotation")?;
        if let Some(reference) = sample.reference {
            scorer.add(ned, reference);
        }
        samples.push(sample);
    }
    let _ = scorer.score();
    let _ = smooth(&choice, source.facts(), &samples);
    Ok(())
}

/// The table of a campaign of faults, as `lab faults merge` reads it, with its page.
pub fn faults(bytes: &[u8], _: u64) -> Outcome {
    let merged = |path: &Path| {
        let rows: Vec<table::Row> = merge(&[path])?;
        report::render(&summary::figures(&rows, None), &rows)
    };
    with_file(bytes, "csv", |path| usable(merged(path)).map(drop))
}

/// A run of such a campaign, as `lab faults rerun` reads it.
pub fn faults_run(bytes: &[u8], _: u64) -> Outcome {
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = faults::Scenario::parse(text);
    }
    Ok(())
}

/// The table of a campaign, as `tvc montecarlo merge` reads it; some with their pages.
pub fn campaign(bytes: &[u8], number: u64) -> Outcome {
    let merge = |path: &Path| -> anyhow::Result<()> {
        let rows: Vec<montecarlo::table::Row> = merge(&[path])?;
        let worst = montecarlo::summary::Worst::of(&rows, 5);
        let figures = montecarlo::summary::figures(&rows, &worst, None);
        if number % 16 == 1 {
            montecarlo::report::render(&figures, &rows)?;
        }
        Ok(())
    };
    with_file(bytes, "csv", |path| usable(merge(path)).map(drop))
}
