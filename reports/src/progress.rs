//! Progress on standard error: on a terminal a line that is drawn again and again.

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
    due: Instant,
    done: u64,
}

impl Progress {
    /// Begins, for work of the size `whole`.
    pub fn new(whole: u64) -> Self {
        let bar = bar(whole.max(1), "{wide_bar} {percent:>3} %  {eta}  {msg}");
        Self { bar, due: Instant::now() + INTERVAL, done: 0 }
    }

    /// Reports that `done` of the part `name` is done.
    pub fn at(&mut self, name: &str, done: u64) {
        let position = self.done + done;
        self.bar.set_message(name.to_owned());
        self.bar.set_position(position);
        if self.bar.is_hidden() && Instant::now() >= self.due {
            eprintln!("{} %: {name}", 100 * position / self.bar.length().unwrap_or(1));
            self.due = Instant::now() + INTERVAL;
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
