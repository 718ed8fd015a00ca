//! The HTML report of `lab experiment`: tables as 6.1 to 6.3 of the thesis, plots as its figures
//! 6.4, 6.5 and A.4 to A.23.

use anyhow::Result;
use maud::{Markup, html};

use super::candidates::{CANDIDATES, Origin};
use super::figures::{AXES, Estimator, signals};
use super::truth::{Angles, Kind, TimedSample};
use report::measure::Figures;
use report::page::{figure, page, verdict};
use report::plot::{Line, Plot};

/// Colour of the reference in every plot.
const REFERENCE: usize = 4;
/// Colours of the estimates; more lines than these in one plot could not be told apart.
const COLOURS: [usize; 5] = [0, 1, 2, 3, 5];

/// The whole page.
pub fn render(
    traces: &Traces<'_>,
    seed: u64,
    figures: &Figures,
    estimators: &[Estimator],
) -> Result<String> {
    let kind = traces.kind;
    let counted = traces.samples.iter().filter(|sample| kind.counts(sample.time_s)).count();
    let missed = figures.missed();
    let body = html! {
        @if missed.is_empty() {
            (verdict(true, "Mahony and VQF, in float and fixed point, meet the requirements."))
        }
        @for line in &missed { (verdict(false, line)) }
        p {
            (conditions(kind)) " All estimators have had the same samples of one simulated BNO055, 100 a \
            second, seed " (seed) "; errors are estimate less reference over "
            (counted) " samples."
        }
        h2 { "Errors" }
        div style="font-size: .85rem" { (figures.table("estimators").markup()) }
        p { "Last column: the combined RMSE of the thesis, table 6.3, measured on a robot's arm." }
        h2 { "Estimates" }
        (signals(estimators).markup())
        p {
            "Mean and standard deviation of the estimates themselves, as in table "
            (if kind == Kind::Static { "6.1" } else { "6.2" }) " of the thesis."
        }
        h2 { "All estimators, axis by axis" }
        (traces.combined()?)
        h2 { "Estimator by estimator" }
        (traces.stacked()?)
        h2 { "Axis by axis, each estimator alone" }
        (traces.tiled()?)
        footer {
            "Simulated sensors, nothing here was measured. The same options and seed give the same \
             figures."
        }
    };
    Ok(page(&format!("Navigation experiment of the thesis: {}", title(kind)), body))
}

fn title(kind: Kind) -> &'static str {
    match kind {
        Kind::Static => "ten minutes at rest",
        Kind::Motion => "three cycles of pitch",
    }
}

fn conditions(kind: Kind) -> String {
    let heading = kind.heading_deg();
    match kind {
        Kind::Static => format!("At rest and level for ten minutes, heading {heading} deg."),
        Kind::Motion => format!(
            "Heading {heading} deg; after ten seconds of rest three cycles of +-45 deg of pitch, over \
             which errors are taken."
        ),
    }
}

/// What is drawn.
pub struct Traces<'a> {
    /// Which experiment.
    pub kind: Kind,
    /// Its samples.
    pub samples: &'a [TimedSample],
    /// What each candidate estimated.
    pub estimates: &'a [Vec<Angles>],
}

impl Traces<'_> {
    /// Time (s) and angle (deg) of a line; yaw is drawn as its difference to the true heading.
    fn points(&self, axis: usize, angles: impl Iterator<Item = Angles>) -> Vec<(f64, f64)> {
        let origin = if axis == 2 { self.kind.heading_deg() } else { 0.0 };
        self.samples
            .iter()
            .zip(angles)
            .filter(|(sample, _)| sample.time_s >= 0.0)
            .map(|(sample, angles)| (sample.time_s, angles[axis] - origin))
            .collect()
    }

    fn reference(&self, axis: usize) -> Line<'_> {
        let angles = self.samples.iter().map(|sample| sample.reference_deg);
        Line::new("reference", REFERENCE, self.points(axis, angles))
    }

    fn estimate(&self, axis: usize, index: usize, colour: usize) -> Line<'_> {
        let angles = self.estimates[index].iter().copied();
        Line::new(CANDIDATES[index].name, colour, self.points(axis, angles))
    }

    /// Estimate less reference.
    fn error(&self, axis: usize, index: usize, colour: usize) -> Line<'_> {
        let mut line = self.estimate(axis, index, colour);
        for ((_, estimate), (_, reference)) in
            line.points.iter_mut().zip(self.reference(axis).points)
        {
            *estimate -= reference;
        }
        line
    }

    fn plot<'a>(&self, y: &'a str, lines: Vec<Line<'a>>) -> Result<String> {
        Plot::new("time, s", y, lines).svg()
    }

    /// A plot for each axis, with the estimators of the thesis, and one with ours (figures 6.4,
    /// 6.5, A.12, A.13, A.22, A.23).
    fn combined(&self) -> Result<Markup> {
        let mut figures = Vec::new();
        // Pitch first, the axis that the drone turns about.
        for axis in [1, 0, 2] {
            for (whose, of_thesis) in [("the thesis' estimators", true), ("our estimators", false)]
            {
                let mut lines = vec![self.reference(axis)];
                let mut errors = Vec::new();
                let chosen = (0..CANDIDATES.len())
                    .filter(|&index| (CANDIDATES[index].origin == Origin::Thesis) == of_thesis);
                for (index, colour) in chosen.zip(COLOURS) {
                    lines.push(self.estimate(axis, index, colour));
                    errors.push(self.error(axis, index, colour));
                }
                let caption = format!("{}: {whose}.", capital(AXES[axis]));
                figures.push(figure(&caption, self.plot(label(axis), lines)?));
                if self.kind == Kind::Motion && axis == 1 {
                    let caption = format!("Error of the pitch: {whose}.");
                    figures.push(figure(&caption, self.plot("pitch error, deg", errors)?));
                }
            }
        }
        Ok(html! { @for figure in &figures { (figure) } })
    }

    /// A plot for each estimator, with its three axes (figures A.4 to A.8, A.14 to A.18).
    fn stacked(&self) -> Result<Markup> {
        let mut figures = Vec::new();
        let axes = || AXES.iter().enumerate().zip(COLOURS);
        let mut lines = Vec::new();
        for ((axis, name), colour) in axes() {
            lines.push(Line { name, colour, ..self.reference(axis) });
        }
        figures.push(figure("Reference.", self.plot(STACKED, lines)?));
        for (index, candidate) in CANDIDATES.iter().enumerate() {
            let mut lines = Vec::new();
            for ((axis, name), colour) in axes() {
                lines.push(Line { name, ..self.estimate(axis, index, colour) });
            }
            let caption = format!("{}.", capital(candidate.name));
            figures.push(figure(&caption, self.plot(STACKED, lines)?));
        }
        Ok(html! { @for figure in &figures { (figure) } })
    }

    /// A row of tiles for each axis, with a tile for each estimator (figures A.9 to A.11, A.19 to
    /// A.21).
    fn tiled(&self) -> Result<Markup> {
        let mut rows = Vec::new();
        for (axis, name) in AXES.iter().enumerate() {
            let mut tiles = Vec::new();
            for (index, candidate) in CANDIDATES.iter().enumerate() {
                let lines = vec![self.reference(axis), self.estimate(axis, index, COLOURS[0])];
                let caption = format!("{}: {}.", capital(name), candidate.name);
                tiles.push(figure(&caption, self.plot(label(axis), lines)?));
            }
            rows.push(html! {
                div style="display: grid; grid-template-columns: 1fr 1fr; column-gap: 1rem" {
                    @for tile in &tiles { (tile) }
                }
            });
        }
        Ok(html! { @for row in &rows { (row) } })
    }
}

const STACKED: &str = "angle, deg (yaw from the true heading)";

fn label(axis: usize) -> &'static str {
    ["roll, deg", "pitch, deg", "yaw from the true heading, deg"][axis]
}

fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}
