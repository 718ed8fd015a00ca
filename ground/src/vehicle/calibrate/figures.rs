//! The figures of `tvc calibrate`.

use calibration::{Found, Readings, STANDARD_GRAVITY};
use nalgebra::Matrix3;
use serde::Serialize;

use client::Parameter;

/// Everything that `tvc calibrate --json` prints, as one object.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// Number of samples.
    pub samples: usize,
    gyr: Option<Gyr>,
    acc: Option<Acc>,
    mag: Option<Mag>,
    declination_deg: Option<f64>,
    mount_deg: Option<[f64; 2]>,
    /// The matrix that makes the gyroscope agree with the accelerometer; below, with the
    /// magnetometer.
    gyr_by_acc: Option<[[f64; 3]; 3]>,
    gyr_by_mag: Option<[[f64; 3]; 3]>,
    parameters: serde_json::Map<String, serde_json::Value>,
    /// Why something could not be calibrated.
    pub refused: Vec<String>,
    /// Whether the vehicle has the parameters in its flash.
    pub written: bool,
}

#[derive(Debug, Serialize)]
struct Gyr {
    offset_deg_s: [f64; 3],
    noise_deg_s: [f64; 3],
    rest_s: f64,
    /// Rate that the uncalibrated sensor reads at rest.
    before_deg_s: f64,
}

#[derive(Debug, Serialize)]
struct Acc {
    offset_mg: [f64; 3],
    scale: [f64; 3],
    residual_mg: f64,
    /// Deviation of the uncalibrated poses from gravity, rms.
    before_mg: f64,
    poses: usize,
}

#[derive(Debug, Serialize)]
struct Mag {
    offset_ut: [f64; 3],
    matrix: [[f64; 3]; 3],
    strength_ut: f64,
    residual_ut: f64,
    /// Standard deviation of the uncalibrated strength.
    before_ut: f64,
    coverage_pct: f64,
    used: usize,
    outliers: usize,
    dip_deg: Option<f64>,
    dip_deviation_deg: Option<f64>,
}

impl Figures {
    /// Out of what was found.
    pub fn new(
        readings: &Readings,
        found: &Found,
        declination_deg: Option<f64>,
        rows: &[Parameter],
    ) -> Self {
        let mg = 1000.0 / STANDARD_GRAVITY;
        Self {
            samples: readings.samples.len(),
            gyr: found.rest.map(|rest| Gyr {
                offset_deg_s: rest.bias.map(f64::to_degrees).into(),
                noise_deg_s: rest.noise.map(f64::to_degrees).into(),
                rest_s: rest.seconds,
                before_deg_s: rest.bias.norm().to_degrees(),
            }),
            acc: found.poses.map(|poses| Acc {
                offset_mg: (poses.correction.offset * mg).into(),
                scale: poses.correction.matrix.diagonal().into(),
                residual_mg: poses.residual * mg,
                before_mg: poses.before * mg,
                poses: poses.count,
            }),
            mag: found.ellipsoid.map(|ellipsoid| Mag {
                offset_ut: ellipsoid.correction.offset.into(),
                matrix: by_rows(&ellipsoid.correction.matrix),
                strength_ut: ellipsoid.strength,
                residual_ut: ellipsoid.residual,
                before_ut: readings.field_spread_ut(),
                coverage_pct: ellipsoid.coverage.share() * 100.0,
                used: ellipsoid.used,
                outliers: ellipsoid.outliers,
                dip_deg: found.dip.map(|(dip, _)| dip.to_degrees()),
                dip_deviation_deg: found.dip.map(|(_, deviation)| deviation.to_degrees()),
            }),
            declination_deg,
            mount_deg: found
                .mount
                .map(|(roll, pitch)| [roll.to_degrees(), pitch.to_degrees()]),
            gyr_by_acc: found.by_gravity.as_ref().map(by_rows),
            gyr_by_mag: found.by_field.as_ref().map(by_rows),
            parameters: rows
                .iter()
                .map(|row| (row.name.clone(), row.value.into()))
                .collect(),
            refused: found.refused.clone(),
            written: false,
        }
    }

    /// Name and value of every figure, for people.
    pub fn lines(&self) -> Vec<[String; 2]> {
        let vector = |v: &[f64; 3], digits: usize| {
            let parts = v.map(|part| match format!("{part:.digits$}") {
                // A rounded zero has no sign.
                zero if zero.parse() == Ok(0.0) => format!("{:.digits$}", 0.0),
                number => number,
            });
            parts.join("  ")
        };
        let mut lines = Vec::new();
        let mut line = |name: &str, value: String| lines.push([name.to_owned(), value]);
        if let Some(gyr) = &self.gyr {
            line("gyroscope offset, deg/s", vector(&gyr.offset_deg_s, 3));
            line("  out of a rest of, s", format!("{:.1}", gyr.rest_s));
            line("  rate at rest", change(gyr.before_deg_s, 0.0, "deg/s", 3));
        }
        if let Some(acc) = &self.acc {
            line("accelerometer offset, mg", vector(&acc.offset_mg, 1));
            line("  scale", vector(&acc.scale, 4));
            line(
                "  off gravity, rms",
                change(acc.before_mg, acc.residual_mg, "mg", 1),
            );
            line("  poses", acc.poses.to_string());
        }
        if let Some(mag) = &self.mag {
            line("hard iron, uT", vector(&mag.offset_ut, 1));
            for (axis, row) in ["x", "y", "z"].iter().zip(&mag.matrix) {
                line(&format!("  soft iron undone, {axis}"), vector(row, 3));
            }
            line("  strength, uT", format!("{:.1}", mag.strength_ut));
            line(
                "  varies by, rms",
                change(mag.before_ut, mag.residual_ut, "uT", 2),
            );
            line("  directions seen", format!("{:.0} %", mag.coverage_pct));
            if let (Some(dip), Some(off)) = (mag.dip_deg, mag.dip_deviation_deg) {
                line("  dip, deg", format!("{dip:.1}, to {off:.1}"));
            }
        }
        if let Some([roll, pitch]) = self.mount_deg {
            line("mount roll, pitch, deg", format!("{roll:.2}  {pitch:.2}"));
        }
        if let Some(deg) = self.declination_deg {
            line("declination, deg", format!("{deg:.2}"));
        }
        lines
    }

    /// The same as text, a line for each.
    pub fn text(&self) -> String {
        self.lines()
            .iter()
            .map(|[name, value]| format!("{name:<26} {value}\n"))
            .collect()
    }
}

/// A figure before and after.
fn change(before: f64, after: f64, unit: &str, digits: usize) -> String {
    format!("{before:.digits$} -> {after:.digits$} {unit}")
}

fn by_rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}
