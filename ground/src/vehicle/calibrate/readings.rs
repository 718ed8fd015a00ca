//! The recording to calibrate from, whole, in SI units along the sensor's axes.

use std::path::Path;

use anyhow::Result;
use mavlink::dialects::common::MavMessage;
use nalgebra::Vector3;
use rig::instruction::Instruction;
use tvc_nano::calibration::rest::Moment;
use tvc_nano::calibration::spread;

use crate::filters::fuse::source::Source;
use crate::logs::log::{Log, has_extension};
use crate::out::exit::BadInput;

/// What a count of the firmware's sensor is worth: rad/s, m/s2, uT.
pub const GYR_RAD_S: f64 = std::f64::consts::PI / 180.0 / 16.0;
/// See [`GYR_RAD_S`].
pub const ACC_M_S2: f64 = 0.01;
/// See [`GYR_RAD_S`].
pub const MAG_UT: f64 = 1.0 / 16.0;

/// A recording.
#[derive(Default)]
pub struct Readings {
    /// Its samples; where there was no new field the last one is repeated.
    pub moments: Vec<Moment>,
    /// Which of them have a new field.
    pub fresh: Vec<usize>,
    /// When the body was asked to be stood level, s.
    pub level_from_s: Option<f64>,
    /// Time of the first sample, as it came.
    begun_s: f64,
}

/// Columns of a log of counts.
const TIME: [(&str, f64); 3] = [("sample_time_us", 1e-6), ("time_us", 1e-6), ("t_s", 1.0)];
const COUNTS: [&str; 9] = [
    "gyr_x", "gyr_y", "gyr_z", "acc_x", "acc_y", "acc_z", "mag_x", "mag_y", "mag_z",
];

/// Reads a telemetry log, CSV of counts or of SI units, or IMUQ16v1.
///
/// # Errors
/// [`BadInput`] naming the file and what is wrong with it.
pub fn read(path: &Path) -> Result<Readings> {
    let readings = if has_extension(path, "tlog") || has_extension(path, "mcap") {
        of_log(&Log::read(path)?)
    } else if let Some(rows) = of_counts(path)? {
        Readings::of(rows)
    } else {
        Readings::of(of_source(Source::open(path)?)?)
    };
    if readings.moments.len() < 100 {
        return Err(BadInput::new(format!(
            "{} has {} samples with all of gyroscope and accelerometer, which is less than a second",
            path.display(),
            readings.moments.len()
        ))
        .into());
    }
    Ok(readings)
}

/// Time, rate, force, and the field where there is one.
type Row = (f64, Vector3<f64>, Vector3<f64>, Option<Vector3<f64>>);

impl Readings {
    fn of(rows: Vec<Row>) -> Self {
        let mut readings = Self::default();
        for row in rows {
            readings.push(row);
        }
        readings
    }

    /// Takes in a message of the vehicle, or an instruction to whoever holds it.
    pub fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::RAW_IMU(m) => self.push(row(
                m.time_usec as f64 * 1e-6,
                [
                    m.xgyro, m.ygyro, m.zgyro, m.xacc, m.yacc, m.zacc, m.xmag, m.ymag, m.zmag,
                ]
                .map(f64::from),
            )),
            _ if Instruction::of(message) == Some(Instruction::Level) => {
                self.level_from_s = Some(self.length_s());
            }
            _ => {}
        }
    }

    /// From the first sample to the last, s.
    pub fn length_s(&self) -> f64 {
        self.moments.last().map_or(0.0, |moment| moment.time_s)
    }

    /// Every new field, uT.
    pub fn fields(&self) -> Vec<Vector3<f64>> {
        self.fresh.iter().map(|i| self.moments[*i].mag).collect()
    }

    /// Standard deviation of the field's strength as it was read, uT.
    pub fn field_spread_ut(&self) -> f64 {
        let strengths: Vec<Vector3<f64>> = self
            .fields()
            .iter()
            .map(|field| Vector3::new(field.norm(), 0.0, 0.0))
            .collect();
        spread(strengths.iter()).map_or(0.0, |(_, deviation)| deviation.x)
    }

    fn push(&mut self, (time_s, gyr, acc, mag): Row) {
        if !(time_s.is_finite() && gyr.norm().is_finite() && acc.norm().is_finite()) {
            return;
        }
        if self.moments.is_empty() {
            self.begun_s = time_s;
        }
        let known = self.fresh.last().map(|i| self.moments[*i].mag);
        let new = mag.filter(|mag| mag.norm().is_finite() && Some(*mag) != known);
        if let Some(mag) = new {
            if self.fresh.is_empty() {
                // Before the first field the sensor lay as it did when that was measured.
                self.moments.iter_mut().for_each(|m| m.mag = mag);
            }
            self.fresh.push(self.moments.len());
        }
        self.moments.push(Moment {
            time_s: time_s - self.begun_s,
            gyr,
            acc,
            mag: new.or(known).unwrap_or_default(),
        });
    }
}

fn of_log(log: &Log) -> Readings {
    let mut readings = Readings::default();
    for entry in &log.entries {
        if entry.from_vehicle || Instruction::of(&entry.message).is_some() {
            readings.take(&entry.message);
        }
    }
    readings
}

/// The rows of a CSV file of counts; `None` of any other file.
fn of_counts(path: &Path) -> Result<Option<Vec<Row>>> {
    let Ok(mut reader) = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
    else {
        return Ok(None);
    };
    let Ok(names) = reader.headers().cloned() else {
        return Ok(None);
    };
    let at = |name: &str| names.iter().position(|column| column == name);
    let time = TIME
        .iter()
        .find_map(|(name, unit)| Some((at(name)?, *unit)));
    let columns: Option<Vec<usize>> = COUNTS.iter().map(|name| at(name)).collect();
    let (Some((time, unit)), Some(columns)) = (time, columns) else {
        return Ok(None);
    };
    let mut rows = Vec::new();
    for record in reader.records() {
        let record =
            record.map_err(|error| BadInput::new(format!("{}: {error}", path.display())))?;
        let field = |column: usize| record.get(column).unwrap_or_default();
        // A step without a sample has empty fields.
        if field(columns[0]).is_empty() {
            continue;
        }
        let number = |column: usize| {
            field(column).parse::<f64>().map_err(|_| {
                let line = record.position().map_or(0, csv::Position::line);
                BadInput::new(format!(
                    "{}, line {line}: {} is no number",
                    path.display(),
                    field(column)
                ))
            })
        };
        let mut counts = [0.0; 9];
        for (count, column) in counts.iter_mut().zip(&columns) {
            *count = number(*column)?;
        }
        rows.push(row(number(time)? * unit, counts));
    }
    Ok(Some(rows))
}

fn row(time_s: f64, [gx, gy, gz, ax, ay, az, mx, my, mz]: [f64; 9]) -> Row {
    let mag = Vector3::new(mx, my, mz);
    (
        time_s,
        Vector3::new(gx, gy, gz) * GYR_RAD_S,
        Vector3::new(ax, ay, az) * ACC_M_S2,
        (mag.norm() > 0.0).then_some(mag * MAG_UT),
    )
}

fn of_source(mut source: Source) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    while let Some(row) = source.next_row()? {
        rows.push((
            row.time_s,
            Vector3::from(row.gyr_rad_s),
            Vector3::from(row.acc_m_s2),
            row.mag_ut.map(Vector3::from),
        ));
    }
    Ok(rows)
}
