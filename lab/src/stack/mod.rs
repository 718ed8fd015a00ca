//! `lab stack`: the worst case of an image's stack, from its calls.
//!
//! The machine code of the linked image is followed from the reset and from every handler of the
//! vector table (`walk`), with what is known of the registers (`value`). The calls make a graph,
//! whose deepest way is sought (`depth`). Main and the handlers are put on top of one another by
//! their priorities (`levels`).

mod bounds;
mod depth;
mod figures;
mod levels;
mod program;
mod report;
mod seen;
#[cfg(test)]
mod tests;
mod value;
mod walk;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use samd21::chip::EXCEPTIONS;

use ::report::arguments::seconds;
use ::report::exit::{BadInput, Verdict};
use ::report::kind;
use bounds::{bound, bounds};
use depth::{Bounded, Calls};
use ground::flight::fly::options::start_angle;
use ground::image::ImageOption;
use levels::{Level, levels};
use program::Program;
use walk::{Problem, explore};

/// Options of `lab stack`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo lab stack                                     of the image of this source tree
  cargo lab stack --report report/stack.html          with a picture of the deepest way
  cargo lab stack --json > stack.json                 figures for a script
  cargo lab stack --image other.elf --after 2 --bound core::fmt::write=3
                                                      any SAMD21 firmware, run for 2 s

The worst case is main's deepest way and, on it, the deepest handler of each priority with the
36 bytes that an exception stacks. Priorities are read from the emulated chip after the image has
set them. A call by a pointer is taken to reach the deepest function that it can reach. The rig
flies the image, and the deepest stack that it sees must not exceed the worst case.

There is no bound for recursion (unless --bound or lab/src/stack/bounds.rs gives one), for a second
stack (PSP), for code in RAM and for GCC's __gnu_thumb1_case_*.

Exit status: 0 the worst case is at most 60 % of what the statics leave and not exceeded on the rig,
1 it is not, it has no bound, or something failed, 2 unusable input.")]
pub struct Stack {
    /// Seed of all that is random: sensor noise and bias, clock phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Tilt that is flown from, rad.
    #[arg(long, value_name = "RAD", default_value_t = 0.4, allow_negative_numbers = true, value_parser = start_angle)]
    pub start: f64,

    /// Length of the flight, s.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = seconds)]
    pub seconds: f64,

    /// No flight: run any image for so long after power-on, s.
    #[arg(long, value_name = "S", conflicts_with_all = ["start", "seconds"], value_parser = seconds)]
    pub after: Option<f64>,

    /// A function that can come to itself again is on the stack at most so often at once.
    #[arg(long, value_name = "FUNCTION=TIMES", value_parser = bound)]
    pub bound: Vec<Bounded>,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Rows of the table of the largest functions on the terminal.
    #[arg(long, value_name = "N", default_value_t = 15)]
    pub top: usize,

    /// Where to write an HTML report with a picture of the deepest way.
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// What was found of an image's stack.
struct Analysis {
    program: Program,
    calls: Calls,
    /// The bounds of recursion that were needed.
    bounds: Vec<Bounded>,
    /// Why there is no bound; empty if there is one.
    problems: Vec<Problem>,
    /// Instructions among the functions that are reached which no path leads to, bytes.
    not_followed: u32,
    handlers: BTreeMap<usize, u32>,
    /// Main and the priorities in use; empty without a bound.
    levels: Vec<Level>,
}

impl Analysis {
    /// Of a program on a chip with these priorities.
    fn of(program: Program, priorities: &[i8; EXCEPTIONS], given: &[Bounded]) -> Result<Self> {
        let handlers = program.handlers();
        let reset = *handlers
            .get(&1)
            .ok_or_else(|| BadInput::new("the image's vector table leads to no code"))?;
        let pointers = program.pointers();
        let found = explore(&program, handlers.values().copied(), &pointers);
        let not_followed = program.unreached_bytes(found.frames.keys().copied(), &found.code);
        let mut bounds = bounds(given);
        let calls = Calls::new(&program, found.frames, pointers, &bounds);
        let names: BTreeSet<_> = calls.frames.keys().map(|at| program.name(*at)).collect();
        bounds.retain(|bound| names.contains(&bound.function));
        let mut problems: Vec<_> = found.problems.into_iter().collect();
        problems.extend(calls.recursions(&program));
        let levels = match problems.is_empty() {
            true => levels(reset, &handlers, priorities, &calls),
            false => Vec::new(),
        };
        Ok(Self { program, calls, bounds, problems, not_followed, handlers, levels })
    }

    /// The worst case, bytes; `None` without a bound.
    fn worst(&self) -> Option<u32> {
        let bytes = self.levels.iter().map(|level| level.stacked + level.deepest.bytes);
        (self.problems.is_empty()).then(|| bytes.sum())
    }
}

/// Analyses the image, flies it, and prints what was found.
///
/// # Errors
/// An image that cannot be read, or does not run.
pub fn run(options: &Stack) -> Result<Verdict> {
    let firmware = options.image.firmware()?;
    let program = Program::read(&firmware.image, &firmware.elf)?;
    let seen = seen::on_the_rig(options, &firmware.image)
        .context("running the image on the rig; --after runs one that is no autopilot")?;
    let analysis = Analysis::of(program, &seen.priorities, &options.bound)?;
    if analysis.worst().is_some_and(|worst| worst < seen.bytes) {
        eprintln!("the rig has been deeper than the worst case: the analysis is wrong");
    }
    let room = firmware.image.stack_top() - statics_end(&firmware.image);
    let figures = |top| figures::figures(&analysis, &seen, room, top);
    let title = match analysis.worst() {
        Some(worst) => format!("Stack: at most {worst} of {room} bytes"),
        None => "Stack: no bound".into(),
    };
    let all = figures(usize::MAX);
    let page = options.report.as_deref();
    let page = page.map(|path| (path, report::render(&title, &all, &analysis, &seen, room)));
    let shown = if options.json { all } else { figures(options.top) };
    shown.conclude(options.json, page)
}

/// The worst case of an image whose interrupts all have the lowest priority, bytes; `None` without
/// a bound.
pub fn worst_case(image: &rig::Image, elf: &[u8]) -> Result<Option<u32>> {
    let program = Program::read(image, elf)?;
    Ok(Analysis::of(program, &[3; EXCEPTIONS], &[])?.worst())
}

/// The first address above the statics.
fn statics_end(image: &rig::Image) -> u32 {
    let sections = samd21::memory::RAM_BASE + image.sizes().static_ram;
    let end = image.symbol("_stack_end").unwrap_or(sections);
    end.clamp(samd21::memory::RAM_BASE, image.stack_top())
}
