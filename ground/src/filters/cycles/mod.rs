//! `tvc cycles`: what one update of a filter costs on the chip, beside filters of other libraries.
//!
//! The package `cycles` makes two images of every filter, in one build profile: one that sets the
//! filter up, which is run, and one that holds the update alone, whose size is measured.

mod bench;
mod candidates;
mod figures;
mod inputs;

use std::collections::BTreeSet;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::thread;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use recordings::{Recording, Scalar};
use rig::Image;
use rig::image::{Builder, Source};

use crate::out::exit::{BadInput, Verdict};
use crate::out::file::{print, print_json};
use bench::Bench;
use candidates::Candidate;
use clap::{Args, ValueEnum};
use figures::{Figures, Report};
use inputs::{Hard, Sample};

/// Options of `tvc cycles`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc cycles                         every filter, beside the crates of the field
  cargo tvc cycles --filter mahony         those with mahony in their name only: quicker
  cargo tvc cycles --library tvc-fusion    this project's own only
  cargo tvc cycles --markdown              the table for a README
  cargo tvc cycles --json > cycles.json    figures for a script, nothing else on standard output

What is measured, on an emulated Cortex-M0+ at exact instruction timing, of one update from a sample
in memory to an orientation in memory:
  mean       over a recording of real sensors with a magnetometer sample each time, start-up included
  max        over that and over hard inputs: clipped, free fall, no field, random, gaps in time
  1ws        the same with one flash wait state
  code       flash of the update and all it calls, constants included: an image that holds nothing
             else, less one whose update is empty
  RAM        the filter's state
  stack      depth from the call, measured by painting

Exit status: 0 measured, 1 something failed, 2 unusable input.")]
pub struct Cycles {
    /// Only filters with this in their name; may be given more than once.
    #[arg(long, value_name = "NAME")]
    pub filter: Vec<String>,

    /// Only filters of this library; may be given more than once.
    #[arg(long, value_name = "CRATE")]
    pub library: Vec<String>,

    /// What the compiler optimises for, in all images alike.
    #[arg(long, value_enum, default_value_t = Optimise::Speed)]
    pub optimise: Optimise,

    /// Print the table as Markdown.
    #[arg(long, conflicts_with = "json")]
    pub markdown: bool,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// What the compiler optimises for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Optimise {
    /// Opt-level 3.
    Speed,
    /// Opt-level s, as the firmware.
    Size,
}

/// Samples of each sort of hard input. Fixed point has more of them: it runs faster, and it has a
/// limit of cycles to keep.
const HARD_SAMPLES: usize = 32;
const HARD_SAMPLES_FIXED: usize = 512;

/// Largest angle to true up, RMS, deg; a filter that is farther off was not given what it expects.
const MOST_TILT_DEG: f64 = 15.0;

/// The filter's up is read once in so many samples.
const TILT_EVERY: usize = 8;

/// Measures what `options` name and prints the figures.
///
/// # Errors
/// A name that matches nothing, an image that cannot be built, or one that does not run as it
/// should.
pub fn run(options: &Cycles) -> Result<Verdict> {
    let chosen = choose(options)?;
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let recording = Recording::open(&workspace.join("tests/data/broad_11_cut.imuq"))?;
    let recorded = inputs::recorded(&recording)?;
    let builder = Builder::new(&mut |line| eprintln!("{line}"))?;
    let maker = Maker {
        builder,
        folder: workspace,
        profile: match options.optimise {
            Optimise::Speed => "speed",
            Optimise::Size => "firmware",
        },
    };
    let progress = Progress::begin(2 * chosen.len() + 1);
    progress.step("building what all have in common; the first time this takes a minute");
    let empty = maker.image(&[])?;
    let mut filters = Vec::new();
    for candidate in &chosen {
        let figures = (|| {
            progress.step(&format!("building {candidate}"));
            let feature = candidate.feature();
            let whole = maker.image(&["setup", &feature])?;
            let update = maker.image(&[&feature])?;
            progress.step(&format!("running {candidate}"));
            let runs = measure(candidate, &whole, &recorded)?;
            anyhow::Ok(Figures::new(candidate, &runs, &update, &empty))
        })();
        filters.push(figures.with_context(|| candidate.to_string())?);
    }
    progress.end();
    let report = Report::new(options.optimise, filters);
    if options.json {
        print_json(&report)?;
    } else {
        print(report.table(options.markdown))?;
    }
    Ok(Verdict::Met)
}

/// The candidates that the options name; each name must match one.
fn choose(options: &Cycles) -> Result<Vec<Candidate>> {
    let all = candidates::all();
    let is_filter = |c: &Candidate, name: &String| c.filter.contains(name);
    let is_library = |c: &Candidate, name: &String| c.library == name;
    for name in &options.filter {
        if !all.iter().any(|c| is_filter(c, name)) {
            return Err(unknown(
                "filter",
                name,
                all.iter().map(|c| c.filter.as_str()),
            ));
        }
    }
    for name in &options.library {
        if !all.iter().any(|c| is_library(c, name)) {
            return Err(unknown("library", name, all.iter().map(|c| c.library)));
        }
    }
    let chosen: Vec<_> = all
        .into_iter()
        .filter(|c| options.filter.is_empty() || options.filter.iter().any(|n| is_filter(c, n)))
        .filter(|c| options.library.is_empty() || options.library.iter().any(|n| is_library(c, n)))
        .collect();
    if chosen.is_empty() {
        bail!(BadInput::new(format!(
            "{} has no filter {}",
            options.library.join(", "),
            options.filter.join(", ")
        )));
    }
    Ok(chosen)
}

fn unknown<'a>(what: &str, name: &str, known: impl Iterator<Item = &'a str>) -> anyhow::Error {
    let known: BTreeSet<_> = known.collect();
    let known: Vec<_> = known.into_iter().collect();
    BadInput::new(format!("no {what} {name}; there are {}", known.join(", "))).into()
}

/// Makes images of the package `cycles`.
struct Maker {
    builder: Builder,
    folder: PathBuf,
    profile: &'static str,
}

impl Maker {
    fn image(&self, features: &[&str]) -> Result<Image> {
        let source = Source {
            folder: &self.folder,
            package: "cycles",
            profile: self.profile,
            features,
        };
        Ok(self.builder.build(&source)?)
    }
}

/// What was measured by running an image.
#[derive(Debug, Clone, PartialEq)]
struct Run {
    /// Mean over the recording, cycles.
    mean: f64,
    /// Largest of all updates, cycles, and the sort of input that it had.
    max: u64,
    max_input: &'static str,
    stack_bytes: u32,
    /// Angle to true up, RMS over the movement, deg, where it estimates up.
    tilt_deg: Option<f64>,
}

/// Runs an image without and with a flash wait state.
fn measure(candidate: &Candidate, image: &Image, recorded: &[Sample]) -> Result<[Run; 2]> {
    let length = match candidate.scalar {
        Scalar::Fixed => HARD_SAMPLES_FIXED,
        _ => HARD_SAMPLES,
    };
    let hard = inputs::hard(recorded, length);
    let run = |wait_states| run_image(candidate, image, wait_states, recorded, &hard);
    let [ideal, waiting] = thread::scope(|scope| {
        let waiting = scope.spawn(|| run(1));
        let ideal = run(0);
        let waiting = waiting
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        [ideal, waiting]
    });
    Ok([ideal?, waiting?])
}

fn run_image(
    candidate: &Candidate,
    image: &Image,
    wait_states: u8,
    recorded: &[Sample],
    hard: &[Hard],
) -> Result<Run> {
    let fresh = Bench::boot(image, wait_states)?;
    let mut bench = fresh.clone();
    let mut worst = (0, "");
    let mut total = 0;
    let (mut tilt2, mut tilts) = (0.0, 0);
    for (index, sample) in recorded.iter().enumerate() {
        let cycles = bench.update(&sample.words(candidate.input))?;
        total += cycles;
        worst = worst.max((cycles, "the recording"));
        if candidate.has_tilt()
            && index.is_multiple_of(TILT_EVERY)
            && let Some(truth) = sample.up()
        {
            let up = bench.up()?;
            let cos: f64 = up.iter().zip(truth).map(|(a, b)| a * b).sum();
            tilt2 += cos.clamp(-1.0, 1.0).acos().to_degrees().powi(2);
            tilts += 1;
        }
    }
    let tilt_deg = (tilts > 0).then(|| f64::sqrt(tilt2 / f64::from(tilts)));
    if let Some(tilt) = tilt_deg
        && (tilt.is_nan() || tilt > MOST_TILT_DEG)
    {
        bail!(
            "{tilt:.1} deg from true up: it does not estimate what it should, and its figures mean nothing"
        );
    }
    let mut stack_bytes = bench.stack_bytes();
    // Hard input follows the recording, and it follows the start.
    for start in [bench, fresh] {
        for sort in hard {
            let mut bench = start.clone();
            for sample in &sort.samples {
                let cycles = bench.update(&sample.words(candidate.input))?;
                if cycles > worst.0 {
                    worst = (cycles, sort.name);
                }
            }
            stack_bytes = stack_bytes.max(bench.stack_bytes());
        }
    }
    Ok(Run {
        mean: total as f64 / recorded.len() as f64,
        max: worst.0,
        max_input: worst.1,
        stack_bytes,
        tilt_deg,
    })
}

/// Progress on standard error: a bar on a terminal, a line for each step elsewhere.
struct Progress(Option<ProgressBar>);

impl Progress {
    fn begin(steps: usize) -> Self {
        Self(std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(steps as u64);
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
                bar.set_style(style);
            }
            bar
        }))
    }

    fn step(&self, what: &str) {
        match &self.0 {
            Some(bar) => {
                bar.inc(1);
                bar.set_message(what.to_owned());
                bar.tick();
            }
            None => eprintln!("{what}"),
        }
    }

    fn end(self) {
        if let Some(bar) = self.0 {
            bar.finish_and_clear();
        }
    }
}
