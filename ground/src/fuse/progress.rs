//! How far long work is: a bar on a terminal, elsewhere a line now and then.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Work that is shorter than this says nothing where there is no terminal, and longer work speaks as often.
const INTERVAL: Duration = Duration::from_secs(2);

/// Progress over all files, in bytes.
pub struct Progress {
    bar: ProgressBar,
    /// When a line is due, where there is no terminal.
    due: Option<Instant>,
    bytes: u64,
    done: u64,
}

impl Progress {
    /// For `bytes` to be read.
    pub fn new(bytes: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal {
            ProgressBar::new(bytes)
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {eta}  {msg}") {
            bar.set_style(style);
        }
        Self {
            bar,
            due: (!terminal).then(|| Instant::now() + INTERVAL),
            bytes,
            done: 0,
        }
    }

    /// `read` bytes of the file `name` have been read.
    pub fn at(&mut self, name: &str, read: u64) {
        let position = self.done + read;
        match self.due {
            None => {
                self.bar.set_message(name.to_owned());
                self.bar.set_position(position);
            }
            Some(due) if Instant::now() >= due => {
                let percent = 100 * position / self.bytes.max(1);
                eprintln!("{percent} %: {name}");
                self.due = Some(Instant::now() + INTERVAL);
            }
            Some(_) => {}
        }
    }

    /// A file of `bytes` has been read.
    pub fn file_done(&mut self, bytes: u64) {
        self.done += bytes;
    }

    /// All is done.
    pub fn end(self) {
        self.bar.finish_and_clear();
    }
}
