//! `tvc model simulate`: a scenario in, a trajectory out.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use anyhow::{Context, Result};
use indicatif::ProgressBar;
use plant::scenario::{Row, Scenario, ScenarioError};

use crate::model::Simulate;
use report::exit::{BadInput, Verdict};
use report::file::{print, write_whole};
use report::input;
use report::kind;
use report::measure::{Figures, data, figure};

/// Simulates as `options` say.
pub fn run(options: &Simulate) -> Result<Verdict> {
    if let Some(out) = &options.out {
        kind::keep_apart(out, [options.scenario.as_path()])?;
    }
    let rows = simulate(options)?;
    let csv = csv(&rows);
    match &options.out {
        Some(out) => {
            write_whole(out, csv.as_bytes())?;
            eprintln!("{} rows: {}", rows.len(), out.display());
        }
        None if options.json => {}
        None => print(csv)?,
    }
    if options.json {
        let (first, last) = (rows[0], rows[rows.len() - 1]);
        let figures = Figures::from([
            data("scenario", &options.scenario),
            data("out", &options.out),
            figure("rows", rows.len()),
            figure("dt_s", rows[1].t - first.t),
            figure("seconds", last.t),
            data("first", &first),
            data("last", &last),
            // Smallest and largest value of each column.
            data("least", &extremes(&rows, f64::min)),
            data("most", &extremes(&rows, f64::max)),
        ]);
        return figures.conclude(true, None);
    }
    Ok(Verdict::Met)
}

fn simulate(options: &Simulate) -> Result<Vec<Row>> {
    let path = &options.scenario;
    let refuse = |error: ScenarioError| BadInput::of(path, error);
    let mut scenario = Scenario::parse(&input::file_text(path)?).map_err(refuse)?;
    if let Some(dt_s) = options.dt {
        scenario.dt_s = dt_s;
        scenario.validate().map_err(refuse)?;
    }
    let progress = ProgressBar::new_spinner().with_message("simulating");
    progress.enable_steady_tick(Duration::from_millis(200));
    let rows = scenario.run();
    progress.finish_and_clear();
    match rows {
        Ok(rows) => Ok(rows),
        // Integration failed at run time: the scenario itself was valid.
        Err(error @ ScenarioError::Integration(_)) => {
            Err(error).with_context(|| path.display().to_string())
        }
        Err(error) => Err(refuse(error).into()),
    }
}

/// The trajectory as text; every number is the shortest that is read back exactly.
fn csv(rows: &[Row]) -> String {
    let mut text = Row::COLUMNS.join(",");
    text.push('\n');
    for row in rows {
        for (column, value) in row.values().into_iter().enumerate() {
            let comma = if column == 0 { "" } else { "," };
            // Writing to a String cannot fail.
            let _ = write!(text, "{comma}{value:?}");
        }
        text.push('\n');
    }
    text
}

/// Smallest or largest of each column.
fn extremes(rows: &[Row], pick: fn(f64, f64) -> f64) -> BTreeMap<&'static str, Option<f64>> {
    let of = |column: usize| rows.iter().map(|row| row.values()[column]).reduce(pick);
    Row::COLUMNS.into_iter().enumerate().map(|(column, name)| (name, of(column))).collect()
}
