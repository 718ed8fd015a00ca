//! What a campaign adds up to.

use anyhow::Result;
use plant::dispersion::{self, Outcome};
use serde::Serialize;

use super::table::Row;
use crate::out::file::print_json;

/// Figures of a campaign.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// Seed.
    pub seed: u64,
    /// The servo.
    pub servo: String,
    /// Range of the lateral offset, either side, mm.
    pub lateral_mm: f64,
    /// Runs flown.
    pub runs: u64,
    /// Share that met what is required.
    pub pass_rate: f64,
    /// Lower 95 % bound.
    pub pass_rate_low: f64,
    /// Upper 95 % bound.
    pub pass_rate_high: f64,
    /// Overshoot that 95 % of the runs stay within, percent.
    pub overshoot_p95_pct: Option<f64>,
    /// Largest overshoot, percent.
    pub overshoot_max_pct: Option<f64>,
    /// Median of the 5 % settling time, s.
    pub settling_5pct_median_s: Option<f64>,
    /// 5 % settling time that 95 % of the runs stay within, s.
    pub settling_5pct_p95_s: Option<f64>,
    /// The worst runs, worst first.
    pub worst: Vec<Worst>,
}

/// A run that stands out.
#[derive(Debug, Serialize)]
pub struct Worst {
    /// The run.
    #[serde(flatten)]
    pub row: Row,
    /// Where it is kept.
    pub file: Option<String>,
}

impl Summary {
    /// Of at least one row, which stand in the order of their numbers.
    pub fn of(rows: &[Row], worst: usize) -> Self {
        let outcomes: Vec<Outcome> = rows.iter().map(Row::outcome).collect();
        let rate = dispersion::pass_rate(&outcomes, Outcome::passes);
        let overshoot = |share| dispersion::quantile(&outcomes, share, |o| Some(o.overshoot_pct));
        let settling = |share| dispersion::quantile(&outcomes, share, |o| o.settling_5pct_s);
        let worst = dispersion::worst(&outcomes, worst)
            .iter()
            .filter_map(|outcome| {
                let place = rows
                    .binary_search_by_key(&outcome.index, |row| row.run)
                    .ok()?;
                Some(Worst {
                    row: rows[place].clone(),
                    file: None,
                })
            })
            .collect();
        let first = rows.first();
        Self {
            seed: first.map_or(0, |row| row.seed),
            servo: first.map_or(String::new(), |row| row.servo.clone()),
            lateral_mm: first.map_or(0.0, |row| row.lateral_mm),
            runs: rows.len() as u64,
            pass_rate: rate.rate,
            pass_rate_low: rate.low,
            pass_rate_high: rate.high,
            overshoot_p95_pct: overshoot(0.95),
            overshoot_max_pct: overshoot(1.0),
            settling_5pct_median_s: settling(0.5),
            settling_5pct_p95_s: settling(0.95),
            worst,
        }
    }

    /// The figures that sum it up: name and value.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let percent = |value: Option<f64>| value.map_or("none".into(), |p| format!("{p:.1} %"));
        let row = |name: &str, value: String| vec![name.to_owned(), value];
        vec![
            row(
                "passed",
                format!(
                    "{:.2} % (95 %: {:.2} to {:.2} %)",
                    100.0 * self.pass_rate,
                    100.0 * self.pass_rate_low,
                    100.0 * self.pass_rate_high
                ),
            ),
            row(
                "overshoot",
                format!(
                    "95 % within {}, worst {}",
                    percent(self.overshoot_p95_pct),
                    percent(self.overshoot_max_pct)
                ),
            ),
            row(
                "5 % settled",
                format!(
                    "median {}, 95 % within {}",
                    seconds(self.settling_5pct_median_s),
                    seconds(self.settling_5pct_p95_s)
                ),
            ),
        ]
    }

    /// Prints it, as text or JSON.
    pub fn print(&self, json: bool) -> Result<()> {
        if json {
            return print_json(self);
        }
        println!(
            "{} runs, servo {}, seed {}, lateral offset +-{} mm",
            self.runs, self.servo, self.seed, self.lateral_mm
        );
        for row in self.rows() {
            println!("{:<11} {}", row[0], row[1]);
        }
        println!("worst runs:");
        for worst in &self.worst {
            println!(
                "  run {:>6} from {:+.1} rad: overshoot {:.1} %, settled {}{}",
                worst.row.run,
                worst.row.start_rad,
                worst.row.overshoot_pct,
                seconds(worst.row.settling_5pct_s),
                worst
                    .file
                    .as_ref()
                    .map_or(String::new(), |file| format!("  {file}")),
            );
        }
        Ok(())
    }
}

fn seconds(value: Option<f64>) -> String {
    value.map_or("never".into(), |s| format!("{s:.3} s"))
}
