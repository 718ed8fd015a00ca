//! `tvc fuse`: any filter on any recording, estimates to a file, errors against the reference.

mod figures;
mod options;
mod place;

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use recordings::{Choice, Estimate, RecordedSample, Scorer, Source, enu_from_ned, smooth};

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
        let unfit = |why: String| BadInput::new(format!("{}: {why}", source.name()));
        let live = match options.offline {
            // What is wrong with the choice shows without a sample.
            true => smooth(&choice, source.facts(), &[]).map(|_| None),
            false => Estimate::new(&choice, source.facts()).map(Some),
        };
        let live = live.map_err(unfit)?;
        bytes += source.bytes();
        jobs.push((source, live, place));
    }

    let mut progress = Progress::new(bytes);
    let (mut recordings, mut written) = (Vec::new(), Vec::new());
    for (mut source, live, place) in jobs {
        let mut outcome = Outcome::new(source.name(), place.as_deref())?;
        outcome.run(&mut source, live, &choice, &mut progress)?;
        progress.part_done(source.bytes());
        recordings.push(outcome.recording);
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

/// What was counted, scored and written of a recording.
struct Outcome {
    recording: Recording,
    scorer: Scorer,
    out: Option<WholeFile>,
}

impl Outcome {
    /// Nothing yet of the recording of this name; estimates go to a place that is given.
    fn new(name: &str, place: Option<&Path>) -> Result<Self> {
        let mut out = place.map(WholeFile::create).transpose()?;
        if let Some(out) = &mut out {
            writeln!(out, "t,w,x,y,z").context(WRITING)?;
        }
        let place = place.map(|path| path.display().to_string());
        let recording = Recording { file: name.to_owned(), out: place, ..Recording::default() };
        Ok(Self { recording, scorer: Scorer::default(), out })
    }

    /// Estimates at every sample of `source`: at once by the filter that is `live`, or else by that
    /// of `choice` when all samples are known.
    fn run(
        &mut self,
        source: &mut Source,
        mut live: Option<Estimate>,
        choice: &Choice,
        progress: &mut Progress,
    ) -> Result<()> {
        let (mut read, mut samples) = (0u64, Vec::new());
        while let Some(sample) = source.next_sample().map_err(BadInput::new)? {
            read += 1;
            if read.is_multiple_of(STRIDE) {
                progress.at(source.name(), source.bytes_read());
            }
            match &mut live {
                Some(estimate) => self.add(&sample, estimate.update(&sample))?,
                None => samples.push(sample),
            }
        }
        if live.is_none() {
            let estimates = smooth(choice, source.facts(), &samples)
                .map_err(|why| BadInput::new(format!("{}: {why}", source.name())))?;
            for (sample, ned) in samples.iter().zip(estimates) {
                self.add(sample, ned)?;
            }
        }
        self.recording.score = self.scorer.score();
        Ok(())
    }

    fn add(&mut self, sample: &RecordedSample, ned: [f64; 4]) -> Result<()> {
        if let Some(out) = &mut self.out {
            let (time_s, [w, x, y, z]) = (sample.time_s, enu_from_ned(ned));
            writeln!(out, "{time_s},{w:.9},{x:.9},{y:.9},{z:.9}").context(WRITING)?;
        }
        if let Some(reference) = sample.reference
            && sample.movement
        {
            self.scorer.add(ned, reference);
        }
        self.recording.magnetometer_samples += u64::from(sample.mag_ut.is_some());
        self.recording.samples += 1;
        Ok(())
    }
}
