//! The folder of recordings: new ones, numbered, and what the page lists, downloads and reads.

use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::{Context, Result};
use serde::Serialize;

use crate::cli::TOOL;
use flights::log::{Writer, span_us};
use report::exit::BadInput;
use report::kind::is_log;

/// Most recordings of a kind in one folder.
const MOST: u32 = 9999;
/// Most recordings that are listed, the newest.
const LISTED: usize = 500;

/// Begins a log with the next free number in `folder`; also gives its path.
///
/// # Errors
/// The folder takes no files, or is full.
pub fn create(folder: &Path, kind: &str) -> Result<(Writer, PathBuf)> {
    let path = free(folder, kind)?;
    Ok((Writer::create(&path, TOOL)?, path))
}

/// The path of a log with the next free number in `folder`.
///
/// # Errors
/// The folder is full.
pub fn free(folder: &Path, kind: &str) -> Result<PathBuf> {
    let mut names = (1..=MOST).map(|number| folder.join(format!("{kind}-{number:03}.tlog")));
    // A link that leads nowhere has the name, too.
    names
        .find(|path| path.symlink_metadata().is_err())
        .ok_or_else(|| BadInput::new(format!("{} is full of logs", folder.display())).into())
}

/// A recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recorded {
    /// Name of its file.
    pub name: String,
    /// When it begins, ms since 1970; of a file that does not tell, when it was written last.
    pub begun_ms: Option<u64>,
    /// Its length, s, where the file tells.
    pub seconds: Option<f64>,
    /// Its size, bytes.
    pub bytes: u64,
}

/// The recordings of a folder, the newest first. What is no plain file is none.
///
/// # Errors
/// The folder cannot be read.
pub fn list(folder: &Path) -> Result<Vec<Recorded>> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("cannot read the folder {}", folder.display()))?;
    let mut found: Vec<Recorded> = entries.filter_map(|entry| recorded(&entry.ok()?)).collect();
    found.sort_by(|a, b| (b.begun_ms, &b.name).cmp(&(a.begun_ms, &a.name)));
    found.truncate(LISTED);
    Ok(found)
}

fn recorded(entry: &std::fs::DirEntry) -> Option<Recorded> {
    let path = entry.path();
    let name = entry.file_name().into_string().ok()?;
    // Of a link it is that of the link.
    let about = entry.metadata().ok()?;
    if !about.is_file() || !is_log(&path) || name.starts_with('.') {
        return None;
    }
    let span = span_us(&path);
    let written = || {
        let since = about.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        Some(since.as_millis() as u64)
    };
    Some(Recorded {
        name,
        begun_ms: span.map(|(begin, _)| begin / 1000).or_else(written),
        seconds: span.map(|(begin, end)| end.saturating_sub(begin) as f64 * 1e-6),
        bytes: about.len(),
    })
}

/// The path of a recording that is listed.
///
/// # Errors
/// No log has this name, whatever else the name may point to.
pub fn find(folder: &Path, name: &str) -> Result<PathBuf> {
    let listed = list(folder)?.into_iter().find(|log| log.name == name);
    let log = listed.context("there is no recording of this name")?;
    Ok(folder.join(log.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_log_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let mut logs = Vec::new();
        let mut name = |kind| {
            let (log, path) = create(folder.path(), kind).unwrap();
            logs.push(log);
            path
        };
        assert!(name("step").ends_with("step-001.tlog"));
        assert!(name("step").ends_with("step-002.tlog"));
        assert!(name("flight").ends_with("flight-001.tlog"));
        #[cfg(unix)]
        std::os::unix::fs::symlink("nowhere", folder.path().join("flight-002.tlog")).unwrap();
        #[cfg(unix)]
        assert!(name("flight").ends_with("flight-003.tlog"));
        assert!(create(&folder.path().join("none"), "step").is_err());
    }

    /// Neither what lies outside, by dots or by a link, nor what is no recording.
    #[test]
    fn only_what_is_listed_is_found() {
        let outside = tempfile::tempdir().unwrap();
        let folder = outside.path().join("logs");
        std::fs::create_dir_all(folder.join("inner.tlog")).unwrap();
        for name in [
            "secret.tlog",
            "logs/mine.tlog",
            "logs/notes.txt",
            "logs/.hidden.tlog",
            "logs/inner.tlog/deep.tlog",
        ] {
            std::fs::write(outside.path().join(name), b"x").unwrap();
        }
        #[cfg(unix)]
        std::os::unix::fs::symlink("../secret.tlog", folder.join("link.tlog")).unwrap();
        let names: Vec<String> = list(&folder).unwrap().into_iter().map(|l| l.name).collect();
        assert_eq!(names, ["mine.tlog"]);
        assert!(find(&folder, "mine.tlog").is_ok());
        let absolute = outside.path().join("secret.tlog");
        for name in [
            "",
            ".",
            "../secret.tlog",
            "./mine.tlog",
            "link.tlog",
            "notes.txt",
            ".hidden.tlog",
            "inner.tlog",
            "inner.tlog/deep.tlog",
            absolute.to_str().unwrap(),
        ] {
            assert!(find(&folder, name).is_err(), "{name}");
        }
    }
}
