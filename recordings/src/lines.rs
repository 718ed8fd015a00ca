//! Lines of a table that end.

use std::io::{Error, ErrorKind, Read, Result};

/// Longest line, bytes: thousands of columns.
const LONGEST: usize = 1 << 20;

/// What is read of a table, as long as its lines end: a reader of CSV holds a whole line in memory,
/// and what never ends, such as a device, would fill it.
#[derive(Debug)]
pub struct Lines<R> {
    inner: R,
    /// Bytes since the last line ended.
    length: usize,
}

impl<R> Lines<R> {
    /// The lines of `inner`.
    pub fn new(inner: R) -> Self {
        Self { inner, length: 0 }
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize> {
        let count = self.inner.read(bytes)?;
        let end = bytes[..count].iter().rposition(|byte| *byte == b'\n');
        self.length = match end {
            Some(end) => count - end - 1,
            None => self.length + count,
        };
        match self.length > LONGEST {
            true => Err(Error::new(ErrorKind::InvalidData, "it has a line above 1 MiB")),
            false => Ok(count),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Cursor, repeat};

    #[test]
    fn lines_that_end_are_read_and_one_that_does_not_is_refused() {
        let mut read = Vec::new();
        let lines = vec![b"a,b\n".to_vec(); 1 << 20].concat();
        Lines::new(Cursor::new(&lines)).read_to_end(&mut read).unwrap();
        assert_eq!(read, lines);
        let error = Lines::new(repeat(0)).read_to_end(&mut Vec::new()).unwrap_err();
        assert!(error.to_string().contains("1 MiB"), "{error}");
    }
}
