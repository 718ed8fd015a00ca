//! The figures, as JSON and as tables.

use std::collections::BTreeSet;

use comfy_table::presets::{ASCII_MARKDOWN, NOTHING};
use comfy_table::{CellAlignment, Table};
use indicatif::HumanCount;
use rig::Image;
use serde::Serialize;

use super::candidates::{Candidate, OWN};
use super::laws::Law;
use super::{Optimise, Run};

/// What one update of one filter costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    filter: String,
    library: &'static str,
    mode: String,
    scalar: String,
    #[serde(flatten)]
    cost: Cost,
    /// Angle to true up over the movement of the recording, RMS, deg; it shows that the filter was
    /// given what it expects.
    tilt_deg: Option<f64>,
}

/// What one update of one control law costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LawFigures {
    law: &'static str,
    scalar: String,
    #[serde(flatten)]
    cost: Cost,
}

/// What one update costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Cost {
    /// Mean over the recording or the flight without flash wait states, cycles.
    cycles_mean: f64,
    /// Largest of all updates, cycles.
    cycles_max: u64,
    /// The sort of input that took that many.
    cycles_max_input: &'static str,
    /// The same with one flash wait state.
    cycles_mean_1ws: f64,
    cycles_max_1ws: u64,
    /// Flash of the update and what it calls, bytes.
    code_bytes: u32,
    /// The state, bytes.
    ram_bytes: u32,
    /// Depth of the stack from the call, bytes.
    stack_bytes: u32,
    /// Routines of the compiler's support library that the update links: soft float, division and
    /// 64-bit arithmetic.
    support_routines: BTreeSet<String>,
}

impl Cost {
    /// Out of the runs without and with a wait state, and of the images with the update and without
    /// it.
    fn new(runs: &[Run; 2], update: &Image, empty: &Image) -> Self {
        let [ideal, waiting] = runs;
        let (sizes, none) = (update.sizes(), empty.sizes());
        Self {
            cycles_mean: tenths(ideal.mean),
            cycles_max: ideal.max,
            cycles_max_input: ideal.max_input,
            cycles_mean_1ws: tenths(waiting.mean),
            cycles_max_1ws: waiting.max,
            code_bytes: sizes.flash - none.flash,
            ram_bytes: sizes.static_ram - none.static_ram,
            stack_bytes: ideal.stack_bytes.max(waiting.stack_bytes),
            support_routines: update
                .symbols()
                .map(|(name, _)| name)
                .filter(|name| name.starts_with("__aeabi_") && !name.starts_with("__aeabi_mem"))
                .map(str::to_owned)
                .collect(),
        }
    }

    fn cells(&self) -> [String; 7] {
        let cells = [
            self.cycles_mean.round() as u64,
            self.cycles_max,
            self.cycles_mean_1ws.round() as u64,
            self.cycles_max_1ws,
            self.code_bytes.into(),
            self.ram_bytes.into(),
            self.stack_bytes.into(),
        ];
        cells.map(|count| HumanCount(count).to_string())
    }
}

impl Figures {
    /// Out of the runs without and with a wait state, and of the images with the update and without
    /// it.
    pub fn new(candidate: &Candidate, runs: &[Run; 2], update: &Image, empty: &Image) -> Self {
        Self {
            filter: candidate.filter.clone(),
            library: candidate.library,
            mode: candidate.mode.to_string(),
            scalar: candidate.scalar.to_string(),
            cost: Cost::new(runs, update, empty),
            tilt_deg: runs[0].tilt_deg.map(tenths),
        }
    }

    fn row(&self) -> Vec<String> {
        let name = match self.library {
            OWN => self.filter.clone(),
            _ => format!("`{}`", self.filter),
        };
        let names = [name, self.mode.clone(), self.scalar.clone()];
        names.into_iter().chain(self.cost.cells()).collect()
    }
}

impl LawFigures {
    /// As [`Figures::new`].
    pub fn new(law: &Law, runs: &[Run; 2], update: &Image, empty: &Image) -> Self {
        Self { law: law.name, scalar: law.scalar.to_string(), cost: Cost::new(runs, update, empty) }
    }

    fn row(&self) -> Vec<String> {
        let names = [self.law.to_owned(), self.scalar.clone()];
        names.into_iter().chain(self.cost.cells()).collect()
    }
}

fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}

/// All figures of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// How all images were built.
    build: String,
    filters: Vec<Figures>,
    laws: Vec<LawFigures>,
}

/// Columns that name what was measured, of filters and of laws, and those of its figures.
const FILTER: &[&str] = &["filter", "mode", "scalar"];
const LAW: &[&str] = &["law", "scalar"];
const FIGURES: [&str; 7] = ["mean", "max", "mean, 1 WS", "max, 1 WS", "code", "RAM", "stack"];

impl Report {
    /// The figures of images that were all built in this way.
    pub fn new(optimise: Optimise, filters: Vec<Figures>, laws: Vec<LawFigures>) -> Self {
        let level = match optimise {
            Optimise::Speed => "3",
            Optimise::Size => "s",
        };
        Self {
            build: format!("opt-level {level}, fat LTO, one codegen unit, panic abort"),
            filters,
            laws,
        }
    }

    /// For people: plain, or as Markdown.
    pub fn table(&self, markdown: bool) -> String {
        let filters = self.filters.iter().map(Figures::row).collect();
        let laws = self.laws.iter().map(LawFigures::row).collect();
        let tables: String = [(FILTER, filters), (LAW, laws)]
            .into_iter()
            .filter(|(_, rows): &(_, Vec<_>)| !rows.is_empty())
            .map(|(names, rows)| table(names, rows, markdown) + "\n\n")
            .collect();
        format!(
            "{tables}Cycles of one update on a Cortex-M0+ at 48 MHz (48 cycles are a microsecond), WS: flash \
             wait states; code, RAM and stack in bytes; {}.\n",
            self.build
        )
    }
}

fn table(names: &[&str], rows: Vec<Vec<String>>, markdown: bool) -> String {
    let mut table = Table::new();
    table
        .load_style(if markdown { ASCII_MARKDOWN } else { NOTHING })
        .set_header([names, &FIGURES].concat())
        .add_rows(rows);
    for column in table.column_iter_mut().skip(names.len()) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.trim_fmt()
}
