//! A campaign: many runs on all cores, with a bar meanwhile and their rows in order; a table, whose
//! parts can be joined; figures and a page; and single runs as files, which can be carried out
//! again.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use rayon::prelude::*;
use recordings::Lines;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::exit::{BadInput, Verdict};
use crate::file::write_table;
use crate::input;
use crate::kind::{self, Kind};
use crate::measure::Figures;
use crate::progress::{INTERVAL, bar};

/// How runs are carried out.
#[derive(Debug, Args)]
pub struct CampaignOptions {
    /// Seed of all that is random.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Runs at a time [default: one for each processor core].
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,
}

/// What is written.
#[derive(Debug, Args)]
pub struct Output {
    /// Where to write a row for each run.
    #[arg(long, value_name = "FILE.csv", value_parser = kind::table)]
    pub out: Option<PathBuf>,

    /// Where to write the HTML report [default: named as the command, in the folder report].
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

impl Output {
    /// The page of the command `name`, whose place is tried before the work begins.
    ///
    /// # Errors
    /// The place takes no page.
    pub fn page(&self, name: &str) -> Result<PathBuf> {
        let usual = format!("report/{name}.html");
        kind::given_or(self.report.as_deref(), usual, Kind::Page)
    }

    /// Prints the figures, and writes the page and the table. What cannot be written is complained
    /// of when everything else has been handed over.
    ///
    /// # Errors
    /// What cannot be written.
    pub fn conclude<R: Serialize>(
        &self,
        rows: &[R],
        figures: &Figures,
        page: (&Path, String),
    ) -> Result<Verdict> {
        let verdict = figures.conclude(self.json, Some(page));
        write_table(self.out.as_deref(), rows).and(verdict)
    }
}

/// Carries out `run` for each case, on as many threads as `jobs` says, with a bar that counts them
/// as `what`. The results come in the order of the cases.
///
/// # Errors
/// Those of a run: the others are not carried out.
pub fn carry_out<C: Sync, R: Send>(
    what: &str,
    cases: &[C],
    jobs: Option<u16>,
    run: impl Fn(&C) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    on_threads(what, cases.len() as u64, jobs, |done| {
        let runs = cases.par_iter().map(|case| run(case).inspect(|_| done()));
        runs.collect()
    })?
}

/// Does `work` on as many threads as `jobs` says. It tells each of its `steps` as done, which a bar
/// counts as `what`. Where there is no terminal, each tenth is a line.
///
/// # Errors
/// The system gives no threads.
pub fn on_threads<R: Send>(
    what: &str,
    steps: u64,
    jobs: Option<u16>,
    work: impl FnOnce(&(dyn Fn() + Sync)) -> R + Send,
) -> Result<R> {
    let threads = rayon::ThreadPoolBuilder::new().num_threads(jobs.map_or(0, usize::from));
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what}, {{eta}} to go");
    let bar = bar(steps, &template);
    let begun = Instant::now();
    let done = threads.build()?.install(|| {
        work(&|| {
            bar.inc(1);
            let position = bar.position();
            if bar.is_hidden() && begun.elapsed() > INTERVAL && 10 * position % steps < 10 {
                eprintln!("{position}/{steps} {what}");
            }
        })
    });
    bar.finish_and_clear();
    Ok(done)
}

/// A row of a campaign's table.
pub trait Row: Serialize + DeserializeOwned {
    /// Whether such a row can stand in a table with the `first` one.
    ///
    /// # Errors
    /// Why not.
    fn check(&self, first: &Self) -> Result<(), String>;

    /// Where it stands; only one row stands there.
    fn place(&self) -> impl Ord;
}

/// Joins tables; a run that is in several counts once.
///
/// # Errors
/// A file that is no table, or tables of different campaigns.
pub fn merge<R: Row>(files: &[&Path]) -> Result<Vec<R>> {
    let mut all: Vec<R> = Vec::new();
    for path in files {
        let file = File::open(path).map_err(|error| BadInput::of(path, error))?;
        for row in csv::Reader::from_reader(Lines::new(file)).deserialize::<R>() {
            let row = row.map_err(|error| BadInput::of(path, error))?;
            let checked = row.check(all.first().unwrap_or(&row));
            checked.map_err(|why| BadInput::of(path, why))?;
            all.push(row);
        }
    }
    if all.is_empty() {
        return Err(BadInput::new("no runs in these files").into());
    }
    all.sort_by(|one, other| one.place().cmp(&other.place()));
    all.dedup_by(|one, other| one.place() == other.place());
    Ok(all)
}

/// Options of `merge`.
#[derive(Debug, Args)]
pub struct Merge {
    /// Tables that `--out` wrote.
    #[arg(required = true, value_name = "FILE.csv")]
    pub files: Vec<PathBuf>,

    /// Where to write what they add up to.
    #[command(flatten)]
    pub output: Output,
}

impl Merge {
    /// Joins the tables of the command `name`; `present` makes figures and page of their rows.
    ///
    /// # Errors
    /// Those of [`merge`] and of [`Output::conclude`].
    pub fn run<R: Row>(
        &self,
        name: &str,
        present: impl FnOnce(&[R]) -> Result<(Figures, String)>,
    ) -> Result<Verdict> {
        let files: Vec<&Path> = self.files.iter().map(AsRef::as_ref).collect();
        if let Some(out) = &self.output.out {
            kind::keep_apart(out, files.iter().copied())?;
        }
        let report = self.output.page(name)?;
        let rows = merge(&files)?;
        let (figures, page) = present(&rows)?;
        self.output.conclude(&rows, &figures, (&report, page))
    }
}

/// Reads a run from its file.
///
/// # Errors
/// The file cannot be read, or `parse` refuses its text.
pub fn read_run<T>(
    path: &Path,
    parse: impl FnOnce(&str) -> Result<T, String>,
) -> Result<T, BadInput> {
    parse(&input::file_text(path)?).map_err(|why| BadInput::of(path, why))
}
