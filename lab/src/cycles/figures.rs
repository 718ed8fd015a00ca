//! The figures, as JSON and as tables.

use std::collections::BTreeSet;

use anyhow::Result;
use indicatif::HumanCount;
use rig::Image;

use super::candidates::{Candidate, OWN};
use super::laws::Law;
use super::{Cycles, Optimise, Runs};
use report::exit::Verdict;
use report::file::print;
use report::measure::{Figure, Figures, figure, note, rows};

/// What one update costs, out of the runs, and of the images with the update and without it.
pub fn cost([ideal, waiting]: &Runs, update: &Image, empty: &Image) -> Vec<Figure> {
    let (sizes, none) = (update.sizes(), empty.sizes());
    let count =
        |key, label, count: u64| figure(key, count).said(label, HumanCount(count).to_string());
    let mean = |key, label, cycles: f64| {
        let cycles = tenths(cycles);
        figure(key, cycles).said(label, HumanCount(cycles.round() as u64).to_string())
    };
    let stack_bytes = ideal.stack_bytes.max(waiting.stack_bytes);
    // Those of the compiler's support library: soft float, division and 64-bit arithmetic.
    let routines: BTreeSet<&str> = update
        .symbols()
        .map(|(name, _)| name)
        .filter(|name| name.starts_with("__aeabi_") && !name.starts_with("__aeabi_mem"))
        .collect();
    vec![
        mean("cycles_mean", "mean", ideal.mean),
        count("cycles_max", "max", ideal.max),
        figure("cycles_max_input", ideal.max_input),
        mean("cycles_mean_1ws", "mean, 1 WS", waiting.mean),
        count("cycles_max_1ws", "max, 1 WS", waiting.max),
        count("code_bytes", "code", (sizes.flash - none.flash).into()),
        count("ram_bytes", "RAM", (sizes.static_ram - none.static_ram).into()),
        count("stack_bytes", "stack", stack_bytes.into()),
        rows("support_routines", routines),
    ]
}

/// The row of a filter. The angle to true up shows that it was given what it expects.
pub fn of_filter(candidate: &Candidate, runs: &Runs, cost: Vec<Figure>) -> Vec<Figure> {
    let Candidate { filter, library, mode, scalar, .. } = *candidate;
    let name = match library {
        OWN => filter.to_owned(),
        _ => format!("`{filter}`"),
    };
    let names = [
        figure("filter", filter).said("filter", name),
        figure("library", library),
        figure("mode", mode.to_string()).shown("mode", "", 0),
        figure("scalar", scalar.to_string()).shown("scalar", "", 0),
    ];
    let tilt = figure("tilt_deg", runs[0].tilt_deg.map(tenths));
    names.into_iter().chain(cost).chain([tilt]).collect()
}

/// The row of a control law.
pub fn of_law(law: &Law, cost: Vec<Figure>) -> Vec<Figure> {
    let names = [
        figure("law", law.name).shown("law", "", 0),
        figure("scalar", law.scalar.to_string()).shown("scalar", "", 0),
    ];
    names.into_iter().chain(cost).collect()
}

fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}

/// Prints the rows of filters and of laws as the options say.
pub fn conclude(
    options: &Cycles,
    filters: Vec<Vec<Figure>>,
    laws: Vec<Vec<Figure>>,
) -> Result<Verdict> {
    let level = match options.optimise {
        Optimise::Speed => "3",
        Optimise::Size => "s",
    };
    let build = format!("opt-level {level}, fat LTO, one codegen unit, panic abort");
    let words = format!(
        "Cycles of one update on a Cortex-M0+ at 48 MHz (48 cycles are a microsecond), WS: flash \
         wait states; code, RAM and stack in bytes; {build}."
    );
    let figures = Figures::from([
        figure("build", build),
        rows("filters", filters),
        rows("laws", laws),
        note(words),
    ]);
    if options.markdown {
        print(figures.markdown())?;
        return Ok(Verdict::Met);
    }
    figures.conclude(options.json, None)
}
