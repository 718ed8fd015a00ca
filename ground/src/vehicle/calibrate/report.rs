//! The HTML report: each sensor before and after, and the directions that were seen.

use std::path::Path;

use anyhow::Result;
use calibration::coverage::{AROUND, BANDS, Coverage};
use calibration::{Found, Readings};
use maud::{Markup, html};
use nalgebra::Vector3;

use report::measure::Figures;
use report::page;
use report::plot::{Line, Look, Marks, Plot, Shape};

/// Largest number of points that are drawn of a cloud.
const MOST_POINTS: usize = 600;
/// Size of a cell of the coverage picture, SVG units.
const CELL: usize = 44;

/// The whole page.
///
/// # Errors
/// A plot cannot be drawn.
pub fn page(log: &Path, readings: &Readings, found: &Found, figures: &Figures) -> Result<String> {
    let verdict = if found.refused.is_empty() {
        page::verdict(true, "Every sensor is calibrated.")
    } else {
        html! { @for why in &found.refused { (page::verdict(false, why)) } }
    };
    let mut body = html! {
        p { (readings.samples.len()) " samples of " (log.display()) }
        (verdict)
        (figures.lines().markup())
    };
    let samples = &readings.samples;
    let times: Vec<f64> = samples.iter().map(|m| m.time_s).collect();
    let (gyr, acc, mag) = (found.gyr(), found.acc(), found.mag());

    let norm = |of: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        times.iter().enumerate().map(|(i, t)| (*t, of(i))).collect()
    };
    body = html! { (body)
        h2 { "Accelerometer" }
        (before_and_after(
            "Strength of the specific force: a sensor at rest feels gravity, whichever way it lies.",
            "force, m/s2",
            norm(&|i| samples[i].acc.norm()),
            found.poses.map(|_| norm(&|i| acc.apply(&samples[i].acc).norm())),
        )?)
        h2 { "Gyroscope" }
        (before_and_after(
            "Strength of the rate: zero at rest.",
            "rate, deg/s",
            norm(&|i| samples[i].gyr.norm().to_degrees()),
            found.rest.map(|_| norm(&|i| gyr.apply(&samples[i].gyr).norm().to_degrees())),
        )?)
    };
    let fields = readings.fields();
    if !fields.is_empty() {
        let corrected: Vec<Vector3<f64>> = fields.iter().map(|m| mag.apply(m)).collect();
        let strength = |fields: &[Vector3<f64>]| -> Vec<(f64, f64)> {
            let times = readings.fresh.iter().map(|i| times[*i]);
            times.zip(fields.iter().map(|m| m.norm())).collect()
        };
        let coverage =
            found.ellipsoid.map_or_else(|| fields.iter().copied().collect(), |e| e.coverage);
        let after = found.ellipsoid.map(|_| corrected.as_slice());
        body = html! { (body)
            h2 { "Magnetometer" }
            (before_and_after(
                "Strength of the field: the same in every direction.",
                "field, uT",
                strength(&fields),
                after.map(strength),
            )?)
            (cloud("The horizontal plane of the sensor.", &fields, after, |m| (m.x, m.y), ("x, uT", "y, uT"))?)
            (cloud("A vertical plane of the sensor.", &fields, after, |m| (m.x, m.z), ("x, uT", "z, uT"))?)
            h2 { "Directions of the field that were seen" }
            (page::figure(
                "Each cell is the same part of the sphere: azimuth along the width, from -180 deg, z upwards. Dark \
                 cells were seen often, white ones never.",
                cells(&coverage),
            ))
        };
    }
    Ok(page::page("Calibration", body))
}

fn before_and_after(
    caption: &str,
    y: &str,
    before: Vec<(f64, f64)>,
    after: Option<Vec<(f64, f64)>>,
) -> Result<Markup> {
    let mut lines = vec![Line::new("before", 1, before)];
    lines.extend(after.map(|points| Line::new("after", 0, points)));
    Ok(page::figure(caption, Plot::new("time, s", y, lines).svg()?))
}

fn cloud(
    caption: &str,
    before: &[Vector3<f64>],
    after: Option<&[Vector3<f64>]>,
    plane: fn(&Vector3<f64>) -> (f64, f64),
    (x, y): (&str, &str),
) -> Result<Markup> {
    let every = before.len().div_ceil(MOST_POINTS).max(1);
    let marks = |name, colour, fields: &[Vector3<f64>]| Marks {
        name,
        colour,
        shape: Shape::Dot,
        points: fields.iter().step_by(every).map(plane).collect(),
    };
    let mut clouds = vec![marks("before", 1, before)];
    clouds.extend(after.map(|fields| marks("after", 0, fields)));
    let reach = clouds
        .iter()
        .flat_map(|cloud| &cloud.points)
        .map(|(x, y)| x.abs().max(y.abs()))
        .fold(1.0, f64::max)
        * 1.05;
    let plot = Plot::new(x, y, Vec::new());
    // The picture is as high as its x axis is long, so that a sphere is a circle.
    let look = Look {
        x: Some((-reach, reach)),
        y: Some((-reach, reach)),
        height: Some(818),
        marks: clouds,
        ..Look::default()
    };
    Ok(page::figure(caption, plot.svg_as(&look)?))
}

/// The sphere's cells as a picture.
fn cells(coverage: &Coverage) -> String {
    let most = coverage.counts().as_flattened().iter().max();
    let most = f64::from(most.copied().unwrap_or(0).max(1));
    let (width, height) = (AROUND * CELL, BANDS * CELL);
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {width} {height}"))
            style=(format!("max-width:{}px", 2 * width)) {
            @for (band, cells) in coverage.counts().iter().enumerate() {
                @for (around, count) in cells.iter().enumerate() {
                    rect x=(around * CELL) y=((BANDS - 1 - band) * CELL) width=(CELL) height=(CELL)
                        stroke="#888" fill="#005ab5"
                        fill-opacity=(format!("{:.2}", (f64::from(*count) / most).sqrt())) {}
                }
            }
        }
    };
    svg.into_string()
}
