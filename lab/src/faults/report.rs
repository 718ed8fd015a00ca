//! The HTML page of a campaign: how runs ended, by kind and by instant, and how long rudders moved
//! without valid data or wrongly.

use anyhow::Result;
use maud::{Markup, html};
use rig::faults::{DEADLINE, Kind, Plan, WRONG_LIMIT};

use super::table::{End, Row};
use report::measure::Figures;
use report::page::{figure, page, table, verdict};
use report::plot::{Line, Look, Marks, Plot, Shape};

/// Runs that the page names, those longest without control first.
const NAMED: usize = 10;
/// Colours of the endings, in their order.
const COLOURS: [usize; 5] = [2, 0, 3, 5, 4];
/// Columns of the table by instant, s.
const SLOT_S: f64 = 0.2;

/// The whole page; `rows` is not empty.
pub fn render(figures: &Figures, rows: &[Row]) -> Result<String> {
    let Row { campaign, phase, seed, .. } = rows[0];
    let what = match campaign {
        Plan::Resets | Plan::Sound => campaign.to_string(),
        _ => format!("{campaign} in phase {phase}"),
    };
    let title = format!("{what}: {} runs, seed {seed}", rows.len());
    let bad: Vec<&Row> = rows.iter().filter(|row| row.end.is_bad()).collect();
    if campaign == Plan::Sound {
        return Ok(page(&title, of_sound(figures, rows, &bad)));
    }
    let mut longest: Vec<&Row> = rows.iter().collect();
    longest.sort_by(|a, b| b.blind_ms().total_cmp(&a.blind_ms()));
    let body = html! {
        @if bad.is_empty() {
            (verdict(true, "No run was unsafe."))
        } @else {
            (verdict(false, &format!("{} of {} runs were unsafe.", bad.len(), rows.len())))
        }
        (figures.table("faults").markup())
        (figures.lines().markup())
        (blindness(rows)?)
        (instants(rows)?)
        h2 { "By kind and instant" }
        (by_instant(rows))
        @if !bad.is_empty() {
            h2 { "Unsafe runs" }
            (listed(&bad))
        }
        h2 { "Longest without control" }
        (listed(&longest[..longest.len().min(NAMED)]))
        footer {
            "The firmware image on an emulated SAMD21 and BNO055; each run forks the flight, or another phase, at "
            "an instant of its own. Nothing here was measured on a board."
        }
    };
    Ok(page(&title, body))
}

/// The page of sound vehicles.
fn of_sound(figures: &Figures, rows: &[Row], bad: &[&Row]) -> Markup {
    let listed = bad.iter().map(|row| vec![row.story(), row.why.clone()]);
    html! {
        @if bad.is_empty() {
            (verdict(true, "No sound vehicle had an alarm."))
        } @else {
            (verdict(false, &format!("{} of {} sound vehicles had alarms.", bad.len(), rows.len())))
        }
        (figures.table("sound").markup())
        (figures.lines().markup())
        @if !bad.is_empty() {
            h2 { "Alarms" }
            (table(&["run", "alarms"], &listed.collect::<Vec<_>>()))
        }
        footer {
            "The firmware image on an emulated SAMD21 and BNO055, nothing of which fails; each run has parts of "
            "its own. Nothing here was measured on a board."
        }
    }
}

fn name(end: End) -> &'static str {
    let named = End::ALL.into_iter().find(|(one, _)| *one == end);
    named.map_or("", |(_, name)| name)
}

/// A set of dots for each ending.
fn endings(rows: &[Row], place: fn(&Row) -> (f64, f64)) -> Vec<Marks<'static>> {
    let mut marks = Vec::new();
    for ((end, name), colour) in End::ALL.into_iter().zip(COLOURS) {
        let runs = rows.iter().filter(|row| row.end == end);
        let points: Vec<(f64, f64)> = runs.map(place).collect();
        if !points.is_empty() {
            marks.push(Marks { name, colour, shape: Shape::Dot, points });
        }
    }
    marks
}

/// A plot of dots against the time without control, with the limits across it.
fn against_blindness(
    x: &str,
    log_x: bool,
    place: fn(&Row) -> (f64, f64),
    rows: &[Row],
) -> Result<String> {
    let all: Vec<(f64, f64)> = rows.iter().map(place).collect();
    let least = all.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let most = all.iter().map(|p| p.0).fold(least + 1e-3, f64::max);
    let across = |name, colour, ms| Line::new(name, colour, vec![(least, ms), (most, ms)]);
    let limits = [DEADLINE, WRONG_LIMIT].map(|limit| limit.as_us_f64() / 1e3);
    let lines = vec![
        across("most allowed after a fault of the sensor", 4, limits[0]),
        across("most allowed after another fault", 1, limits[1]),
    ];
    let plot = Plot::new(x, "without control, ms", lines);
    plot.svg_as(&Look {
        log_x,
        x: Some((least, most)),
        y: Some((0.0, all.iter().map(|p| 1.05 * p.1).fold(1.1 * limits[1], f64::max))),
        marks: endings(rows, place),
        ..Look::default()
    })
}

fn blindness(rows: &[Row]) -> Result<Markup> {
    let place = |row: &Row| (row.lasted_s * 1e3, row.blind_ms());
    Ok(figure(
        "A dot for each run, against how long its fault lasted: the longest time off neutral without \
         valid data, or driven wrongly.",
        against_blindness("the fault lasted, ms", true, place, rows)?,
    ))
}

fn instants(rows: &[Row]) -> Result<Markup> {
    let place = |row: &Row| (row.at_s, row.blind_ms());
    Ok(figure(
        "The same, against the instant of the flight, or of another phase, at which it began.",
        against_blindness("since the release or the phase's begin, s", false, place, rows)?,
    ))
}

/// Runs that were not recovered from and those that were unsafe, of each kind, by the instant at
/// which the fault began.
fn by_instant(rows: &[Row]) -> Markup {
    let last = rows.iter().map(|row| row.at_s).fold(0.0, f64::max);
    let slots = (last / SLOT_S) as usize + 1;
    let mut head = vec!["fault".to_owned()];
    head.extend((0..slots).map(|slot| format!("from {:.1} s", slot as f64 * SLOT_S)));
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let of_kind = |kind: Kind| {
        let mut cells = vec![kind.name().to_owned()];
        cells.extend((0..slots).map(|slot| {
            let runs = || {
                rows.iter()
                    .filter(move |row| row.kind == kind && (row.at_s / SLOT_S) as usize == slot)
            };
            let ended = runs().filter(|row| row.end != End::Recovered).count();
            match runs().filter(|row| row.end == End::Unsafe).count() {
                0 => format!("{ended} of {}", runs().count()),
                bad => format!("{ended} of {}, {bad} unsafe", runs().count()),
            }
        }));
        cells
    };
    let kinds = Kind::all().into_iter();
    let flown = kinds.filter(|kind| rows.iter().any(|row| row.kind == *kind));
    html! {
        p { "Runs that did not end in control, of all at that instant." }
        (table(&head, &flown.map(of_kind).collect::<Vec<_>>()))
    }
}

/// Runs as a table.
fn listed(rows: &[&Row]) -> Markup {
    let rows = rows.iter().map(|row| {
        let ending = match row.why.as_str() {
            "" => name(row.end).to_owned(),
            why => format!("{}: {why}", name(row.end)),
        };
        vec![row.story(), ending, format!("{:.1}", row.blind_ms())]
    });
    table(&["run", "ended", "without control, ms"], &rows.collect::<Vec<_>>())
}
