//! `tvc calibrate`: offsets, scales and iron out of a recording, as parameters of the firmware.

mod fit;
mod readings;
mod report;
mod rests;

use anyhow::{Context, Result, anyhow};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use tvc_nano::Params;
use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::{Date, Month, OffsetDateTime};
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;

use crate::cli::{Calibrate, Day, Place};
use crate::failure::{BadInput, Verdict};
use crate::link::Parameter;
use crate::output::{print_figures, write_whole};
use crate::param::file;
use fit::Found;

/// Everything that `tvc calibrate --json` prints, as one object.
#[derive(Debug, Serialize)]
struct Figures {
    samples: usize,
    gyr: Option<Gyr>,
    acc: Option<Acc>,
    mag: Option<Mag>,
    declination_deg: Option<f64>,
    mount_deg: Option<[f64; 2]>,
    /// What the gyroscope must be multiplied with by the accelerometer and by the magnetometer.
    gyr_by_acc: Option<[[f64; 3]; 3]>,
    gyr_by_mag: Option<[[f64; 3]; 3]>,
    parameters: serde_json::Map<String, serde_json::Value>,
    refused: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Gyr {
    offset_deg_s: [f64; 3],
    noise_deg_s: [f64; 3],
    rest_s: f64,
}

#[derive(Debug, Serialize)]
struct Acc {
    offset_mg: [f64; 3],
    scale: [f64; 3],
    residual_mg: f64,
    poses: usize,
}

#[derive(Debug, Serialize)]
struct Mag {
    offset_ut: [f64; 3],
    matrix: [[f64; 3]; 3],
    strength_ut: f64,
    residual_ut: f64,
    coverage_pct: f64,
    used: usize,
    outliers: usize,
    dip_deg: Option<f64>,
    dip_deviation_deg: Option<f64>,
}

/// Calibrates as `options` say, prints the figures, writes the parameters and the report.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    let declination_deg = match options.place {
        Some(place) => Some(declination_deg(place, options.date)?),
        None => options.declination,
    };
    let readings = readings::read(&options.from)?;
    let found = fit::fit(&readings, options);
    let rows = parameters(&found, declination_deg)?;
    let figures = Figures::new(&readings, &found, declination_deg, &rows);
    let page = report::page(&readings, &found, &figures, options)?;
    write_whole(&options.report, page.as_bytes())?;
    print_figures(&figures, options.json, Figures::text)?;
    eprintln!("report: {}", options.report.display());
    for why in &found.refused {
        eprintln!("refused: {why}");
    }
    if !found.refused.is_empty() {
        return Ok(Verdict::Missed);
    }
    write_whole(&options.out, file::text(&rows).as_bytes())?;
    eprintln!("parameters: {}", options.out.display());
    Ok(Verdict::Met)
}

fn today() -> Result<Date> {
    let since = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .context("the clock of this computer")?;
    Ok(OffsetDateTime::from_unix_timestamp(since.as_secs() as i64)?.date())
}

/// Declination at sea level by the world magnetic model.
fn declination_deg(place: Place, day: Option<Day>) -> Result<f64> {
    let date = match day {
        None => today()?,
        Some(day) => Month::try_from(day.month)
            .and_then(|month| Date::from_calendar_date(day.year, month, day.day))
            .map_err(|error| BadInput::new(format!("--date: {error}")))?,
    };
    let field = GeomagneticField::new(
        Length::new::<meter>(0.0),
        Angle::new::<degree>(place.latitude_deg),
        Angle::new::<degree>(place.longitude_deg),
        date,
    )
    .map_err(|error| BadInput::new(format!("no declination for this place and date: {error}")))?;
    Ok(f64::from(field.declination().get::<degree>()))
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

impl Figures {
    fn new(
        readings: &readings::Readings,
        found: &Found,
        declination_deg: Option<f64>,
        rows: &[Parameter],
    ) -> Self {
        let mg = 1000.0 / tvc_nano::calibration::STANDARD_GRAVITY;
        Self {
            samples: readings.moments.len(),
            gyr: found.rest.map(|rest| Gyr {
                offset_deg_s: rest.bias.map(f64::to_degrees).into(),
                noise_deg_s: rest.noise.map(f64::to_degrees).into(),
                rest_s: rest.seconds,
            }),
            acc: found.poses.map(|poses| Acc {
                offset_mg: (poses.correction.offset * mg).into(),
                scale: poses.correction.matrix.diagonal().into(),
                residual_mg: poses.residual * mg,
                poses: poses.count,
            }),
            mag: found.ellipsoid.map(|ellipsoid| Mag {
                offset_ut: ellipsoid.correction.offset.into(),
                matrix: by_rows(&ellipsoid.correction.matrix),
                strength_ut: ellipsoid.strength,
                residual_ut: ellipsoid.residual,
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
        }
    }

    /// What was found, a line each.
    fn lines(&self) -> Vec<[String; 2]> {
        let vector = |v: &[f64; 3], digits: usize| {
            format!("{:.digits$}  {:.digits$}  {:.digits$}", v[0], v[1], v[2])
        };
        let mut lines = Vec::new();
        let mut line = |name: &str, value: String| lines.push([name.to_owned(), value]);
        if let Some(gyr) = &self.gyr {
            line("gyroscope offset, deg/s", vector(&gyr.offset_deg_s, 3));
            line("  out of a rest of, s", format!("{:.1}", gyr.rest_s));
        }
        if let Some(acc) = &self.acc {
            line("accelerometer offset, mg", vector(&acc.offset_mg, 1));
            line("  scale", vector(&acc.scale, 4));
            line(
                "  left over, mg",
                format!("{:.1} in {} poses", acc.residual_mg, acc.poses),
            );
        }
        if let Some(mag) = &self.mag {
            line("hard iron, uT", vector(&mag.offset_ut, 1));
            for row in &mag.matrix {
                line("  soft iron undone", vector(row, 3));
            }
            line(
                "  left over, uT",
                format!("{:.2} of {:.1}", mag.residual_ut, mag.strength_ut),
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

    fn text(&self) -> String {
        self.lines()
            .iter()
            .map(|[name, value]| format!("{name:<26} {value}\n"))
            .collect()
    }
}

fn by_rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declination_of_copenhagen_as_the_model_has_it() {
        let place = Place {
            latitude_deg: 55.79,
            longitude_deg: 12.52,
        };
        let day = |year| Day {
            year,
            month: 7,
            day: 1,
        };
        let deg = declination_deg(place, Some(day(2026))).unwrap();
        assert!((4.3..6.0).contains(&deg), "{deg}");
        assert!(declination_deg(place, Some(day(1900))).is_err());
    }
}
