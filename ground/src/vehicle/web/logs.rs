//! Files for recordings, numbered.

use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::logs::log::Writer;
use crate::out::exit::BadInput;

/// Most recordings of a kind in one folder.
const MOST: u32 = 9999;

/// Begins a log with the next free number in `folder`; also gives its path.
///
/// # Errors
/// The folder takes no files, or is full.
pub fn create(folder: &Path, kind: &str) -> Result<(Writer, PathBuf)> {
    let path = free(folder, kind)?;
    Ok((Writer::create(&path)?, path))
}

/// The path of a log with the next free number in `folder`.
///
/// # Errors
/// The folder is full.
pub fn free(folder: &Path, kind: &str) -> Result<PathBuf> {
    let mut names = (1..=MOST).map(|number| folder.join(format!("{kind}-{number:03}.tlog")));
    names
        .find(|path| !path.exists())
        .ok_or_else(|| BadInput::new(format!("{} is full of logs", folder.display())).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_log_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let name = |kind| create(folder.path(), kind).unwrap().1;
        assert!(name("step").ends_with("step-001.tlog"));
        assert!(name("step").ends_with("step-002.tlog"));
        assert!(name("flight").ends_with("flight-001.tlog"));
        assert!(create(&folder.path().join("none"), "step").is_err());
    }
}
