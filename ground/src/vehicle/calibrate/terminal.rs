//! The person at a terminal: what a step says goes to standard error, and the keyboard answers.

use anyhow::Result;
use calibration::coverage::Coverage;
use indicatif::{ProgressBar, ProgressStyle};

use super::keyboard::{Keyboard, Typed, is_attended};
use super::person::{Person, Question};
use report::file::print;
use report::measure::Figures;

/// Width of a line that fits every terminal.
const LINE: usize = 78;

/// The terminal of this program, or whatever its standard streams are.
pub struct Terminal {
    bar: ProgressBar,
    keyboard: Option<Keyboard>,
    /// Standard output has nothing but JSON: figures go to standard error, too.
    json: bool,
}

impl Terminal {
    /// The terminal of this program.
    pub fn new(json: bool) -> Self {
        let bar = ProgressBar::new(1000);
        if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, keyboard: None, json }
    }
}

impl Person for Terminal {
    fn is_there(&self) -> bool {
        is_attended()
    }

    fn instruct(&mut self, words: &str) {
        self.tell(words, None);
    }

    fn tell(&mut self, words: &str, seen: Option<&Coverage>) {
        let words = with_picture(words, seen);
        self.bar.suspend(|| eprintln!("{words}"));
    }

    fn progress(&mut self, share: f64, words: &str, seen: Option<&Coverage>) {
        if self.bar.is_finished() {
            self.bar.reset();
        }
        self.bar.set_position((share.clamp(0.0, 1.0) * 1000.0) as u64);
        self.bar.set_message(with_picture(words, seen));
    }

    fn rest(&mut self) {
        self.bar.finish_and_clear();
    }

    fn show(&mut self, figures: &Figures) -> Result<()> {
        let text = figures.text();
        if self.json {
            eprint!("{text}");
            Ok(())
        } else {
            print(text)
        }
    }

    fn ask(&mut self, question: &Question) {
        // The bar is hidden until the next progress: the question stands on a line of its own.
        self.rest();
        let Question { words, keys, .. } = question;
        // The keys have been said where the question is asked again.
        match (question.again, words.len() + keys.len() < LINE) {
            (true, _) => eprint!("{words} "),
            (false, true) => eprint!("{words} {keys} "),
            (false, false) => eprint!("{words}\n{keys} "),
        }
        self.keyboard.get_or_insert_with(Keyboard::listen);
    }

    fn poll(&mut self) -> Typed {
        self.keyboard.as_ref().map_or(Typed::Nobody, Keyboard::poll)
    }
}

fn with_picture(words: &str, seen: Option<&Coverage>) -> String {
    seen.map_or(words.to_owned(), |seen| format!("{words}\n{}", picture(seen)))
}

/// The directions that were seen, as characters: rows of the sphere from the top down, azimuth
/// along each. Full cells were seen often, empty ones never.
fn picture(coverage: &Coverage) -> String {
    let rows = coverage.counts().iter().rev().map(|band| {
        let cells = band.iter().map(|count| match count {
            0 => " \u{b7} ",
            1..=3 => "\u{2591}\u{2591}\u{2591}",
            4..=9 => "\u{2592}\u{2592}\u{2592}",
            _ => "\u{2588}\u{2588}\u{2588}",
        });
        format!("   |{}|", cells.collect::<String>())
    });
    let mut text = rows.collect::<Vec<_>>().join("\n");
    text.push_str("\n    -180 deg  azimuth of the field  180");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn what_was_seen_is_filled_with_the_top_above() {
        let up: Coverage = [Vector3::new(0.1, 0.1, 1.0); 4].into_iter().collect();
        let text = picture(&up);
        let rows: Vec<&str> = text.lines().collect();
        assert_eq!(rows.len(), 7);
        assert!(rows[0].contains("\u{2592}\u{2592}\u{2592}"), "{text}");
        assert!(!rows[1].contains('\u{2592}'), "{text}");
        assert!(rows[0].matches('\u{b7}').count() == 7);
    }
}
