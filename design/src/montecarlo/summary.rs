//! Summary of a campaign: pass rate, quantiles and the worst runs.

use plant::dispersion::{badness, pass_rate, quantile};
use serde::Serialize;

use super::table::Row;
use report::measure::Limit::AtLeast;
use report::measure::{Figure, Figures, data, figure, rows, shown};

/// One of the worst runs.
#[derive(Debug, Serialize)]
pub struct Worst {
    /// The run.
    #[serde(flatten)]
    pub row: Row,
    /// The file from which it can be flown again.
    pub file: Option<String>,
}

impl Worst {
    /// The `count` worst of the rows, worst first.
    pub fn of(rows: &[Row], count: usize) -> Vec<Self> {
        let badness = |row: &Row| badness(row.settling_5pct_s, row.overshoot_pct);
        let mut worst: Vec<&Row> = rows.iter().collect();
        worst.sort_by(|a, b| badness(b).total_cmp(&badness(a)));
        let worst = worst.into_iter().take(count);
        worst.map(|row| Self { row: row.clone(), file: None }).collect()
    }

    fn shown(&self) -> [Figure; 5] {
        [
            figure("", self.row.run).shown("worst runs", "", 0),
            figure("", self.row.start_rad).shown("start", "rad", 1),
            figure("", self.row.overshoot_pct).shown("overshoot", "%", 1),
            figure("", self.row.settling_5pct_s).shown("5 % settling", "s", 3).or("never"),
            shown("kept in", self.file.clone().unwrap_or_default()),
        ]
    }
}

/// The figures of a campaign of at least one row; the pass rate is held to `required`, if given.
pub fn figures(table: &[Row], worst: &[Worst], required: Option<f64>) -> Figures {
    let rate = pass_rate(table, |row| row.pass);
    let percent = |key, share: f64, label| figure(key, share).shown(label, "%", 2).scaled(100.0);
    let overshoot = |key, share, label| {
        let value = quantile(table, share, |row| Some(row.overshoot_pct));
        figure(key, value).shown(label, "%", 1)
    };
    let settling = |key, share, label| {
        let value = quantile(table, share, |row| row.settling_5pct_s);
        figure(key, value).shown(label, "s", 3).or("never")
    };
    let first = &table[0];
    Figures::from([
        figure("seed", first.seed).shown("seed", "", 0),
        figure("servo", first.servo.as_str()).shown("servo", "", 0),
        figure("lateral_mm", first.lateral_mm).shown("lateral offset, either side", "mm", 1),
        figure("runs", table.len()).shown("runs", "", 0),
        percent("pass_rate", rate.rate, "passed").limit(required.map(AtLeast)),
        percent("pass_rate_low", rate.low, "lower 95 % bound"),
        percent("pass_rate_high", rate.high, "upper 95 % bound"),
        overshoot("overshoot_p95_pct", 0.95, "overshoot, 95 % within"),
        overshoot("overshoot_max_pct", 1.0, "overshoot, worst"),
        settling("settling_5pct_median_s", 0.5, "5 % settling, median"),
        settling("settling_5pct_p95_s", 0.95, "5 % settling, 95 % within"),
        data("worst", &worst),
        rows("", worst.iter().map(Worst::shown)),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_never_settled() {
        let rows = [Some(0.5), None, Some(0.9)].into_iter().zip(0..);
        let rows: Vec<Row> = rows.map(|(settling, run)| Row::flown(run, 1.0, settling)).collect();
        let worst = Worst::of(&rows, 2);
        assert_eq!(worst.iter().map(|worst| worst.row.run).collect::<Vec<_>>(), [1, 2]);
    }
}
