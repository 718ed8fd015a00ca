//! Files that are read whole: none is longer than such a file can be, so that what never ends, a
//! device or a pipe, does not fill the memory.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::exit::BadInput;

/// Longest text, bytes: a hundred times what people write.
pub const TEXT: u64 = 1 << 20;
/// Longest image, bytes: with all of its debug information it has some megabytes.
pub const IMAGE: u64 = 64 << 20;
/// Longest log or recording, bytes: ten hours of everything that a vehicle tells.
pub const LOG: u64 = 1 << 30;
/// Longest answer of a rig, bytes.
pub const ANSWER: u64 = 64 << 10;

/// The text of a file.
///
/// # Errors
/// It cannot be read, is no text, or is longer than [`TEXT`].
pub fn text(path: &Path) -> io::Result<String> {
    String::from_utf8(bytes(path, TEXT)?).map_err(|error| {
        // The byte order marks of editors on Windows.
        let is_utf16 = matches!(error.as_bytes(), [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..]);
        io::Error::other(match is_utf16 {
            true => "it is UTF-16: save it as UTF-8",
            false => "it is no text",
        })
    })
}

/// As [`text`], for a command whose input the file is.
///
/// # Errors
/// Those of [`text`], behind the file's name.
pub fn file_text(path: &Path) -> Result<String, BadInput> {
    text(path).map_err(|error| BadInput::of(path, error))
}

/// The bytes of a file.
///
/// # Errors
/// It cannot be read, or is longer than `longest`.
pub fn bytes(path: &Path, longest: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path, longest)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A file to read from its beginning to its end.
///
/// # Errors
/// It cannot be opened, or is known to be longer than `longest`.
pub fn open(path: &Path, longest: u64) -> io::Result<impl Read> {
    let file = File::open(path)?;
    let about = file.metadata()?;
    let limited = Limited { file, longest, left: longest };
    match about.is_file() && about.len() > longest {
        true => Err(limited.too_long()),
        false => Ok(limited),
    }
}

/// A file that is an error beyond its longest length.
struct Limited {
    file: File,
    longest: u64,
    /// Bytes that may still come.
    left: u64,
}

impl Limited {
    fn too_long(&self) -> io::Error {
        io::Error::other(format!("it is too long, above {} MiB", self.longest >> 20))
    }
}

impl Read for Limited {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        let left = self.left.checked_sub(count as u64);
        self.left = left.ok_or_else(|| self.too_long())?;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_limit_and_refused_above() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(bytes(&path, 5).unwrap(), b"12345");
        assert!(bytes(&path, 4).unwrap_err().to_string().contains("too long"));
        assert_eq!(text(&path).unwrap(), "12345");
        std::fs::write(&path, [0xFF]).unwrap();
        assert!(text(&path).unwrap_err().to_string().contains("no text"));
        std::fs::write(&path, b"\xFF\xFEP\0I\0D\0").unwrap();
        let refused = text(&path).unwrap_err().to_string();
        assert!(refused.contains("save it as UTF-8"), "{refused}");
        assert!(bytes(folder.path(), 5).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn what_never_ends_is_refused() {
        let refused = bytes(Path::new("/dev/zero"), TEXT).unwrap_err().to_string();
        assert!(refused.contains("above 1 MiB"), "{refused}");
    }
}
