//! Several logs in one report: their releases in one table and over each other.

use std::path::{Path, PathBuf};

use anyhow::Result;
use maud::html;

use super::figures;
use flights::figures::{response, servo};
use flights::log::{Flight, Step};
use report::exit::Verdict;
use report::file::{hand_over, print, print_json};
use report::measure::{Figure, Figures, data, figure, judged, rows};
use report::page;
use report::plot::{Line, Plot};
use tvc_nano::Axis;

/// Reads the logs, prints the table of their releases, writes the page, and names the requirements
/// that are missed.
pub fn run(logs: &[PathBuf], page: &Path, json: bool) -> Result<Verdict> {
    let read = |path: &PathBuf| Ok((path.display().to_string(), Flight::read(path)?));
    let flights = logs.iter().map(read).collect::<Result<Vec<_>>>()?;
    let of_logs: Vec<Figures> = flights.iter().map(|(_, flight)| figures(flight)).collect();
    let missed = missed(&flights, &of_logs);
    let table = table(&flights);
    let body = html! {
        (page::verdicts(&missed))
        h2 { "Step responses" }
        (table.table().markup())
        (overlaid(&flights)?)
        @for ((name, _), figures) in flights.iter().zip(&of_logs) {
            h2 { (name) }
            (figures.lines().markup())
        }
    };
    let title = format!("Report of {} logs", flights.len());
    let text = page::page(&title, body);
    let printed = if json {
        let logs = flights
            .iter()
            .zip(&of_logs)
            .map(|((name, _), figures)| serde_json::json!({ "log": name, "figures": figures }));
        let logs: Vec<_> = logs.collect();
        let missed = of_logs.iter().enumerate().flat_map(|(index, figures)| {
            let keys = figures.missed_keys().into_iter();
            keys.map(move |key| format!("logs[{index}].figures.{key}"))
        });
        let figures = [vec![table, data("logs", &logs)], judged(missed.collect())];
        print_json(&Figures::from(figures.concat()))
    } else {
        print(table.table().text())
    };
    hand_over(printed, Some((page, text)), &missed)
}

/// A sentence for each requirement that a log misses.
fn missed(flights: &[(String, Flight)], figures: &[Figures]) -> Vec<String> {
    let named = flights.iter().zip(figures).flat_map(|((name, _), figures)| {
        let missed = figures.missed().into_iter();
        missed.map(move |sentence| format!("{name}: {sentence}"))
    });
    named.collect()
}

/// A row for each release that is a step response.
fn table(flights: &[(String, Flight)]) -> Figure {
    let rows_of = flights.iter().flat_map(|(name, flight)| {
        let servo = servo(&flight.parameters());
        let releases = flight.releases();
        let row = |(index, release)| {
            let run = response(release, Axis::Pitch)?;
            let head = [
                figure("log", name.as_str()).shown("log", "", 0),
                figure("release", index as u64 + 1).shown("release", "", 0),
            ];
            Some(head.into_iter().chain(run.figures(servo)).collect::<Vec<_>>())
        };
        releases.iter().enumerate().filter_map(row).collect::<Vec<_>>()
    });
    rows("releases", rows_of)
}

/// Pitch and the servo's pulse of every release.
fn overlaid(flights: &[(String, Flight)]) -> Result<maud::Markup> {
    let releases: Vec<_> = flights
        .iter()
        .flat_map(|(name, flight)| {
            let numbered = flight.releases().into_iter().enumerate();
            numbered.map(move |(index, release)| (format!("{name}, {}", index + 1), release))
        })
        .collect();
    let plot = |label, of: &dyn Fn(&Step) -> f64| {
        let numbered = releases.iter().enumerate();
        let lines =
            numbered.map(|(colour, (name, release))| Line::new(name, colour, release.trace(of)));
        Plot::new("time since release, s", label, lines.collect()).svg()
    };
    Ok(html! {
        @if !releases.is_empty() {
            h2 { "Every release" }
            (page::figure("Pitch.", plot("pitch, deg", &|step| step.pitch_rad().to_degrees())?))
            (page::figure("The pulse commanded.", plot("pulse, us", &|step| f64::from(step.pulses_us[0]))?))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::logs::inspect::tests::{flight, write};
    use flights::log::Log;

    #[test]
    fn releases_of_all_logs_stand_in_one_table_and_each_log_is_judged() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        write(&flight(), &path("a.tlog"));
        write(&Log { entries: flight().entries[..9].to_vec(), ..Log::default() }, &path("b.mcap"));
        let logs = [path("a.tlog"), path("b.mcap")];
        let verdict = run(&logs, &path("both.html"), false).unwrap();
        assert_eq!(verdict, Verdict::Missed);
        let text = std::fs::read_to_string(path("both.html")).unwrap();
        // The second has no release, and says so.
        assert!(text.contains("a.tlog") && text.contains("b.mcap: releases: none"), "{text}");
        assert_eq!(text.matches("<svg").count(), 2);
    }
}
