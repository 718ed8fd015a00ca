//! A pseudo-terminal in the place of the USB cable: programs open its path as they open a Nano's
//! port.
//!
//! Only the program that opens the path holds the other side, so that its opening and closing can
//! be seen, as by DTR on a real port; so can the rate that it asks for (the 1200-baud touch).

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Bytes read at once.
const CHUNK: usize = 4096;

/// Our side of a pseudo-terminal.
#[derive(Debug)]
pub struct Pty {
    master: OwnedFd,
    path: PathBuf,
}

impl Pty {
    /// Creates a pseudo-terminal in raw mode.
    ///
    /// # Errors
    /// The system's error.
    pub fn open() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        // A program that is started meanwhile would keep the terminal open.
        rustix::io::fcntl_setfd(&master, rustix::io::FdFlags::CLOEXEC)?;
        let name = ptsname(&master, Vec::new())?;
        // Once it has been opened and closed, HUP tells whether a program has it open. The mode
        // stays.
        let other = open(name.as_c_str(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty())?;
        let mut mode = tcgetattr(&other)?;
        mode.make_raw();
        tcsetattr(&other, OptionalActions::Now, &mode)?;
        let path = std::ffi::OsString::from_vec(name.into_bytes()).into();
        Ok(Self { master, path })
    }

    /// The path that programs open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True while a program has it open.
    pub fn is_open(&self) -> bool {
        let mut asked = [PollFd::new(&self.master, PollFlags::IN)];
        match poll(&mut asked, Some(&Timespec::default())) {
            Ok(_) => !asked[0].revents().contains(PollFlags::HUP),
            Err(_) => false,
        }
    }

    /// The rate that the program has asked for, baud.
    pub fn baud(&self) -> Option<u32> {
        Some(tcgetattr(self.master.as_fd()).ok()?.output_speed())
    }

    /// At most 4096 bytes that the program has written; empty if there are none, or no program.
    ///
    /// # Errors
    /// The system's error.
    pub fn read(&self) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; CHUNK];
        let count = none_if_busy(rustix::io::read(&self.master, &mut bytes))?;
        bytes.truncate(count);
        Ok(bytes)
    }

    /// Writes as much of `bytes` as there is room for; the number of bytes written.
    ///
    /// # Errors
    /// The system's error.
    pub fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        none_if_busy(rustix::io::write(&self.master, bytes))
    }
}

/// No bytes where there are none, no room for any, or no program.
fn none_if_busy(count: rustix::io::Result<usize>) -> io::Result<usize> {
    match count {
        Err(Errno::AGAIN | Errno::IO | Errno::INTR) => Ok(0),
        count => Ok(count?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::OpenOptions;
    use std::io::{Read, Write};

    #[test]
    fn bytes_pass_unchanged_and_opening_and_closing_show() {
        let pty = Pty::open().unwrap();
        assert!(!pty.is_open());
        let program = || OpenOptions::new().read(true).write(true).open(pty.path());
        for _ in 0..2 {
            let mut program = program().unwrap();
            assert!(pty.is_open());
            program.write_all(b"\x03\r\n\x00\xFD").unwrap();
            assert_eq!(pty.read().unwrap(), b"\x03\r\n\x00\xFD");
            assert_eq!(pty.write(b"\n\x04\xFE").unwrap(), 3);
            let mut heard = [0; 3];
            program.read_exact(&mut heard).unwrap();
            assert_eq!(&heard, b"\n\x04\xFE");
            drop(program);
            assert!(!pty.is_open());
        }
    }

    #[test]
    fn a_program_that_does_not_read_takes_no_more_at_some_point_and_blocks_nothing() {
        let pty = Pty::open().unwrap();
        let _program = OpenOptions::new().read(true).open(pty.path()).unwrap();
        let mut taken = 0;
        while taken < 1_000_000 {
            match pty.write(&[0x55; 1000]).unwrap() {
                0 => return,
                count => taken += count,
            }
        }
        panic!("{taken} bytes taken by nobody");
    }
}
