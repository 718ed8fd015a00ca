//! What a command hands over: figures on standard output, and files that are written whole or not
//! at all.

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;
use tempfile::{NamedTempFile, TempPath};

use super::exit::Verdict;

/// Prints `value` on standard output as one line of JSON.
pub fn print_json(value: &impl Serialize) -> Result<()> {
    print(format_args!("{}\n", serde_json::to_string(value)?))
}

/// As [`print_json`], where it is wanted.
pub fn print_json_if(wanted: bool, value: &impl Serialize) -> Result<()> {
    if wanted { print_json(value) } else { Ok(()) }
}

/// Prints `text`, which ends its own lines, on standard output, where whoever waits for it has it
/// at once.
///
/// # Errors
/// Standard output cannot be written; the standard library's macros panic there.
pub fn print(text: impl Display) -> Result<()> {
    let mut out = io::stdout().lock();
    write!(out, "{text}").and_then(|()| out.flush()).context("writing to standard output")
}

/// Ends a command that has `printed` its figures: writes the page, names on standard error what was
/// `missed`, and complains last of what could not be written, so that nothing else is lost with it.
pub fn hand_over(
    printed: Result<()>,
    page: Option<(&Path, String)>,
    missed: &[String],
) -> Result<Verdict> {
    let written = page.map_or(Ok(()), |(path, page)| {
        write_whole(path, page.as_bytes())?;
        eprintln!("report: {}", path.display());
        Ok(())
    });
    for line in missed {
        eprintln!("missed: {line}");
    }
    printed.and(written).map(|()| Verdict::of(missed.is_empty()))
}

/// Writes `bytes` to `path`, whole or not at all. Creates the folder.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    file.write_all(bytes).with_context(|| format!("writing {}", path.display()))?;
    file.keep()
}

/// Writes the rows under a heading, if there is to be a table.
pub fn write_table(path: Option<&Path>, rows: &[impl Serialize]) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer.into_inner().context("the table")?;
    write_whole(path, &bytes)
}

/// A file that is written beside its place and moved there by [`keep`](Self::keep), so that an
/// interrupted command leaves the old file or the new one, never a part. Without `keep` it is
/// removed.
pub struct WholeFile {
    /// As it was named.
    name: PathBuf,
    /// Where it goes: behind a symbolic link, the file that this points to is replaced.
    path: PathBuf,
    file: BufWriter<File>,
    /// The temporary file beside the target, to be renamed; a device or a pipe cannot be replaced
    /// and has none.
    beside: Option<TempPath>,
}

impl WholeFile {
    /// Begins a file that is to be `path`; its folder is created when it is kept.
    pub fn create(path: &Path) -> Result<Self> {
        Self::begin(path).with_context(|| format!("writing {}", path.display()))
    }

    fn begin(name: &Path) -> io::Result<Self> {
        let path = fs::canonicalize(name).unwrap_or_else(|_| name.to_path_buf());
        let (file, beside) = match fs::metadata(&path) {
            Ok(found) if found.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
            Ok(found) if !found.is_file() => (File::options().write(true).open(&path)?, None),
            _ => {
                let (file, beside) = beside(&path)?.into_parts();
                (file, Some(beside))
            }
        };
        Ok(Self { name: name.to_path_buf(), path, file: BufWriter::new(file), beside })
    }

    /// Puts the file in its place.
    pub fn keep(self) -> Result<()> {
        let Self { name, path, file, beside } = self;
        let place = || {
            file.into_inner().map_err(io::IntoInnerError::into_error)?;
            let Some(beside) = beside else { return Ok(()) };
            for_everybody(&beside)?;
            fs::create_dir_all(folder_of(&path))?;
            beside.persist(&path).map_err(|refused| refused.error)
        };
        place().with_context(|| format!("writing {}", name.display()))
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Tries whether a file can be written to `path`, and leaves nothing behind. Devices and pipes are
/// not touched: whoever reads a pipe would see its end.
///
/// # Errors
/// It cannot.
pub fn try_place(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(found) if !found.is_file() && !found.is_dir() => Ok(()),
        _ => WholeFile::begin(path).map(drop),
    }
}

/// A temporary file beside a path, in the nearest folder that is there.
///
/// # Errors
/// The folder takes none.
pub fn beside(path: &Path) -> io::Result<NamedTempFile> {
    // The error would name the temporary file, which nobody asked for.
    NamedTempFile::new_in(existing(folder_of(path))).map_err(|error| error.kind().into())
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
    folder.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."))
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
    fn names_the_file_that_cannot_be_written_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plain");
        fs::write(&file, b"").unwrap();
        let path = file.join("below");
        let error = format!("{:#}", write_whole(&path, b"x").unwrap_err());
        let expected = format!("writing {}: not a directory", path.display());
        assert_eq!(error, expected);
        assert!(try_place(&path).is_err() && try_place(folder.path()).is_err());
    }

    #[test]
    fn a_place_that_was_tried_is_as_before() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("there.html");
        fs::write(&there, b"old").unwrap();
        try_place(&there).unwrap();
        try_place(&folder.path().join("deep/new.html")).unwrap();
        assert_eq!(fs::read(&there).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
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
