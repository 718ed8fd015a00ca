//! `lab cycles`: what one update of a filter costs on the chip, beside filters of other libraries,
//! and what one of a control law costs.
//!
//! The package `cycles` makes two images of each, in one build profile: one that sets it up, which
//! is run, and one that holds the update alone, whose size is measured.

mod bench;
mod candidates;
mod figures;
mod hard;
mod inputs;
mod laws;
mod readings;

use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::Path;
use std::thread;

use anyhow::{Context, Result, bail};
use recordings::{Recording, Scalar};
use rig::Image;
use rig::image::{Builder, Source};

use bench::Bench;
use candidates::Candidate;
use clap::{Args, ValueEnum};
use hard::Sort;
use inputs::Sample;
use laws::Law;
use report::exit::{BadInput, Verdict};
use report::progress::Progress;

/// Options of `lab cycles`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo lab cycles                         every filter, beside the crates of the field
  cargo lab cycles --filter mahony         those with mahony in their name only: quicker
  cargo lab cycles --library tvc-fusion    this project's own only
  cargo lab cycles --law surface           the switching surface, in float and in fixed point
  cargo lab cycles --law all               every control law, and no filter
  cargo lab cycles --markdown              the table for a README
  cargo lab cycles --json > cycles.json    figures for a script, nothing else on standard output

What is measured, on an emulated Cortex-M0+ at exact instruction timing, of one update from a sample
in memory to an orientation in memory, or from a reading in memory to an output:
  mean       filters: over a recording of real sensors with a magnetometer sample each time, start-up
             included; laws: over two seconds out of a tilt of 0.4 rad that each flies on a model
  max        over that and over hard inputs: clipped, free fall, no field, random, gaps in time;
             held, repeated and old readings
  1ws        the same with one flash wait state
  code       flash of the update and all it calls, constants included: an image that holds nothing
             else, less one whose update is empty
  RAM        the state
  stack      depth from the call, measured by painting
Every output of a law is compared with that of the same code on this computer; a bit that differs is
an error.

Exit status: 0 measured, 1 something failed, 2 unusable input.")]
pub struct Cycles {
    /// Only filters with this in their name; may be given more than once.
    #[arg(long, value_name = "NAME")]
    pub filter: Vec<String>,

    /// Only filters of this library; may be given more than once.
    #[arg(long, value_name = "CRATE")]
    pub library: Vec<String>,

    /// Control laws with this in their name, or "all"; filters then only where they are named. May
    /// be given more than once.
    #[arg(long, value_name = "NAME")]
    pub law: Vec<String>,

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

/// What stands for every law.
const ALL: &str = "all";

/// Samples of each sort of hard input. Fixed point has more of them: it runs faster, and it has a
/// limit of cycles to keep.
const HARD_SAMPLES: usize = 32;
const HARD_SAMPLES_FIXED: usize = 512;

/// Largest angle to true up, RMS, deg; a filter that is farther off was not given what it expects.
const MOST_TILT_DEG: f64 = 15.0;

/// The filter's up is read once in this number of samples.
const TILT_EVERY: usize = 8;

/// Measures what `options` name and prints the figures.
///
/// # Errors
/// A name that matches nothing, an image that cannot be built, or one that does not run as it
/// should.
pub fn run(options: &Cycles) -> Result<Verdict> {
    let (filters, laws) = (choose(options)?, choose_laws(&options.law)?);
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let recording = Recording::open(&workspace.join("tests/data/broad_11_cut.imuq"))?;
    let recorded = inputs::recorded(&recording)?;
    let builder = Builder::new(&mut |line| eprintln!("{line}"))?;
    let profile = match options.optimise {
        Optimise::Speed => "speed",
        Optimise::Size => "firmware",
    };
    let image = |features: &[&str]| {
        builder.build(&Source { folder: &workspace, package: "cycles", profile, features })
    };
    let mut progress = Progress::new(2 * (filters.len() + laws.len()) as u64 + 1);
    progress.at("building what all have in common; the first time this takes a minute", 0);
    let empty = image(&[])?;
    // Runs the image that sets `what` up, and weighs the one that does not.
    let mut measured = |what: &dyn Display, feature: &str, run: &dyn Fn(&Image) -> Result<Runs>| {
        progress.part_done(1);
        progress.at(&format!("building {what}"), 0);
        let (whole, update) = (image(&["setup", feature])?, image(&[feature])?);
        progress.part_done(1);
        progress.at(&format!("running {what}"), 0);
        let runs = run(&whole)?;
        let cost = figures::cost(&runs, &update, &empty);
        anyhow::Ok((runs, cost))
    };
    let filters = filters.iter().map(|candidate| {
        let run = |image: &Image| measure(candidate, image, &recorded);
        let (runs, cost) = measured(candidate, &candidate.feature(), &run)
            .with_context(|| candidate.to_string())?;
        Ok(figures::of_filter(candidate, &runs, cost))
    });
    let filters = filters.collect::<Result<Vec<_>>>()?;
    let laws = laws.iter().map(|law| {
        let run = |image: &Image| laws::measure(law, image);
        let (_, cost) = measured(law, &law.feature(), &run).with_context(|| law.to_string())?;
        Ok(figures::of_law(law, cost))
    });
    let laws = laws.collect::<Result<Vec<_>>>()?;
    progress.end();
    figures::conclude(options, filters, laws)
}

/// The filters that the options name; each name must match one. All where none is named, unless
/// laws are.
fn choose(options: &Cycles) -> Result<Vec<Candidate>> {
    let Cycles { filter, library, law, .. } = options;
    let mut all = candidates::all();
    let filters = all.iter().map(|candidate| candidate.filter.to_owned());
    must_be_there("filter", filter, filters, |known, name| known.contains(name))?;
    let libraries = all.iter().map(|candidate| candidate.library.to_owned());
    must_be_there("library", library, libraries, |known, name| known == name)?;
    all.retain(|c| filter.is_empty() || filter.iter().any(|name| c.filter.contains(name)));
    all.retain(|c| library.is_empty() || library.iter().any(|name| c.library == *name));
    let (filters, libraries) = (filter.join(", "), library.join(", "));
    match (filters.is_empty() && libraries.is_empty(), all.is_empty()) {
        (true, _) if !law.is_empty() => Ok(Vec::new()),
        (_, true) => bail!(BadInput::new(format!("{libraries} has no filter {filters}"))),
        _ => Ok(all),
    }
}

/// The laws with one of these in their names; each must be in one.
fn choose_laws(names: &[String]) -> Result<Vec<Law>> {
    let mut all = laws::all();
    let known = all.iter().map(Law::full_name).chain([ALL.to_owned()]);
    let is_law = |known: &str, name: &str| match known {
        ALL => name == ALL,
        _ => known.contains(name),
    };
    must_be_there("law", names, known, is_law)?;
    all.retain(|law| names.iter().any(|name| name == ALL || law.full_name().contains(name)));
    Ok(all)
}

/// # Errors
/// One of `names` is the name of nothing that is `known`.
fn must_be_there(
    what: &str,
    names: &[String],
    known: impl Iterator<Item = String>,
    is: impl Fn(&str, &str) -> bool,
) -> Result<()> {
    let known: BTreeSet<String> = known.collect();
    let Some(name) = names.iter().find(|name| !known.iter().any(|one| is(one, name))) else {
        return Ok(());
    };
    let known = known.into_iter().collect::<Vec<_>>().join(", ");
    bail!(BadInput::new(format!("no {what} {name}; there are {known}")))
}

/// The runs of an image without and with a flash wait state.
type Runs = [Run; 2];

/// What was measured by running an image.
#[derive(Debug, Clone, Default)]
struct Run {
    /// Mean over the recording or the release, cycles.
    mean: f64,
    /// Largest of all updates, cycles, and the sort of input that it had.
    max: u64,
    max_input: &'static str,
    stack_bytes: u32,
    /// Angle to true up, RMS over the movement, deg, where it estimates up.
    tilt_deg: Option<f64>,
}

impl Run {
    /// Carries out an update for each of `inputs`; the sum of their cycles.
    fn play<T>(
        &mut self,
        bench: &mut Bench,
        name: &'static str,
        inputs: &[T],
        mut update: impl FnMut(&mut Bench, usize, &T) -> Result<u64>,
    ) -> Result<u64> {
        let mut total = 0;
        for (index, input) in inputs.iter().enumerate() {
            let cycles = update(bench, index, input)?;
            total += cycles;
            if cycles > self.max {
                (self.max, self.max_input) = (cycles, name);
            }
        }
        self.stack_bytes = self.stack_bytes.max(bench.stack_bytes());
        Ok(total)
    }
}

/// Runs an image without and with a flash wait state.
fn measure(candidate: &Candidate, image: &Image, recorded: &[Sample]) -> Result<Runs> {
    let length = match candidate.scalar {
        Scalar::Fixed => HARD_SAMPLES_FIXED,
        _ => HARD_SAMPLES,
    };
    let hard = inputs::hard(recorded, length);
    without_and_with_wait_state(|wait_states| {
        run_image(candidate, image, wait_states, recorded, &hard)
    })
}

/// Two runs at once, without and with a flash wait state.
fn without_and_with_wait_state(run: impl Fn(u8) -> Result<Run> + Sync) -> Result<Runs> {
    let [ideal, waiting] = thread::scope(|scope| {
        let waiting = scope.spawn(|| run(1));
        let ideal = run(0);
        let waiting = waiting.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        [ideal, waiting]
    });
    Ok([ideal?, waiting?])
}

fn run_image(
    candidate: &Candidate,
    image: &Image,
    wait_states: u8,
    recorded: &[Sample],
    hard: &[Sort<Sample>],
) -> Result<Run> {
    let fresh = Bench::boot(image, wait_states)?;
    let mut bench = fresh.clone();
    let mut run = Run::default();
    let (mut tilt2, mut tilts) = (0.0, 0);
    let total = run.play(&mut bench, "the recording", recorded, |bench, index, sample| {
        let cycles = bench.update(&sample.words(candidate.input))?;
        if candidate.has_tilt()
            && index.is_multiple_of(TILT_EVERY)
            && let Some(truth) = sample.up()
        {
            let up = bench.up()?;
            let cos: f64 = up.iter().zip(truth).map(|(a, b)| a * b).sum();
            tilt2 += cos.clamp(-1.0, 1.0).acos().to_degrees().powi(2);
            tilts += 1;
        }
        Ok(cycles)
    })?;
    run.mean = total as f64 / recorded.len() as f64;
    run.tilt_deg = (tilts > 0).then(|| f64::sqrt(tilt2 / f64::from(tilts)));
    if let Some(tilt) = run.tilt_deg
        && (tilt.is_nan() || tilt > MOST_TILT_DEG)
    {
        bail!(
            "{tilt:.1} deg from true up: it does not estimate what it should, and its figures mean nothing"
        );
    }
    // Hard input follows the recording, and it follows the start.
    for start in [bench, fresh] {
        for (name, samples) in hard {
            run.play(&mut start.clone(), name, samples, |bench, _, sample| {
                bench.update(&sample.words(candidate.input))
            })?;
        }
    }
    Ok(run)
}
