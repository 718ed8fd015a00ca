//! What a command hands over: figures on standard output, and files that are written whole or not
//! at all.

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;
use tempfile::NamedTempFile;

/// Prints `figures` on standard output: as JSON, or as the `text` for people, which ends its own
/// lines.
pub fn print_figures<F: Serialize>(
    figures: &F,
    json: bool,
    text: impl FnOnce(&F) -> String,
) -> Result<()> {
    if json {
        print_json(figures)
    } else {
        print(text(figures))
    }
}

/// Prints `value` on standard output as one line of JSON.
pub fn print_json(value: &impl Serialize) -> Result<()> {
    print(format_args!("{}\n", serde_json::to_string(value)?))
}

/// Prints `text`, which ends its own lines, on standard output, where whoever waits for it has it
/// at once.
///
/// # Errors
/// Standard output cannot be written; the standard library's macros panic there.
pub fn print(text: impl Display) -> Result<()> {
    let mut out = io::stdout().lock();
    write!(out, "{text}")
        .and_then(|()| out.flush())
        .context("writing to standard output")
}

/// Writes `bytes` to `path`, whole or not at all. Creates the folder.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    file.write_all(bytes)
        .with_context(|| format!("writing {}", path.display()))?;
    file.keep()
}

/// A file that is written beside its place and moved there by [`keep`](Self::keep), so that an
/// interrupted command leaves the old file or the new one, never a part. Without `keep` it is
/// removed.
pub struct WholeFile {
    path: PathBuf,
    target: Target,
}

enum Target {
    /// A temporary file beside the target, to be renamed.
    Beside(BufWriter<NamedTempFile>),
    /// A device or a pipe, which cannot be replaced.
    Direct(BufWriter<File>),
}

impl WholeFile {
    /// Begins a file that is to be `path`; its folder is created when it is kept.
    pub fn create(path: &Path) -> Result<Self> {
        let writing = || format!("writing {}", path.display());
        // Behind a symbolic link, the file that it points to is replaced.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let target = match fs::metadata(&path) {
            Ok(found) if found.is_dir() => {
                return Err(io::Error::from(io::ErrorKind::IsADirectory)).with_context(writing);
            }
            Ok(found) if !found.is_file() => {
                let device = File::options().write(true).open(&path);
                Target::Direct(BufWriter::new(device.with_context(writing)?))
            }
            _ => {
                let file = beside(&path).with_context(writing)?;
                Target::Beside(BufWriter::new(file))
            }
        };
        Ok(Self { path, target })
    }

    /// Puts the file in its place.
    pub fn keep(self) -> Result<()> {
        let writing = || format!("writing {}", self.path.display());
        let buffered = match self.target {
            Target::Direct(mut device) => return device.flush().with_context(writing),
            Target::Beside(buffered) => buffered,
        };
        let file = buffered
            .into_inner()
            .map_err(io::IntoInnerError::into_error)
            .with_context(writing)?;
        for_everybody(file.path()).with_context(writing)?;
        fs::create_dir_all(folder_of(&self.path)).with_context(writing)?;
        file.persist(&self.path).with_context(writing)?;
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.target {
            Target::Beside(file) => file.write(bytes),
            Target::Direct(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.target {
            Target::Beside(file) => file.flush(),
            Target::Direct(file) => file.flush(),
        }
    }
}

/// A temporary file beside a path, in the nearest folder that is there.
///
/// # Errors
/// The folder takes none.
pub fn beside(path: &Path) -> io::Result<NamedTempFile> {
    NamedTempFile::new_in(existing(folder_of(path)))
}

/// Temporary files can be read by their owner alone, a report by everybody.
///
/// # Errors
/// The system refuses.
pub fn for_everybody(path: &Path) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(path, fs::Permissions::from_mode(0o644))?;
    }
    #[cfg(not(unix))]
    let _ = path;
    Ok(())
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// The nearest folder at or above `folder` that exists.
fn existing(folder: &Path) -> &Path {
    folder
        .ancestors()
        .find(|folder| folder.exists())
        .unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_a_file_and_leaves_nothing_else_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/report.html");
        write_whole(&path, b"old").unwrap();
        write_whole(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn names_the_file_that_cannot_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plain");
        fs::write(&file, b"").unwrap();
        let error = write_whole(&file.join("below"), b"x").unwrap_err();
        assert!(format!("{error:#}").contains("plain/below"), "{error:#}");
    }

    #[test]
    fn a_file_that_is_not_kept_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = WholeFile::create(&folder.path().join("deep/half.csv")).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[cfg(unix)]
    #[test]
    fn a_device_stays_a_device() {
        write_whole(Path::new("/dev/null"), b"x").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
