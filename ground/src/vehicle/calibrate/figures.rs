//! The figures of `tvc calibrate`.

use std::collections::BTreeMap;

use calibration::{Found, Readings, STANDARD_GRAVITY};
use client::Parameter;
use nalgebra::{Matrix3, Vector3};
use report::measure::{Figure, Figures, Value, data, figure, rows, shown};

/// What was found, and the parameters that come of it.
pub fn figures(
    readings: &Readings,
    found: &Found,
    declination_deg: Option<f64>,
    parameters: &[Parameter],
) -> Figures {
    let gyr = found.rest.map(|rest| {
        let before = rest.bias.norm().to_degrees();
        let offset = rest.bias.map(f64::to_degrees);
        let noise = rest.noise.map(f64::to_degrees);
        [
            vector("offset_deg_s", offset).said("gyroscope offset, deg/s", words(&offset, 3)),
            vector("noise_deg_s", noise),
            figure("rest_s", rest.seconds).shown("  out of a rest of", "s", 1),
            change("before_deg_s", "  rate at rest", [before, 0.0], "deg/s", 3),
        ]
    });
    let acc = found.poses.map(|poses| {
        let mg = 1000.0 / STANDARD_GRAVITY;
        let scale = poses.correction.matrix.diagonal();
        let offset = poses.correction.offset * mg;
        let [before, after] = [poses.before * mg, poses.residual * mg];
        [
            vector("offset_mg", offset).said("accelerometer offset, mg", words(&offset, 1)),
            vector("scale", scale).said("  scale", words(&scale, 4)),
            figure("residual_mg", after),
            change("before_mg", "  off gravity, rms", [before, after], "mg", 1),
            figure("poses", poses.count).shown("  poses", "", 0),
        ]
    });
    let per_g = found.per_g.map(|per_g| {
        let matrix = per_g.matrix.map(f64::to_degrees);
        let label = "gyroscope's shift, deg/s for each g, at most";
        [
            data("matrix_deg_s", &by_rows(&matrix)),
            figure("largest_deg_s", matrix.amax()).shown(label, "", 3),
            figure("deviation_deg_s", per_g.deviation.to_degrees()).shown("  known to", "", 4),
        ]
    });
    let mag = found.ellipsoid.map(|ellipsoid| {
        let offset = ellipsoid.correction.offset;
        let [before, after] = [readings.field_spread_ut(), ellipsoid.residual];
        let soft_iron = ellipsoid.correction.matrix;
        let labels = ["  soft iron undone, x", "  y", "  z"].into_iter().zip(soft_iron.row_iter());
        let soft_iron_rows = labels.map(|(label, row)| shown(label, words(&row.transpose(), 3)));
        let (dip, off) = found.dip.map(|(dip, off)| (dip.to_degrees(), off.to_degrees())).unzip();
        let dip_words = dip.zip(off).map(|(dip, off)| format!("{dip:.1}, to {off:.1}"));
        let mut figures = vec![
            vector("offset_ut", offset).said("hard iron, uT", words(&offset, 1)),
            data("matrix", &by_rows(&soft_iron)),
        ];
        figures.extend(soft_iron_rows);
        figures.extend([
            figure("strength_ut", ellipsoid.strength).shown("  strength", "uT", 1),
            figure("residual_ut", after),
            change("before_ut", "  varies by, rms", [before, after], "uT", 2),
            figure("coverage_pct", 100.0 * ellipsoid.coverage.share()).shown(
                "  directions seen",
                "%",
                0,
            ),
            figure("used", ellipsoid.used),
            figure("outliers", ellipsoid.outliers),
            figure("dip_deg", dip).said("  dip, deg", dip_words.unwrap_or_default()),
            figure("dip_deviation_deg", off),
        ]);
        figures
    });
    let mount = found.mount.map(|(roll, pitch)| [roll, pitch].map(f64::to_degrees));
    let mount_words = mount.map(|[roll, pitch]| format!("{roll:.2}  {pitch:.2}"));
    let mount_deg = data("mount_deg", &mount);
    Figures::from([
        figure("samples", readings.samples.len()),
        figure("gyr", gyr),
        figure("acc", acc),
        figure("per_g", per_g),
        figure("mag", mag),
        match mount_words {
            Some(words) => mount_deg.said("mount roll, pitch, deg", words),
            None => mount_deg,
        },
        figure("declination_deg", declination_deg).shown("declination", "deg", 2).or(""),
        data("gyr_by_acc", &found.by_gravity.as_ref().map(by_rows)),
        data("gyr_by_mag", &found.by_field.as_ref().map(by_rows)),
        named(parameters),
        rows("refused", found.refused.iter().map(|why| Value::from(&**why))),
    ])
}

/// Parameters by their names.
pub fn named(parameters: &[Parameter]) -> Figure {
    let named = parameters.iter().map(|row| (&row.name, row.value));
    data("parameters", &named.collect::<BTreeMap<_, _>>())
}

fn vector(key: &'static str, vector: Vector3<f64>) -> Figure {
    data(key, &<[f64; 3]>::from(vector))
}

fn words(vector: &Vector3<f64>, digits: usize) -> String {
    let parts = vector.iter().map(|part| match format!("{part:.digits$}") {
        // A rounded zero has no sign.
        zero if zero.parse() == Ok(0.0) => format!("{:.digits$}", 0.0),
        number => number,
    });
    parts.collect::<Vec<_>>().join("  ")
}

/// A figure before and after.
fn change(
    key: &'static str,
    label: &str,
    [before, after]: [f64; 2],
    unit: &str,
    digits: usize,
) -> Figure {
    let words = format!("{before:.digits$} -> {after:.digits$} {unit}");
    figure(key, before).said(label, words)
}

fn by_rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}
