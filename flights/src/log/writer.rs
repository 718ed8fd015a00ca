//! A log as it is written, of what happens now or of what is there already.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tempfile::TempPath;

use super::{has_extension, mcap, now_us};
use report::exit::BadInput;
use report::file;

/// A log that is being written.
pub struct Writer {
    form: Form,
    path: PathBuf,
    /// Where it stands until it is whole, if it may not stand in its place before.
    beside: Option<TempPath>,
    /// Dropped behind the file.
    _place: Option<Place>,
}

/// The place of a log that is written there from its beginning on. One that has come to nothing
/// leaves no file.
struct Place(PathBuf);

impl Drop for Place {
    fn drop(&mut self) {
        if std::fs::metadata(&self.0).is_ok_and(|log| log.len() == 0) {
            // What stays is an empty file.
            let _ = std::fs::remove_file(&self.0);
        }
    }
}

enum Form {
    Tlog(BufWriter<File>),
    Mcap(Box<mcap::Writer>),
}

impl Writer {
    /// Begins a new log of what happens now, kept by `tool`; an old one is not overwritten. What
    /// was written survives the end of this program.
    ///
    /// # Errors
    /// [`BadInput`] if the file is there already or cannot be made.
    pub fn create(path: &Path, tool: &str) -> Result<Self> {
        let file = File::create_new(path).map_err(|error| unwritable(path, &error))?;
        let place = Place(path.to_owned());
        let writer = Self::of(path, tool, file, None)?;
        Ok(Self { _place: Some(place), ..writer })
    }

    /// Begins a new log that is made of something which is there already: it takes its place when
    /// it is ended, and is nowhere otherwise, since a part would pass for a whole.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn whole(path: &Path, tool: &str) -> Result<Self> {
        let refuse = |error| unwritable(path, &error);
        if path.exists() {
            return Err(refuse(ErrorKind::AlreadyExists.into()).into());
        }
        let (file, beside) = file::beside(path).map_err(refuse)?.into_parts();
        Self::of(path, tool, file, Some(beside))
    }

    fn of(path: &Path, tool: &str, file: File, beside: Option<TempPath>) -> Result<Self> {
        let form = if has_extension(path, "mcap") {
            let file = mcap::Writer::new(file, tool).with_context(|| writing(path))?;
            Form::Mcap(Box::new(file))
        } else {
            Form::Tlog(BufWriter::new(file))
        };
        Ok(Self { form, path: path.to_owned(), beside, _place: None })
    }

    /// Keeps a frame with the present time.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, frame: &[u8]) -> Result<()> {
        self.write_at(now_us(), frame)
    }

    /// Keeps a frame with a time, us since 1970.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_at(&mut self, time_us: u64, frame: &[u8]) -> Result<()> {
        let written = match &mut self.form {
            Form::Tlog(file) => file
                .write_all(&time_us.to_be_bytes())
                .and_then(|()| file.write_all(frame))
                .map_err(anyhow::Error::from),
            Form::Mcap(file) => file.write(time_us, frame).map_err(anyhow::Error::from),
        };
        written.with_context(|| writing(&self.path))
    }

    /// Hands what was written so far to the system, so that it survives the end of this program. An
    /// MCAP file keeps back the chunk that it is filling.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        if let Form::Tlog(file) = &mut self.form {
            file.flush().with_context(|| writing(&self.path))?;
        }
        Ok(())
    }

    /// Ends the log.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn end(mut self) -> Result<()> {
        self.flush()?;
        if let Form::Mcap(file) = self.form {
            file.end().with_context(|| writing(&self.path))?;
        }
        let Some(beside) = self.beside else {
            return Ok(());
        };
        let placed =
            file::for_everybody(&beside).and_then(|()| Ok(beside.persist_noclobber(&self.path)?));
        Ok(placed.map_err(|error| unwritable(&self.path, &error))?)
    }
}

/// What failed where a log cannot be written.
fn writing(path: &Path) -> String {
    format!("writing {}", path.display())
}

/// Why there is no such log.
fn unwritable(path: &Path, error: &std::io::Error) -> BadInput {
    let path = path.display();
    BadInput::new(match error.kind() {
        ErrorKind::AlreadyExists => {
            format!("{path} is there already: give the log another name")
        }
        _ => format!("cannot write {path}: {error}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::tests::TOOL;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_log_that_comes_to_nothing_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        drop(Writer::create(&path("empty.tlog"), TOOL).unwrap());
        assert!(!path("empty.tlog").exists());
        // No disk is as full as this one.
        let full = File::options().write(true).open("/dev/full").unwrap();
        File::create(path("full.tlog")).unwrap();
        let place = Place(path("full.tlog"));
        let mut writer = Writer {
            _place: Some(place),
            ..Writer::of(&path("full.tlog"), TOOL, full, None).unwrap()
        };
        writer.write(b"frame").unwrap();
        assert!(writer.end().is_err());
        assert!(!path("full.tlog").exists());
        let mut writer = Writer::create(&path("a.tlog"), TOOL).unwrap();
        writer.write(b"frame").unwrap();
        drop(writer);
        assert!(path("a.tlog").exists());
    }
}
