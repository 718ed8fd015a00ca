//! What the pages show of the set-up, and what they answer.

use anyhow::{Result, ensure};
use calibration::coverage::{AROUND, BANDS};
use serde::{Deserialize, Serialize};

use crate::vehicle::calibrate::person::{self, Ending};

/// A step of the set-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Step {
    /// Sensors and mount.
    #[default]
    Sensors,
    /// Centre, angle, direction and ends of the servo.
    Servo,
    /// Whether the rudder answers the right way.
    Polarity,
    /// The servo angle that holds a lateral offset of the mass.
    Hold,
}

/// A step that is under way, or how the last one ended.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SetUp {
    /// It is under way.
    pub running: bool,
    /// Which one.
    pub step: Step,
    /// What is to be done now.
    pub instruction: String,
    /// What was done.
    pub lines: Vec<String>,
    /// How far it is, 0 to 1, while that is known.
    pub share: Option<f64>,
    /// The same in words.
    pub progress: String,
    /// How often each direction was seen, from the lowest band up.
    pub seen: Option<[[u32; AROUND]; BANDS]>,
    /// The question that waits for its answer.
    pub question: Option<Question>,
    /// Names and values of what was found.
    pub figures: Vec<[String; 2]>,
    /// Whether the vehicle has what the last step was for.
    met: bool,
    /// What became of it, in words.
    ending: String,
    /// The answer that nobody has taken yet.
    #[serde(skip)]
    pub reply: Option<String>,
    /// Questions so far.
    #[serde(skip)]
    pub asked: u64,
}

/// A question to the page.
#[derive(Clone, Debug, Serialize)]
pub struct Question {
    /// Its number: an answer to another one counts for nothing.
    pub id: u64,
    /// The question itself.
    #[serde(flatten)]
    pub asked: person::Question,
}

impl SetUp {
    /// A step begins.
    pub fn begin(&mut self, step: Step) {
        *self = Self { running: true, step, asked: self.asked, ..Self::default() };
    }

    /// Takes in an answer.
    ///
    /// # Errors
    /// Another question is asked now, or none.
    pub fn answer(&mut self, id: u64, reply: String) -> Result<()> {
        let is_asked = self.question.as_ref().is_some_and(|asked| asked.id == id);
        ensure!(is_asked, "this question is not asked any more");
        self.question = None;
        self.reply = Some(reply.trim().to_owned());
        Ok(())
    }

    /// A step has ended.
    pub fn end(&mut self, ending: Ending) {
        (self.running, self.question, self.share) = (false, None, None);
        (self.met, self.ending) = (ending.met, ending.words);
    }
}
