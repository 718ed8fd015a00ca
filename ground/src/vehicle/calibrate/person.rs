//! The person who leads the vehicle through a step of its set-up, at a terminal or at a page.

use anyhow::Result;
use calibration::coverage::Coverage;
use report::measure::Figures;
use serde::Serialize;

use super::keyboard::Typed;

/// What a step says to a person, and what the person answers. Nothing here waits.
pub trait Person {
    /// Whether somebody can be asked.
    fn is_there(&self) -> bool;

    /// Says what is to be done now.
    fn instruct(&mut self, words: &str);

    /// Says something that stays in sight, with the directions that were seen, if any.
    fn tell(&mut self, words: &str, seen: Option<&Coverage>);

    /// Shows how far the step is, 0 to 1, in words, and the directions that were seen.
    fn progress(&mut self, share: f64, words: &str, seen: Option<&Coverage>);

    /// Hides the progress.
    fn rest(&mut self);

    /// Shows what was found.
    ///
    /// # Errors
    /// It cannot be written.
    fn show(&mut self, figures: &Figures) -> Result<()>;

    /// Asks; [`Self::poll`] has the answer later.
    fn ask(&mut self, question: &Question);

    /// What has been answered so far.
    fn poll(&mut self) -> Typed;
}

/// A question, and the answers to it.
#[derive(Clone, Debug, Serialize)]
pub struct Question {
    /// The question.
    pub words: String,
    /// How it is answered at a keyboard.
    #[serde(skip)]
    pub keys: &'static str,
    /// The buttons of a page, each with what it stands for at a keyboard.
    pub buttons: &'static [(&'static str, &'static str)],
    /// What may be typed, such as a number's unit; `None` if there is nothing but the buttons.
    pub entry: Option<&'static str>,
    /// The same question as before, after an answer that does not end it.
    pub again: bool,
}

impl Question {
    /// A question that is asked for the first time, with nothing to type but the keys.
    pub fn new(
        words: impl Into<String>,
        keys: &'static str,
        buttons: &'static [(&'static str, &'static str)],
    ) -> Self {
        Self { words: words.into(), keys, buttons, entry: None, again: false }
    }
}

/// How a step has ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Ending {
    /// The vehicle has what the step is for.
    pub met: bool,
    /// What the vehicle or its flight tells speaks against it.
    pub refused: bool,
    /// What has become of it.
    pub words: String,
}

impl Ending {
    /// The person did not agree: the vehicle is as it was.
    pub fn unchanged(words: impl Into<String>) -> Self {
        Self { met: false, refused: false, words: words.into() }
    }

    /// The step was refused: the vehicle is as it was.
    pub fn refused(words: impl Into<String>) -> Self {
        Self { refused: true, ..Self::unchanged(words) }
    }

    /// The vehicle has what the step is for.
    pub fn met(words: impl Into<String>) -> Self {
        Self { met: true, ..Self::unchanged(words) }
    }
}
