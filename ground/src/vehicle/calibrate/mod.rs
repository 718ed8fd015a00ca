//! `tvc calibrate`: offsets, scales and iron out of a recording or out of a vehicle at a port, as parameters of the firmware.

mod declination;
mod figures;
mod guided;
mod hold;
mod keyboard;
mod picture;
mod polarity;
mod readings;
mod report;
mod servo;
mod session;
mod write;

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use calibration::{Found, Readings, fit};
use nalgebra::Vector3;
use tvc_nano::Params;

use crate::out::exit::Verdict;
use crate::out::file::{print_figures, write_whole};
use crate::vehicle::link::Parameter;
use crate::vehicle::param::file;
use figures::Figures;
mod options;
pub use options::{Calibrate, Day, Place, Servo, SetUp, place};

/// Calibrates as `options` say, prints the figures, writes the parameters and the report.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    match (&options.step, &options.from) {
        (Some(SetUp::Servo(servo)), _) => servo::run(servo, options),
        (Some(SetUp::Polarity), _) => polarity::run(options),
        (Some(SetUp::Hold { seconds }), _) => hold::run(*seconds, options),
        (None, None) => guided::run(options),
        (None, Some(log)) => {
            let declination_deg = asked_declination(options)?;
            let readings = readings::read(log)?;
            let found = fit::fit(&readings, &options.wanted());
            let rows = parameters(&found, declination_deg)?;
            let figures = Figures::new(&readings, &found, declination_deg, &rows);
            show(log, &readings, &found, &figures, options)?;
            print_figures(&figures, options.port.json, Figures::text)?;
            if !found.refused.is_empty() {
                return Ok(Verdict::Missed);
            }
            keep(&rows, options)?;
            Ok(Verdict::Met)
        }
    }
}

/// The declination that the command line asks for, deg.
fn asked_declination(options: &Calibrate) -> Result<Option<f64>> {
    match options.place {
        Some(place) => declination::declination_deg(place, options.date).map(Some),
        None => Ok(options.declination),
    }
}

/// Writes the report of `log`, and says why there is no more.
fn show(
    log: &Path,
    readings: &Readings,
    found: &Found,
    figures: &Figures,
    options: &Calibrate,
) -> Result<()> {
    let page = report::page(log, readings, found, figures)?;
    write_whole(&options.report, page.as_bytes())?;
    eprintln!("report: {}", options.report.display());
    for why in &found.refused {
        eprintln!("refused: {why}");
    }
    Ok(())
}

/// Shows figures to whoever is asked about them next: on standard output, unless that is kept for JSON.
fn tell(text: &str, json: bool) {
    if json {
        eprint!("{text}");
    } else {
        print!("{text}");
    }
}

/// Writes the parameters into their file.
fn keep(rows: &[Parameter], options: &Calibrate) -> Result<()> {
    write_whole(&options.out, file::text(rows).as_bytes())?;
    eprintln!("parameters: {}", options.out.display());
    Ok(())
}

/// The firmware's parameters, each checked against its table.
fn parameters(found: &Found, declination_deg: Option<f64>) -> Result<Vec<Parameter>> {
    const AXES: [&str; 3] = ["X", "Y", "Z"];
    let mut values: Vec<(String, f64)> = Vec::new();
    let mut vector = |prefix: &str, vector: Vector3<f64>| {
        let named = AXES.iter().zip(vector.iter());
        values.extend(named.map(|(axis, value)| (format!("{prefix}{axis}"), *value)));
    };
    if let Some(poses) = &found.poses {
        vector("CAL_ACC_O", poses.correction.offset);
        vector("CAL_ACC_S", poses.correction.matrix.diagonal());
    }
    if let Some(rest) = &found.rest {
        vector("CAL_GYR_O", rest.bias.map(f64::to_degrees));
    }
    if let Some(ellipsoid) = &found.ellipsoid {
        vector("CAL_MAG_O", ellipsoid.correction.offset);
        for (row, name) in ellipsoid.correction.matrix.row_iter().zip(AXES) {
            vector(&format!("CAL_MAG_{name}"), row.transpose());
        }
    }
    if let Some((roll, pitch)) = found.mount {
        values.push(("MNT_ROLL_DEG".into(), roll.to_degrees()));
        values.push(("MNT_PITCH_DEG".into(), pitch.to_degrees()));
    }
    if let Some(deg) = declination_deg {
        values.push(("DECLINATION_DEG".into(), deg));
    }
    let mut table = Params::default();
    values
        .into_iter()
        .map(|(name, value)| {
            let value = value as f32;
            table
                .set(&name, value)
                .map_err(|error| anyhow!("{error}, not {value}"))
                .context("the firmware does not take this calibration")?;
            Ok(Parameter { name, value })
        })
        .collect()
}
