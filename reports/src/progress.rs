//! Progress on standard error: on a terminal a line that is drawn again and again.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between two lines where there is no terminal; shorter work prints none.
pub(crate) const INTERVAL: Duration = Duration::from_secs(2);

/// A bar of `steps` steps, by a template of [`ProgressStyle`].
pub fn bar(steps: u64, template: &str) -> ProgressBar {
    drawn(ProgressBar::new(steps), template)
}

/// A spinner, by a template of [`ProgressStyle`].
pub fn spinner(template: &str) -> ProgressBar {
    drawn(ProgressBar::new_spinner(), template)
}

fn drawn(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Progress over work in several parts, in bytes or any other unit. Where there is no terminal it
/// is a line every two seconds.
pub struct Progress {
    bar: ProgressBar,
    /// When a line is due, where there is no terminal.
    due: Option<Instant>,
    whole: u64,
    done: u64,
}

impl Progress {
    /// Begins, for work of the size `whole`.
    pub fn new(whole: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = match terminal {
            true => bar(whole, "{wide_bar} {percent:>3} %  {eta}  {msg}"),
            false => ProgressBar::hidden(),
        };
        Self { bar, due: (!terminal).then(|| Instant::now() + INTERVAL), whole, done: 0 }
    }

    /// Reports that `done` of the part `name` is done.
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
