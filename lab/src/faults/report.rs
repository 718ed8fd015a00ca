//! The HTML page of a campaign: how runs ended, by kind and by instant, and how long rudders moved
//! without valid data or wrongly.

use anyhow::Result;
use maud::{Markup, html};
use rig::faults::{DEADLINE, Kind, Plan, WRONG_LIMIT};

use super::table::{End, Row};
use report::measure::Figures;
use report::page::{figure, page, table, verdict};
use report::plot::{Line, Look, Marks, Plot, Shape};
use report::table::Table;

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
        (judged(&bad, rows, "No run was unsafe.", "runs were unsafe."))
        (figures.table("faults").markup())
        (figures.lines().markup())
        (against_blindness(
            "A dot for each run, against how long its fault lasted: the longest time off neutral \
             without valid data, or driven wrongly.",
            "the fault lasted, ms", true, |row| row.lasted_s * 1e3, rows,
        )?)
        (against_blindness(
            "The same, against the instant of the flight, or of another phase, at which it began.",
            "since the release or the phase's begin, s", false, |row| row.at_s, rows,
        )?)
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
        (judged(bad, rows, "No sound vehicle had an alarm.", "sound vehicles had alarms."))
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

/// Whether no run is `bad`, in words.
fn judged(bad: &[&Row], rows: &[Row], none: &str, some: &str) -> Markup {
    match bad.len() {
        0 => verdict(true, none),
        count => verdict(false, &format!("{count} of {} {some}", rows.len())),
    }
}

/// A plot with a dot for each run, against the time without control, with the limits across it.
fn against_blindness(
    caption: &str,
    label: &str,
    log_x: bool,
    x: fn(&Row) -> f64,
    rows: &[Row],
) -> Result<Markup> {
    let all = || rows.iter().map(x);
    let least = all().fold(f64::INFINITY, f64::min);
    let most = all().fold(least + 1e-3, f64::max);
    let across = |name, colour, ms| Line::new(name, colour, vec![(least, ms), (most, ms)]);
    let limits = [DEADLINE, WRONG_LIMIT].map(|limit| limit.as_us_f64() / 1e3);
    let lines = vec![
        across("most allowed after a fault of the sensor", 4, limits[0]),
        across("most allowed after another fault", 1, limits[1]),
    ];
    let marks = End::ALL.into_iter().zip(COLOURS).map(|((end, name), colour)| {
        let runs = rows.iter().filter(|row| row.end == end);
        let points = runs.map(|row| (x(row), row.blind_ms())).collect();
        Marks { name, colour, shape: Shape::Dot, points }
    });
    let blind_ms = rows.iter().map(|row| 1.05 * row.blind_ms());
    let svg = Plot::new(label, "without control, ms", lines).svg_as(&Look {
        log_x,
        x: Some((least, most)),
        y: Some((0.0, blind_ms.fold(1.1 * limits[1], f64::max))),
        marks: marks.filter(|marks| !marks.points.is_empty()).collect(),
        ..Look::default()
    })?;
    Ok(figure(caption, svg))
}

/// Runs that were not recovered from and those that were unsafe, of each kind, by the instant at
/// which the fault began.
fn by_instant(rows: &[Row]) -> Markup {
    let last = rows.iter().map(|row| row.at_s).fold(0.0, f64::max);
    let slots = (last / SLOT_S) as usize + 1;
    let mut head = vec!["fault".to_owned()];
    head.extend((0..slots).map(|slot| format!("from {:.1} s", slot as f64 * SLOT_S)));
    let of_kind = |kind: Kind| {
        let mut cells = vec![kind.name().to_owned()];
        cells.extend((0..slots).map(|slot| {
            let is_here = |row: &&Row| row.kind == kind && (row.at_s / SLOT_S) as usize == slot;
            let ends: Vec<End> = rows.iter().filter(is_here).map(|row| row.end).collect();
            let ended = ends.iter().filter(|end| **end != End::Recovered).count();
            match ends.iter().filter(|end| **end == End::Unsafe).count() {
                0 => format!("{ended} of {}", ends.len()),
                bad => format!("{ended} of {}, {bad} unsafe", ends.len()),
            }
        }));
        cells
    };
    let kinds = Kind::all().into_iter();
    let flown = kinds.filter(|kind| rows.iter().any(|row| row.kind == *kind));
    html! {
        p { "Runs that did not end in control, of all at that instant." }
        (Table::new(head, flown.map(of_kind)).markup())
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
