//! Recordings, sample by sample: a file is never held in memory.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use anyhow::Result;
use rig::recording::{Header, RecordedSample};
use tvc_fusion::fixed;

use super::table::Table;
use crate::out::exit::BadInput;

/// Size of the read buffer.
const BUFFER: usize = 1 << 16;
/// Samples that a CSV file is looked ahead for its sampling period.
const LOOK_AHEAD: usize = 257;
/// Sampling period of a recording of one sample, s.
const LONE_PERIOD_S: f64 = 0.01;

/// Counts that a value in SI units is rounded to for fixed point, where the recording has no counts of
/// its own: 2000 deg/s and 16 g at full scale, and 1638 uT.
const COUNTS: fixed::Scale = fixed::Scale {
    gyr_rad_s: 34.906_586 / 32_767.0,
    acc_m_s2: 156.906_4 / 32_767.0,
    mag_ut: 0.05,
};

/// Largest count, less what the offset correction of a recording may have moved it by.
const FULL_SCALE: f64 = 32_700.0;

/// A moment of a recording, in SI units along the sensor's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Time as recorded, s.
    pub time_s: f64,
    /// Rotation rate, rad/s.
    pub gyr_rad_s: [f64; 3],
    /// Specific force, m/s^2.
    pub acc_m_s2: [f64; 3],
    /// Magnetic field, uT, where there is a fresh one.
    pub mag_ut: Option<[f64; 3]>,
    /// Reference, sensor to east-north-up, where there is one.
    pub reference: Option<[f64; 4]>,
    /// Errors count here.
    pub movement: bool,
}

/// What a filter has to know of a recording before its first sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facts {
    /// Usual time between two samples, s.
    pub period_s: f64,
    /// What a count is worth in fixed point.
    pub scale: fixed::Scale,
    /// Rates from here on have clipped (rad/s), where the recording's counts say so.
    pub gyro_range_rad_s: Option<f32>,
}

/// An open recording.
pub struct Source {
    name: String,
    facts: Facts,
    bytes: u64,
    format: Format,
    ahead: VecDeque<Row>,
}

enum Format {
    Counts {
        header: Header,
        file: BufReader<File>,
        next: u32,
    },
    Table(Box<Table<BufReader<File>>>),
}

impl Source {
    /// Opens a recording and checks what can be checked before reading it all.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let opened = File::open(path).and_then(|file| Ok((file.metadata()?, file)));
        let (metadata, file) =
            opened.map_err(|error| BadInput::new(format!("cannot read {name}: {error}")))?;
        if metadata.is_dir() {
            return Err(BadInput::new(format!("{name} is a folder, not a recording")).into());
        }
        let mut file = BufReader::with_capacity(BUFFER, file);
        let mut start = Vec::with_capacity(Header::BYTES);
        file.by_ref()
            .take(Header::BYTES as u64)
            .read_to_end(&mut start)
            .map_err(|error| BadInput::new(format!("cannot read {name}: {error}")))?;
        if Header::is_magic(&start) {
            let header = Header::parse(&name, &start).map_err(BadInput::new)?;
            if metadata.is_file() {
                header
                    .check_length(&name, metadata.len())
                    .map_err(BadInput::new)?;
            }
            return Ok(Self::of_counts(name, header, file, metadata.len()));
        }
        if start.is_empty() {
            return Err(BadInput::new(format!("{name} is empty")).into());
        }
        let table = Table::read(&name, start, file)?;
        Self::of_table(name, table, metadata.len())
    }

    fn of_counts(name: String, header: Header, file: BufReader<File>, bytes: u64) -> Self {
        let full_scale = (FULL_SCALE * header.gyr_rad_s) as f32;
        Self {
            name,
            facts: Facts {
                period_s: 1.0 / header.rate_hz,
                scale: fixed::Scale {
                    gyr_rad_s: header.gyr_rad_s as f32,
                    acc_m_s2: header.acc_m_s2 as f32,
                    mag_ut: if header.mag_ut > 0.0 {
                        header.mag_ut as f32
                    } else {
                        COUNTS.mag_ut
                    },
                },
                gyro_range_rad_s: Some(full_scale),
            },
            bytes,
            format: Format::Counts {
                header,
                file,
                next: 0,
            },
            ahead: VecDeque::new(),
        }
    }

    fn of_table(name: String, mut table: Table<BufReader<File>>, bytes: u64) -> Result<Self> {
        let mut ahead = VecDeque::with_capacity(LOOK_AHEAD);
        while ahead.len() < LOOK_AHEAD
            && let Some(row) = table.next_row()?
        {
            ahead.push_back(row);
        }
        if ahead.is_empty() {
            return Err(BadInput::new(format!("{name} holds no sample")).into());
        }
        Ok(Self {
            name,
            facts: Facts {
                period_s: usual_period_s(&ahead),
                scale: COUNTS,
                gyro_range_rad_s: None,
            },
            bytes,
            format: Format::Table(Box::new(table)),
            ahead,
        })
    }

    /// The file's name as it was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What a filter has to know.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Size of the file.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// How much of it has been read.
    pub fn bytes_read(&self) -> u64 {
        match &self.format {
            Format::Counts { next, .. } => {
                Header::BYTES as u64 + u64::from(*next) * Header::RECORD_BYTES as u64
            }
            Format::Table(table) => table.bytes_read(),
        }
    }

    /// The next sample; `None` after the last.
    pub fn next_row(&mut self) -> Result<Option<Row>> {
        if let Some(row) = self.ahead.pop_front() {
            return Ok(Some(row));
        }
        match &mut self.format {
            Format::Table(table) => table.next_row(),
            Format::Counts { header, next, .. } if *next == header.samples => Ok(None),
            Format::Counts { header, file, next } => {
                let mut record = [0; Header::RECORD_BYTES];
                file.read_exact(&mut record).map_err(|error| {
                    let name = &self.name;
                    BadInput::new(format!("{name} ends or fails at sample {next}: {error}"))
                })?;
                // Rounded to ns: the header has the rate in single precision.
                let time_s = (f64::from(*next) / header.rate_hz * 1e9).round() / 1e9;
                *next += 1;
                Ok(Some(row(time_s, header.sample(&record))))
            }
        }
    }
}

/// Zero in all three axes is no field at all: the recording has no magnetometer.
fn row(time_s: f64, sample: RecordedSample) -> Row {
    let mag_ut = sample.mag_ut;
    Row {
        time_s,
        gyr_rad_s: sample.gyr_rad_s,
        acc_m_s2: sample.acc_m_s2,
        mag_ut: (mag_ut != [0.0; 3]).then_some(mag_ut),
        reference: sample.reference,
        movement: sample.movement,
    }
}

/// The median of the times between samples.
fn usual_period_s(rows: &VecDeque<Row>) -> f64 {
    let mut periods: Vec<f64> = rows
        .iter()
        .zip(rows.iter().skip(1))
        .map(|(a, b)| b.time_s - a.time_s)
        .filter(|period| *period > 0.0)
        .collect();
    periods.sort_by(f64::total_cmp);
    periods
        .get(periods.len() / 2)
        .copied()
        .unwrap_or(LONE_PERIOD_S)
}
