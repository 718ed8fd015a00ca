//! Recordings of a real IMU with optical ground truth: the format `IMUQ16v1`.
//!
//! Little endian. The header has 64 bytes: magic `IMUQ16v1`, `u32` number of samples, `f32`
//! sampling rate in Hz, four `f32` scales, `u32` size of a record (28), 28 bytes of name. The
//! scales are of gyroscope (rad/s a count), accelerometer (m/s^2 a count), magnetometer (uT a
//! count) and quaternion. Then the records: 14 x `i16`, gyroscope, accelerometer, magnetometer,
//! reference quaternion (sensor to east-north-up) and flags (bit 0 movement, bit 1 reference
//! valid). A scale of 0 says that there is no magnetometer, or no reference.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::{RecordedSample, RecordingError};

const MAGIC: &[u8; 8] = b"IMUQ16v1";
/// Longest file that is read whole, bytes: days of samples.
const LONGEST: u64 = 1 << 30;
const MOVEMENT: i16 = 1;
const VALID: i16 = 2;

/// The header of a file: enough to read its samples one by one.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// The recording's own name.
    pub name: String,
    /// Number of samples that follow; at least one.
    pub samples: u32,
    /// Samples a second.
    pub rate_hz: f64,
    /// Angular rate of a count, rad/s.
    pub gyr_rad_s: f64,
    /// Specific force of a count, m/s^2.
    pub acc_m_s2: f64,
    /// Magnetic field of a count, uT; 0 where there was no magnetometer.
    pub mag_ut: f64,
    /// Quaternion component of a count; 0 where there is no reference.
    pub quaternion: f64,
}

impl Header {
    /// Size of the header.
    pub const BYTES: usize = 64;
    /// Size of a sample.
    pub const RECORD_BYTES: usize = 28;

    /// Whether a file that begins with `bytes` is of this format at all.
    pub fn is_magic(bytes: &[u8]) -> bool {
        bytes.starts_with(MAGIC)
    }

    /// Parses the beginning of a file; `name` stands for it in errors.
    ///
    /// # Errors
    /// The header is not that of a recording.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self, RecordingError> {
        let format = |reason: String| {
            RecordingError::of(name, format!("is not an IMUQ16v1 recording: {reason}"))
        };
        if !Self::is_magic(bytes) {
            return Err(format("it does not begin with IMUQ16v1".to_owned()));
        }
        let Some(header) = bytes.first_chunk::<{ Self::BYTES }>() else {
            return Err(format(format!(
                "the header of {} bytes is cut off at {}",
                Self::BYTES,
                bytes.len()
            )));
        };
        let word = |at: usize| [0, 1, 2, 3].map(|i| header[at + i]);
        let number = |at: usize| f64::from(f32::from_le_bytes(word(at)));
        let scale = |at: usize, what: &str| {
            let value = number(at);
            if value.is_finite() && value > 0.0 {
                Ok(value)
            } else {
                Err(format(format!("{what} is {value}")))
            }
        };
        let absent_or_scale = |at: usize, what: &str| {
            if number(at) == 0.0 { Ok(0.0) } else { scale(at, what) }
        };
        let samples = u32::from_le_bytes(word(8));
        let title = &header[36..];
        let end = title.iter().position(|&b| b == 0).unwrap_or(title.len());
        let parsed = Self {
            name: String::from_utf8_lossy(&title[..end]).into_owned(),
            samples,
            rate_hz: scale(12, "the sampling rate")?,
            gyr_rad_s: scale(16, "the gyroscope's scale")?,
            acc_m_s2: scale(20, "the accelerometer's scale")?,
            mag_ut: absent_or_scale(24, "the magnetometer's scale")?,
            quaternion: absent_or_scale(28, "the quaternion's scale")?,
        };
        let record = u32::from_le_bytes(word(32));
        if record as usize != Self::RECORD_BYTES {
            return Err(format(format!(
                "records of {record} bytes instead of {}",
                Self::RECORD_BYTES
            )));
        }
        if samples == 0 {
            return Err(format("it holds no sample".to_owned()));
        }
        Ok(parsed)
    }

    /// Checks that a file of `found` bytes holds just the samples that were promised.
    ///
    /// # Errors
    /// The file ends before these samples, or goes on after them.
    pub fn check_length(&self, name: &str, found: u64) -> Result<(), RecordingError> {
        let expected = u64::from(self.samples) * Self::RECORD_BYTES as u64 + Self::BYTES as u64;
        if found == expected {
            return Ok(());
        }
        Err(RecordingError::Unusable(format!(
            "the recording {name} is damaged: its header promises {} samples ({expected} bytes), the \
             file has {found} bytes",
            self.samples
        )))
    }

    /// The sample number `index`, from 0. Zero in all axes is no field: there is no magnetometer.
    pub fn sample(&self, index: u32, record: &[u8; Self::RECORD_BYTES]) -> RecordedSample {
        let raw = |i: usize| i16::from_le_bytes([record[2 * i], record[2 * i + 1]]);
        let vector = |i: usize, scale: f64| [0, 1, 2].map(|k| f64::from(raw(i + k)) * scale);
        let flags = raw(13);
        let mag_ut = vector(6, self.mag_ut);
        RecordedSample {
            // Rounded to ns: the header has the rate in single precision.
            time_s: (f64::from(index) / self.rate_hz * 1e9).round() / 1e9,
            gyr_rad_s: vector(0, self.gyr_rad_s),
            acc_m_s2: vector(3, self.acc_m_s2),
            mag_ut: (mag_ut != [0.0; 3]).then_some(mag_ut),
            reference: (flags & VALID != 0 && self.quaternion > 0.0)
                .then(|| [9, 10, 11, 12].map(|i| f64::from(raw(i)) * self.quaternion)),
            movement: flags & MOVEMENT != 0,
        }
    }
}

/// A recording, read and checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    name: String,
    rate_hz: f64,
    samples: Vec<RecordedSample>,
}

impl Recording {
    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read, is not of this format or not whole.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let mut bytes = Vec::new();
        // One byte more than it may have tells that it is too long.
        let read = File::open(path).and_then(|file| file.take(LONGEST + 1).read_to_end(&mut bytes));
        read.map_err(|source| RecordingError::Read(format!("the recording {name}"), source))?;
        Self::parse(&name, &bytes)
    }

    /// Parses the bytes of a file; `name` stands for it in errors.
    ///
    /// # Errors
    /// They are not of this format or not whole.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self, RecordingError> {
        let header = Header::parse(name, bytes)?;
        header.check_length(name, bytes.len() as u64)?;
        let samples = bytes[Header::BYTES..]
            .as_chunks::<{ Header::RECORD_BYTES }>()
            .0
            .iter()
            .zip(0..)
            .map(|(record, index)| header.sample(index, record))
            .collect();
        Ok(Self { name: header.name, rate_hz: header.rate_hz, samples })
    }

    /// The recording's own name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Samples a second.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.samples.len() as f64 / self.rate_hz
    }

    /// All samples in order; never empty.
    pub fn samples(&self) -> &[RecordedSample] {
        &self.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(count: u32, records: &[[i16; 14]]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(count.to_le_bytes());
        for value in [100.0_f32, 0.001, 0.01, 0.5, 1.0 / 32767.0] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(28u32.to_le_bytes());
        bytes.extend(b"bench");
        bytes.resize(Header::BYTES, 0);
        for record in records {
            bytes.extend(record.iter().flat_map(|v| v.to_le_bytes()));
        }
        bytes
    }

    #[test]
    fn reads_scales_flags_and_name() {
        let record = [1000, 0, -1, 0, 0, 981, 100, 0, 0, 32767, 0, 0, 0, 3];
        let blind = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
        let recording = Recording::parse("x", &file(2, &[record, blind])).unwrap();
        assert_eq!(recording.name(), "bench");
        assert_eq!(recording.rate_hz(), 100.0);
        let sample = recording.samples()[0];
        assert!((sample.gyr_rad_s[0] - 1.0).abs() < 1e-6);
        assert!((sample.gyr_rad_s[2] + 0.001).abs() < 1e-9);
        assert!((sample.acc_m_s2[2] - 9.81).abs() < 1e-6);
        assert_eq!(sample.mag_ut, Some([50.0, 0.0, 0.0]));
        let w = sample.reference.unwrap()[0];
        assert!((w - 1.0).abs() < 1e-6, "{w}");
        assert!(sample.movement);
        let second = recording.samples()[1];
        assert_eq!((second.reference, second.mag_ut), (None, None));
        assert_eq!((sample.time_s, second.time_s), (0.0, 0.01));
    }

    #[test]
    fn bad_files_are_told_apart() {
        let whole = file(2, &[[0; 14]; 2]);
        let message = |bytes: &[u8]| Recording::parse("f.imuq", bytes).unwrap_err().to_string();
        assert!(message(b"").contains("does not begin with IMUQ16v1"));
        assert!(message(&whole[..40]).contains("cut off at 40"));
        assert!(message(&whole[..whole.len() - 1]).contains("promises 2 samples (120 bytes)"));
        assert!(message(&file(0, &[])).contains("no sample"));
        let mut rate = whole.clone();
        rate[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(message(&rate).contains("the sampling rate is NaN"));
        let missing = Recording::open(Path::new("/nowhere/x.imuq")).unwrap_err();
        assert!(missing.to_string().contains("/nowhere/x.imuq"));
    }
}
