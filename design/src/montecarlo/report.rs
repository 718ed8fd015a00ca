//! The HTML page of a campaign: who passed, how fast, and which quantity it depends on.

use anyhow::Result;
use maud::{Markup, html};

use super::table::Row;
use report::measure::Figures;
use report::page::{figure, page, table, verdict};
use report::plot::{Line, Look, Marks, Plot, Shape};

/// Starts are told apart by colour: the least of their magnitudes, rad, and the name in the legend.
const STARTS: [(f64, &str); 3] =
    [(0.0, "from 0.2 rad"), (0.3, "from 0.4 rad"), (0.6, "from 0.8 rad")];

/// What is drawn for each run, by name.
type Drawn = (&'static str, fn(&Row) -> f64);

const DRAWN: [Drawn; 10] = [
    ("thrust", |row| row.thrust),
    ("inertia", |row| row.inertia),
    ("vertical centre of mass, mm", |row| row.cm_vertical_mm),
    ("lateral centre of mass, times the sign of the start, mm", |row| {
        row.cm_lateral_mm * row.start_rad.signum()
    }),
    ("servo speed", |row| row.servo_speed),
    ("stall torque", |row| row.stall),
    ("supply", |row| row.supply),
    ("backlash", |row| row.backlash),
    ("sensor delay, ms", |row| row.delay_ms),
    ("frame phase", |row| row.phase),
];

/// The whole page; `rows` is not empty.
pub fn render(figures: &Figures, rows: &[Row]) -> Result<String> {
    let first = &rows[0];
    let title =
        format!("Monte Carlo: {} drones, servo {}, seed {}", rows.len(), first.servo, first.seed);
    let failed = rows.iter().filter(|row| !row.pass).count();
    let words = if failed == 0 {
        "Every run met the requirements.".to_owned()
    } else {
        format!("{failed} of {} runs missed a requirement.", rows.len())
    };
    let body = html! {
        (verdict(failed == 0, &words))
        (figures.lines().markup())
        (figures.table("").markup())
        (scatter(rows)?)
        (distribution(rows)?)
        h2 { "What it depends on" }
        (dependence(rows))
        p {
            "Medians over the thirds of the runs in which the quantity is smallest and largest, all else \
             drawn at random. A run that never settles counts as slower than any other."
        }
        footer {
            "The image's own control law on the model of the drone, each run a drone of its own, with "
            "its centre of mass up to " (first.lateral_mm) " mm off centre."
        }
    };
    Ok(page(&title, body))
}

/// Rows of the start with this place in [`STARTS`].
fn started(rows: &[Row], place: usize) -> impl Iterator<Item = &Row> {
    let least = STARTS[place].0;
    let below = STARTS.get(place + 1).map_or(f64::INFINITY, |next| next.0);
    rows.iter().filter(move |row| (least..below).contains(&row.start_rad.abs()))
}

fn scatter(rows: &[Row]) -> Result<Markup> {
    let of = |place: usize| {
        started(rows, place).filter_map(|row| Some((row.settling_5pct_s?, row.overshoot_pct)))
    };
    let all: Vec<(f64, f64)> = (0..STARTS.len()).flat_map(of).collect();
    let most = |of: fn(&(f64, f64)) -> f64| all.iter().map(of).fold(0.1, f64::max);
    let look = Look {
        x: Some((0.0, 1.05 * most(|point| point.0))),
        y: Some((0.0, 1.05 * most(|point| point.1))),
        marks: (0..STARTS.len())
            .map(|place| Marks {
                name: STARTS[place].1,
                colour: place,
                shape: Shape::Dot,
                points: of(place).collect(),
            })
            .collect(),
        ..Look::default()
    };
    let plot = Plot::new("5 % settling, s", "overshoot, %", Vec::new());
    Ok(figure("A dot for each drone that settled.", plot.svg_as(&look)?))
}

fn distribution(rows: &[Row]) -> Result<Markup> {
    let lines = STARTS.iter().enumerate().map(|(place, start)| {
        let runs = started(rows, place).count().max(1) as f64;
        let mut settled: Vec<f64> =
            started(rows, place).filter_map(|row| row.settling_5pct_s).collect();
        settled.sort_by(f64::total_cmp);
        let share = |place: usize| 100.0 * (place + 1) as f64 / runs;
        let settled = settled.iter().enumerate();
        let points = settled.map(|(place, settling)| (*settling, share(place)));
        Line::new(start.1, place, points.collect())
    });
    let plot = Plot::new("5 % settling, s", "drones settled by then, %", lines.collect());
    let look = Look { y: Some((0.0, 100.0)), ..Look::default() };
    Ok(figure("How many have settled after how long.", plot.svg_as(&look)?))
}

/// How settling and overshoot change from the smallest to the largest third of each quantity.
fn dependence(rows: &[Row]) -> Markup {
    let settling = |row: &Row| row.settling_5pct_s.unwrap_or(f64::INFINITY);
    let cells = DRAWN.iter().filter_map(|(name, of)| {
        let mut sorted: Vec<&Row> = rows.iter().collect();
        sorted.sort_by(|a, b| of(a).total_cmp(&of(b)));
        let (first, last) = (sorted.first()?, sorted.last()?);
        if of(first) == of(last) {
            return None;
        }
        let third = sorted.len().div_ceil(3);
        let (low, high) = (&sorted[..third], &sorted[sorted.len() - third..]);
        Some(vec![
            (*name).to_owned(),
            seconds(median(low, settling)),
            seconds(median(high, settling)),
            format!("{:.1}", median(low, |row| row.overshoot_pct)),
            format!("{:.1}", median(high, |row| row.overshoot_pct)),
        ])
    });
    let head = [
        "quantity",
        "settling where small, s",
        "where large, s",
        "overshoot where small, %",
        "where large, %",
    ];
    table(&head, &cells.collect::<Vec<_>>())
}

fn seconds(value: f64) -> String {
    if value.is_finite() { format!("{value:.3}") } else { "never".into() }
}

/// Middle value; `rows` is not empty.
fn median(rows: &[&Row], of: impl Fn(&Row) -> f64) -> f64 {
    let mut values: Vec<f64> = rows.iter().map(|row| of(row)).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::super::summary::figures;
    use super::*;

    #[test]
    fn every_start_is_of_one_colour() {
        let rows: Vec<Row> = (0..9).map(|run| Row::flown(run, 1.0, Some(0.5))).collect();
        for place in 0..STARTS.len() {
            assert_eq!(started(&rows, place).count(), 3);
        }
    }

    #[test]
    fn the_page_tells_what_slows_and_who_failed() {
        let mut rows: Vec<Row> = (0..9u32)
            .map(|run| {
                let thrust = 0.7 + 0.05 * f64::from(run);
                Row::flown(run.into(), thrust, Some(2.0 - thrust))
            })
            .collect();
        rows[0].settling_5pct_s = None;
        rows[0].pass = false;
        let page = render(&figures(&rows, &[], None), &rows).unwrap();
        assert!(page.contains("1 of 9 runs missed"), "{page}");
        // Medians of the lowest three (never, 1.25, 1.2) and of the highest three.
        assert!(page.contains("<td>thrust</td><td>1.250</td><td>0.950</td>"));
        assert!(!page.contains("<td>inertia</td>"), "nothing was drawn there");
    }
}
