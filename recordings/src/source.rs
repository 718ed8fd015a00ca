//! Recordings read sample by sample, so that a file is never held in memory.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use tvc_fusion::fixed;

use crate::imuq::Header;
use crate::lines::Lines;
use crate::table::Table;
use crate::{RecordedSample, RecordingError};

/// Size of the read buffer.
const BUFFER: usize = 1 << 16;
/// Samples of a CSV file that are read ahead to find its sampling period.
const LOOK_AHEAD: usize = 257;
/// Sampling period of a recording of one sample, s.
const LONE_PERIOD_S: f64 = 0.01;

/// Values of a count for fixed point, where the recording is in SI units: 2000 deg/s, 16 g and 1638
/// uT at full scale.
const COUNTS: fixed::Scale =
    fixed::Scale { gyr_rad_s: 34.906_586 / 32_767.0, acc_m_s2: 156.906_4 / 32_767.0, mag_ut: 0.05 };

/// Largest count, less what the offset correction of a recording may have moved it by.
const FULL_SCALE: f64 = 32_700.0;

/// What a filter has to know of a recording before its first sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facts {
    /// Usual time between two samples, s.
    pub period_s: f64,
    /// What a count is worth in fixed point.
    pub scale: fixed::Scale,
    /// Rate at which the gyroscope clips, rad/s, where the recording's counts say so.
    pub gyro_range_rad_s: Option<f32>,
}

/// An open recording.
pub struct Source {
    name: String,
    facts: Facts,
    bytes: u64,
    format: Format,
    ahead: VecDeque<RecordedSample>,
}

enum Format {
    Counts { header: Header, file: BufReader<File>, next: u32 },
    Table(Box<Table<Lines<BufReader<File>>>>),
}

impl Source {
    /// Opens a recording and checks what can be checked before reading it all.
    ///
    /// # Errors
    /// The file cannot be read, or is of neither format.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let unread = |error| RecordingError::Read(path.display().to_string(), error);
        let file = File::open(path).map_err(unread)?;
        let metadata = file.metadata().map_err(unread)?;
        if metadata.is_dir() {
            return Err(RecordingError::of(&name, "is a folder, not a recording"));
        }
        let mut file = BufReader::with_capacity(BUFFER, file);
        let mut start = Vec::with_capacity(Header::BYTES);
        file.by_ref().take(Header::BYTES as u64).read_to_end(&mut start).map_err(unread)?;
        if Header::is_magic(&start) {
            let header = Header::parse(&name, &start)?;
            if metadata.is_file() {
                header.check_length(&name, metadata.len())?;
            }
            return Ok(Self::of_counts(name, header, file, metadata.len()));
        }
        if start.is_empty() {
            return Err(RecordingError::of(&name, "is empty"));
        }
        let table = Table::read(&name, start, Lines::new(file))?;
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
                    mag_ut: if header.mag_ut > 0.0 { header.mag_ut as f32 } else { COUNTS.mag_ut },
                },
                gyro_range_rad_s: Some(full_scale),
            },
            bytes,
            format: Format::Counts { header, file, next: 0 },
            ahead: VecDeque::new(),
        }
    }

    fn of_table(
        name: String,
        mut table: Table<Lines<BufReader<File>>>,
        bytes: u64,
    ) -> Result<Self, RecordingError> {
        let mut ahead = VecDeque::with_capacity(LOOK_AHEAD);
        while ahead.len() < LOOK_AHEAD
            && let Some(sample) = table.next_sample()?
        {
            ahead.push_back(sample);
        }
        if ahead.is_empty() {
            return Err(RecordingError::of(&name, "holds no sample"));
        }
        Ok(Self {
            name,
            facts: Facts {
                period_s: usual_period_s(&ahead),
                scale: if table.is_counts() { fixed::Scale::BNO055 } else { COUNTS },
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

    /// What a filter has to know before its first sample.
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
    ///
    /// # Errors
    /// The file cannot be read to its end, or a line of CSV is damaged.
    pub fn next_sample(&mut self) -> Result<Option<RecordedSample>, RecordingError> {
        if let Some(sample) = self.ahead.pop_front() {
            return Ok(Some(sample));
        }
        match &mut self.format {
            Format::Table(table) => table.next_sample(),
            Format::Counts { header, next, .. } if *next == header.samples => Ok(None),
            Format::Counts { header, file, next } => {
                let mut record = [0; Header::RECORD_BYTES];
                file.read_exact(&mut record).map_err(|error| {
                    RecordingError::of(
                        &self.name,
                        format!("ends or fails at sample {next}: {error}"),
                    )
                })?;
                let sample = header.sample(*next, &record);
                *next += 1;
                Ok(Some(sample))
            }
        }
    }
}

/// The median of the times between samples.
fn usual_period_s(samples: &VecDeque<RecordedSample>) -> f64 {
    let mut periods: Vec<f64> = samples
        .iter()
        .zip(samples.iter().skip(1))
        .map(|(a, b)| b.time_s - a.time_s)
        .filter(|period| *period > 0.0)
        .collect();
    periods.sort_by(f64::total_cmp);
    periods.get(periods.len() / 2).copied().unwrap_or(LONE_PERIOD_S)
}
