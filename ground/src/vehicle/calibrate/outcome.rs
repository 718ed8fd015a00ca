//! What a calibration comes to: parameters of the firmware, figures and a report.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use calibration::{Found, Readings};
use nalgebra::{Rotation3, Vector3};
use tvc_nano::Params;

use super::figures::figures;
use super::options::Files;
use super::report;
use ::report::file::write_whole;
use ::report::measure::Figures;
use client::Parameter;
use flights::param_file;

/// Parameters and figures of a calibration.
pub struct Outcome {
    /// The firmware's parameters.
    pub rows: Vec<Parameter>,
    /// The same and more for people and scripts.
    pub figures: Figures,
    /// Why something could not be calibrated.
    pub refused: Vec<String>,
    page: String,
}

impl Outcome {
    /// Out of what was found in the readings of `log`.
    ///
    /// # Errors
    /// The firmware does not take a parameter.
    pub fn of(
        log: &Path,
        readings: &Readings,
        found: &Found,
        declination_deg: Option<f64>,
    ) -> Result<Self> {
        let rows = parameters(found, declination_deg, &readings.parameters)?;
        let figures = figures(readings, found, declination_deg, &rows);
        let page = report::page(log, readings, found, &figures)?;
        Ok(Self { rows, figures, refused: found.refused.clone(), page })
    }

    /// Writes the page and, unless something was refused, the parameters; says where they are and
    /// what was refused.
    ///
    /// # Errors
    /// A file cannot be written; the other one is.
    pub fn write(&self, files: &Files, tell: &mut dyn FnMut(&str)) -> Result<()> {
        let mut write = |what: &str, path: &Path, text: &str| {
            write_whole(path, text.as_bytes())?;
            tell(&format!("{what}: {}", path.display()));
            Ok(())
        };
        let page = write("report", &files.report, &self.page);
        let rows = match self.refused.is_empty() {
            true => write("parameters", &files.out, &param_file::text(&self.rows)),
            false => Ok(()),
        };
        for why in &self.refused {
            tell(&format!("refused: {why}"));
        }
        page.and(rows)
    }
}

/// The firmware's parameters, each checked against its table.
fn parameters(
    found: &Found,
    declination_deg: Option<f64>,
    of_vehicle: &BTreeMap<String, f32>,
) -> Result<Vec<Parameter>> {
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
    if of_vehicle.get("FUSE_ACC") == Some(&0.0)
        && let Some(per_g) = &found.per_g
    {
        let [roll, pitch, yaw] = ["ROLL", "PITCH", "YAW"].map(|angle| {
            let deg = of_vehicle.get(&format!("MNT_{angle}_DEG"));
            f64::from(deg.copied().unwrap_or_default()).to_radians()
        });
        let (roll, pitch) = found.mount.unwrap_or((roll, pitch));
        let to_body = Rotation3::from_euler_angles(roll, pitch, yaw);
        let up = to_body.inverse() * -Vector3::z();
        let shift = (to_body * (per_g.matrix * up)).map(f64::to_degrees);
        values.push(("GYR_PER_G".into(), per_g.deviation.to_degrees()));
        values.push(("GYR_PER_G_X".into(), shift.x));
        values.push(("GYR_PER_G_Y".into(), shift.y));
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
