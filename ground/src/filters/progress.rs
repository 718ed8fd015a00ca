//! Progress of long work on standard error: a bar on a terminal, elsewhere a line every two
//! seconds.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between two lines where there is no terminal; shorter work prints none.
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
    /// Begins, for so much work.
    pub fn new(whole: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal { ProgressBar::new(whole) } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {eta}  {msg}") {
            bar.set_style(style);
        }
        Self { bar, due: (!terminal).then(|| Instant::now() + INTERVAL), whole, done: 0 }
    }

    /// Reports that so much of the part `name` is done.
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

    /// Reports that a part of this size is done.
    pub fn part_done(&mut self, part: u64) {
        self.done += part;
    }

    /// Takes the bar away: all is done.
    pub fn end(self) {
        self.bar.finish_and_clear();
    }
}
