//! How far long work is: a bar on a terminal, elsewhere a line now and then.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Work that is shorter than this says nothing where there is no terminal, and longer work speaks as often.
const INTERVAL: Duration = Duration::from_secs(2);

/// Progress over work in several parts, in bytes or any other unit.
pub struct Progress {
    bar: ProgressBar,
    /// When a line is due, where there is no terminal.
    due: Option<Instant>,
    whole: u64,
    done: u64,
}

impl Progress {
    /// For work of this much.
    pub fn new(whole: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal {
            ProgressBar::new(whole)
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {eta}  {msg}") {
            bar.set_style(style);
        }
        Self {
            bar,
            due: (!terminal).then(|| Instant::now() + INTERVAL),
            whole,
            done: 0,
        }
    }

    /// So much of the part `name` is done.
    pub fn at(&mut self, name: &str, done: u64) {
        let position = self.done + done;
        match self.due {
            None => {
                self.bar.set_message(name.to_owned());
                self.bar.set_position(position);
            }
            Some(due) if Instant::now() >= due => {
                let percent = 100 * position / self.whole.max(1);
                eprintln!("{percent} %: {name}");
                self.due = Some(Instant::now() + INTERVAL);
            }
            Some(_) => {}
        }
    }

    /// A part of this much is done.
    pub fn part_done(&mut self, part: u64) {
        self.done += part;
    }

    /// All is done.
    pub fn end(self) {
        self.bar.finish_and_clear();
    }
}
