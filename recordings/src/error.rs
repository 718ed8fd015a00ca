//! What can be wrong with a recording.

use std::io;

use thiserror::Error;

/// Why a file is not a recording that can be played.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file, or what stands for it, cannot be read.
    #[error("cannot read {0}: {1}")]
    Read(String, #[source] io::Error),
    /// What it holds is no recording, or a damaged one; the sentence names the file.
    #[error("{0}")]
    Unusable(String),
}

impl RecordingError {
    /// What is wrong with a recording, behind its name.
    pub(crate) fn of(name: &str, what: impl std::fmt::Display) -> Self {
        Self::Unusable(format!("{name} {what}"))
    }
}
