//! What can be wrong with a recording, and with the choice of a filter.

use std::io;

use thiserror::Error;

use crate::{FilterName, Scalar, Setting};

/// Why a file is not a recording that can be played. The first field is the file, or what stands
/// for it.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("cannot read {0}: {1}")]
    Read(String, #[source] io::Error),
    /// A folder.
    #[error("{0} is a folder, not a recording")]
    Folder(String),
    /// A file without a byte.
    #[error("{0} is empty")]
    Empty(String),
    /// Columns without a line below them.
    #[error("{0} holds no sample")]
    NoSample(String),
    /// The beginning of the file is not that of `IMUQ16v1`, for this reason.
    #[error("{0} is not an IMUQ16v1 recording: {1}")]
    Header(String, String),
    /// The file ends before the samples that its header promises, or goes on after them.
    #[error(
        "the recording {name} is damaged: its header promises {promised} samples \
         ({expected} bytes), the file has {found} bytes"
    )]
    Length {
        /// The file, or what stands for it.
        name: String,
        /// Number of samples in the header.
        promised: u32,
        /// Size that this makes.
        expected: u64,
        /// Size of the file.
        found: u64,
    },
    /// A sample of `IMUQ16v1`, with its number, cannot be read.
    #[error("{0} ends or fails at sample {1}: {2}")]
    Sample(String, u32, #[source] io::Error),
    /// Neither of the formats, for this reason.
    #[error(
        "{0} is neither an IMUQ16v1 recording nor a CSV file with columns such as \
         t_s,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2: {1}"
    )]
    Foreign(String, String),
    /// CSV whose lines differ in their number of fields, or that cannot be read.
    #[error("{0} is damaged: {1}")]
    Table(String, #[source] csv::Error),
    /// A line of CSV, with its number, that holds something else than numbers.
    #[error("{0}, line {1}: {2}")]
    Line(String, u64, String),
}

/// Why a filter cannot be run as chosen.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ChoiceError {
    /// The filter computes in floating point only.
    #[error("{0} has no fixed-point form; complementary, mahony, madgwick and vqf have one")]
    NoFixedPoint(FilterName),
    /// The filter has no such set of gains, but these.
    #[error("{0} has no preset {1}; its presets are {2}")]
    Preset(FilterName, String, String),
    /// The filter has no such setting, but these.
    #[error("{0} has no setting {1}; its settings are {2}")]
    Setting(FilterName, String, String),
    /// Forth and back in time there is floating point only.
    #[error("fixed point does not run offline: choose f32 or f64")]
    OfflineFixed,
    /// The setting has a value that is no number.
    #[error("{0} is not a number")]
    NotANumber(Setting),
    /// A setting, or the recording's sampling period, is not one that the filter can do with.
    #[error("{0} is out of range for {1} in {2}")]
    OutOfRange(String, FilterName, Scalar),
}
