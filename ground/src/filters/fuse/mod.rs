//! `tvc fuse`: any filter on any recording, estimates to a file, errors against the reference.

mod figures;
mod options;
mod place;

use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result};
use recordings::{
    Choice, ChoiceError, Estimate, RecordedSample, Scorer, Source, enu_from_ned, smooth,
};

use figures::{Recording, figures, notes};
pub use options::Fuse;
use report::exit::{BadInput, Verdict};
use report::file::WholeFile;
use report::progress::Progress;

/// Samples between two reports of progress.
const STRIDE: u64 = 4096;

/// What fails when an estimate cannot be written.
const WRITING: &str = "writing the estimates";

/// Runs the filter on every recording; no file is written unless all of them can be read to the
/// end.
///
/// # Errors
/// A recording or a setting is unusable, or an estimate cannot be written.
pub fn run(options: &Fuse) -> Result<Verdict> {
    let choice = Choice {
        filter: options.filter,
        scalar: options.scalar,
        mode: options.mode,
        settings: options.settings.clone(),
    };
    // Errors in the command and at the beginning of a file are found before the work begins.
    let places = place::places(&options.files, options.out.as_deref())?;
    let mut jobs = Vec::new();
    let mut bytes = 0;
    for (file, place) in options.files.iter().zip(places) {
        let source = Source::open(file).map_err(BadInput::new)?;
        let unfit = |why: ChoiceError| BadInput::new(format!("{}: {why}", source.name()));
        let estimator = if options.offline {
            // What is wrong with the choice shows without a sample.
            smooth(&choice, source.facts(), &[]).map_err(unfit)?;
            Estimator::Offline(&choice)
        } else {
            Estimator::Live(Estimate::new(&choice, source.facts()).map_err(unfit)?)
        };
        bytes += source.bytes();
        jobs.push((source, estimator, place));
    }

    let mut progress = Progress::new(bytes);
    let (mut recordings, mut written) = (Vec::new(), Vec::new());
    for (mut source, estimator, place) in jobs {
        let out = place.as_deref().map(WholeFile::create).transpose()?;
        let outcome = estimator.run(&mut source, Outcome::new(out)?, &mut progress)?;
        progress.part_done(source.bytes());
        recordings.push(outcome.at(source.name(), place.as_deref()));
        written.extend(outcome.out);
    }
    progress.end();
    written.into_iter().try_for_each(WholeFile::keep)?;

    let scored = options.score || options.json;
    for note in notes(options.mode, scored, &recordings) {
        eprintln!("{note}");
    }
    if scored {
        figures(&choice, options.offline, &recordings).conclude(options.json, None)?;
    }
    for path in recordings.iter().filter_map(|recording| recording.out.as_ref()) {
        eprintln!("estimates: {path}");
    }
    Ok(Verdict::Met)
}

/// What turns samples into estimates.
enum Estimator<'a> {
    /// Sample by sample.
    Live(Estimate),
    /// All of them at once.
    Offline(&'a Choice),
}

impl Estimator<'_> {
    fn run(
        self,
        source: &mut Source,
        mut outcome: Outcome,
        progress: &mut Progress,
    ) -> Result<Outcome> {
        let mut read = 0u64;
        let mut next = |source: &mut Source| {
            read += 1;
            if read.is_multiple_of(STRIDE) {
                progress.at(source.name(), source.bytes_read());
            }
            source.next_sample().map_err(BadInput::new)
        };
        match self {
            Self::Live(mut estimate) => {
                while let Some(sample) = next(source)? {
                    outcome.add(&sample, estimate.update(&sample))?;
                }
            }
            Self::Offline(choice) => {
                let mut samples = Vec::new();
                while let Some(sample) = next(source)? {
                    samples.push(sample);
                }
                let estimates = smooth(choice, source.facts(), &samples)
                    .map_err(|why| BadInput::new(format!("{}: {why}", source.name())))?;
                for (sample, ned) in samples.iter().zip(estimates) {
                    outcome.add(sample, ned)?;
                }
            }
        }
        Ok(outcome)
    }
}

/// What was counted, scored and written of a recording.
struct Outcome {
    samples: u64,
    magnetometer_samples: u64,
    scorer: Scorer,
    out: Option<WholeFile>,
}

impl Outcome {
    /// Nothing yet; estimates go into a file that is given.
    fn new(mut out: Option<WholeFile>) -> Result<Self> {
        if let Some(out) = &mut out {
            writeln!(out, "t,w,x,y,z").context(WRITING)?;
        }
        Ok(Self { samples: 0, magnetometer_samples: 0, scorer: Scorer::default(), out })
    }

    fn add(&mut self, sample: &RecordedSample, ned: [f64; 4]) -> Result<()> {
        if let Some(out) = &mut self.out {
            line(out, sample.time_s, enu_from_ned(ned)).context(WRITING)?;
        }
        if let Some(reference) = sample.reference
            && sample.movement
        {
            self.scorer.add(ned, reference);
        }
        self.magnetometer_samples += u64::from(sample.mag_ut.is_some());
        self.samples += 1;
        Ok(())
    }

    fn at(&self, name: &str, place: Option<&Path>) -> Recording {
        Recording {
            file: name.to_owned(),
            out: place.map(|path| path.display().to_string()),
            samples: self.samples,
            magnetometer_samples: self.magnetometer_samples,
            score: self.scorer.score(),
        }
    }
}

fn line(out: &mut impl Write, time_s: f64, [w, x, y, z]: [f64; 4]) -> io::Result<()> {
    writeln!(out, "{time_s},{w:.9},{x:.9},{y:.9},{z:.9}")
}
