//! The HTML page of a campaign: how runs ended, and how long rudders moved without valid data.

use anyhow::Result;
use maud::{Markup, html};
use rig::faults::{DEADLINE, Ending, Outcome};

use super::story;
use crate::out::measure::Figures;
use crate::out::page::{figure, page, table, verdict};
use crate::out::plot::{Line, Look, Marks, Plot, Shape};

/// Runs that the page names, those longest without valid data first.
const NAMED: usize = 10;

/// The whole page; `outcomes` is not empty.
pub fn render(figures: &Figures, seed: u64, outcomes: &[Outcome]) -> Result<String> {
    let title = format!("Faults in flight: {} runs, seed {seed}", outcomes.len());
    let bad: Vec<&Outcome> = outcomes
        .iter()
        .filter(|outcome| matches!(outcome.ending, Ending::Unsafe(_)))
        .collect();
    let mut longest: Vec<&Outcome> = outcomes.iter().collect();
    longest.sort_by(|a, b| b.unguarded_ms.total_cmp(&a.unguarded_ms));
    let body = html! {
        @if bad.is_empty() {
            (verdict(true, "Every run recovered, or ended in failsafe with the neutral pulse commanded in time."))
        } @else {
            (verdict(false, &format!("{} of {} runs were unsafe.", bad.len(), outcomes.len())))
        }
        (figures.table("faults").markup())
        (figures.lines().markup())
        (blindness(outcomes)?)
        (instants(outcomes)?)
        @if !bad.is_empty() {
            h2 { "Unsafe runs" }
            (listed(&bad))
        }
        h2 { "Longest off neutral without valid data" }
        (listed(&longest[..longest.len().min(NAMED)]))
        footer {
            "The firmware image in flight on an emulated SAMD21 and BNO055; each run forks the flight at "
            "an instant of its own. Nothing here was measured on a board."
        }
    };
    Ok(page(&title, body))
}

fn ended(outcome: &Outcome) -> &'static str {
    match outcome.ending {
        Ending::Recovered => "recovered",
        Ending::Neutral => "neutral",
        Ending::Unsafe(_) => "unsafe",
    }
}

/// A set of dots for each ending.
fn endings(outcomes: &[Outcome], place: fn(&Outcome) -> (f64, f64)) -> Vec<Marks<'static>> {
    let mut marks = Vec::new();
    for (name, colour) in [("recovered", 2), ("neutral", 0), ("unsafe", 5)] {
        let runs = outcomes.iter().filter(|outcome| ended(outcome) == name);
        let points: Vec<(f64, f64)> = runs.map(place).collect();
        if !points.is_empty() {
            marks.push(Marks {
                name,
                colour,
                shape: Shape::Dot,
                points,
            });
        }
    }
    marks
}

/// A plot of dots against the time without valid data, with the deadline across it.
fn against_blindness(
    x: &str,
    log_x: bool,
    place: fn(&Outcome) -> (f64, f64),
    outcomes: &[Outcome],
) -> Result<String> {
    let all: Vec<(f64, f64)> = outcomes.iter().map(place).collect();
    let least = all.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let most = all.iter().map(|p| p.0).fold(least + 1e-3, f64::max);
    let deadline = DEADLINE.as_us_f64() / 1e3;
    let allowed = Line::new("allowed", 4, vec![(least, deadline), (most, deadline)]);
    let plot = Plot::new(x, "off neutral without valid data, ms", vec![allowed]);
    plot.svg_as(&Look {
        log_x,
        x: Some((least, most)),
        y: Some((
            0.0,
            all.iter()
                .map(|p| 1.05 * p.1)
                .fold(1.1 * deadline, f64::max),
        )),
        marks: endings(outcomes, place),
        ..Look::default()
    })
}

fn blindness(outcomes: &[Outcome]) -> Result<Markup> {
    let place = |outcome: &Outcome| (outcome.lasted_s * 1e3, outcome.unguarded_ms);
    Ok(figure(
        "A dot for each run, against how long its fault lasted.",
        against_blindness("the fault lasted, ms", true, place, outcomes)?,
    ))
}

fn instants(outcomes: &[Outcome]) -> Result<Markup> {
    let place = |outcome: &Outcome| (outcome.at_s, outcome.unguarded_ms);
    Ok(figure(
        "The same, against the instant of the flight at which it began.",
        against_blindness("since the release, s", false, place, outcomes)?,
    ))
}

/// Runs as a table.
fn listed(outcomes: &[&Outcome]) -> Markup {
    let rows = outcomes.iter().map(|outcome| {
        let ending = match outcome.ending {
            Ending::Unsafe(why) => format!("unsafe: {why}"),
            _ => ended(outcome).to_owned(),
        };
        vec![
            story(outcome),
            ending,
            format!("{:.1}", outcome.unguarded_ms),
        ]
    });
    table(
        &["run", "ended", "without valid data, ms"],
        &rows.collect::<Vec<_>>(),
    )
}
