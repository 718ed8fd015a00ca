//! `tvc fuse`: any filter on any recording, estimates to a file, errors against the reference.

mod figures;
mod options;
mod place;

use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result};
use recordings::{Choice, Estimate, Scorer, Source, enu_from_ned};

use super::progress::Progress;
use crate::out::exit::{BadInput, Verdict};
use crate::out::file::{WholeFile, print, print_json};
use figures::{Figures, FileFigures};
pub use options::Fuse;

/// Samples between two reports of progress.
const STRIDE: u64 = 4096;

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
        let estimate = Estimate::new(&choice, source.facts())
            .map_err(|why| BadInput::new(format!("{}: {why}", source.name())))?;
        bytes += source.bytes();
        jobs.push((source, estimate, place));
    }

    let mut progress = Progress::new(bytes);
    let mut figures = Figures::new(&choice);
    let mut written = Vec::new();
    for (mut source, mut estimate, place) in jobs {
        let mut out = place.as_deref().map(WholeFile::create).transpose()?;
        let file = fuse(&mut source, &mut estimate, out.as_mut(), &mut progress)?;
        progress.part_done(source.bytes());
        figures.add(options.mode, file.at(source.name(), place.as_deref()));
        written.extend(out);
    }
    progress.end();
    written.into_iter().try_for_each(WholeFile::keep)?;

    for note in figures.notes(options.mode, options.score || options.json) {
        eprintln!("{note}");
    }
    if options.json {
        print_json(&figures)?;
    } else if options.score {
        print(figures.text())?;
    }
    for path in figures.written() {
        eprintln!("estimates: {path}");
    }
    Ok(Verdict::Met)
}

/// What was counted and scored in a recording.
struct Outcome {
    samples: u64,
    magnetometer_samples: u64,
    scorer: Scorer,
}

impl Outcome {
    fn at(&self, name: &str, place: Option<&Path>) -> FileFigures {
        FileFigures {
            file: name.to_owned(),
            out: place.map(|path| path.display().to_string()),
            samples: self.samples,
            magnetometer_samples: self.magnetometer_samples,
            score: self.scorer.score().map(Into::into),
        }
    }
}

fn fuse(
    source: &mut Source,
    estimate: &mut Estimate,
    mut out: Option<&mut WholeFile>,
    progress: &mut Progress,
) -> Result<Outcome> {
    let mut outcome = Outcome {
        samples: 0,
        magnetometer_samples: 0,
        scorer: Scorer::default(),
    };
    let writing = "writing the estimates";
    if let Some(out) = &mut out {
        writeln!(out, "t,w,x,y,z").context(writing)?;
    }
    while let Some(sample) = source.next_sample().map_err(BadInput::new)? {
        let ned = estimate.update(&sample);
        if let Some(out) = &mut out {
            line(out, sample.time_s, enu_from_ned(ned)).context(writing)?;
        }
        if let Some(reference) = sample.reference
            && sample.movement
        {
            outcome.scorer.add(ned, reference);
        }
        outcome.magnetometer_samples += u64::from(sample.mag_ut.is_some());
        outcome.samples += 1;
        if outcome.samples.is_multiple_of(STRIDE) {
            progress.at(source.name(), source.bytes_read());
        }
    }
    Ok(outcome)
}

fn line(out: &mut impl Write, time_s: f64, [w, x, y, z]: [f64; 4]) -> io::Result<()> {
    writeln!(out, "{time_s},{w:.9},{x:.9},{y:.9},{z:.9}")
}
