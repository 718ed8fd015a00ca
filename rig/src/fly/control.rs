//! A Unix socket at which other programs act on the rig. Each line that they send is an
//! [`Action`](super::action::Action); the answer to it is a line of JSON.

use std::fs::Permissions;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Most connections at the same time; for one more, the oldest is closed.
const CLIENTS: usize = 8;
/// Longest line, bytes.
const LINE: usize = 256;

/// The socket of a rig; removed at its end.
#[derive(Debug)]
pub struct Control {
    listener: UnixListener,
    path: PathBuf,
    clients: Vec<Client>,
}

#[derive(Debug)]
struct Client {
    stream: UnixStream,
    line: Vec<u8>,
}

impl Control {
    /// Opens the socket, which only this user can use. One that an earlier rig has left is
    /// replaced.
    ///
    /// # Errors
    /// A file that is no socket is at this path, the socket is of a rig that runs, or the system
    /// refuses.
    pub fn open(path: &Path) -> io::Result<Self> {
        match std::fs::symlink_metadata(path) {
            Ok(there) if !there.file_type().is_socket() => {
                return Err(io::Error::new(
                    ErrorKind::AlreadyExists,
                    "is there already and is no socket",
                ));
            }
            Ok(_) if UnixStream::connect(path).is_ok() => {
                return Err(io::Error::new(ErrorKind::AddrInUse, "another rig has it"));
            }
            Ok(_) => std::fs::remove_file(path)?,
            Err(_) => {}
        }
        let listener = UnixListener::bind(path)?;
        std::fs::set_permissions(path, Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, path: path.to_owned(), clients: Vec::new() })
    }

    /// Answers the lines that have come, and waits for none.
    pub fn poll(&mut self, mut answer: impl FnMut(&str) -> String) {
        if let Ok((stream, _)) = self.listener.accept()
            && stream.set_nonblocking(true).is_ok()
        {
            if self.clients.len() == CLIENTS {
                self.clients.remove(0);
            }
            self.clients.push(Client { stream, line: Vec::new() });
        }
        self.clients.retain_mut(|client| client.serve(&mut answer).is_ok());
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

impl Client {
    /// Answers the lines that the program has sent.
    ///
    /// # Errors
    /// The program has gone, does not read its answers, or has sent a line that is too long.
    fn serve(&mut self, answer: &mut impl FnMut(&str) -> String) -> io::Result<()> {
        let mut bytes = [0; LINE];
        match self.stream.read(&mut bytes) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => self.line.extend_from_slice(&bytes[..count]),
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                return Ok(());
            }
            Err(error) => return Err(error),
        }
        while let Some(end) = self.line.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.line.drain(..=end).collect();
            writeln!(self.stream, "{}", answer(String::from_utf8_lossy(&line).trim()))?;
        }
        match self.line.len() {
            0..LINE => Ok(()),
            _ => Err(ErrorKind::InvalidData.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader};

    #[test]
    fn lines_are_answered_and_whoever_sends_none_is_left() {
        let folder = std::env::temp_dir().join(format!("control-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("nano.control");
        let mut control = Control::open(&path).unwrap();
        assert!(Control::open(&path).is_err(), "another one is there");
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);

        let mut chatter = UnixStream::connect(&path).unwrap();
        chatter.write_all(&[b'x'; 2 * LINE]).unwrap();
        let mut program = UnixStream::connect(&path).unwrap();
        program.write_all(b"tilt 1\nreset\n").unwrap();
        for _ in 0..4 {
            control.poll(str::to_uppercase);
        }
        let mut lines = BufReader::new(program).lines();
        assert_eq!(lines.next().unwrap().unwrap(), "TILT 1");
        assert_eq!(lines.next().unwrap().unwrap(), "RESET");
        assert_eq!(control.clients.len(), 1);

        drop(control);
        assert!(!path.exists());
        std::fs::write(&path, "mine").unwrap();
        assert!(Control::open(&path).is_err(), "no socket");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
