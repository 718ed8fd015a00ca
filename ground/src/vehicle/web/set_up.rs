//! The set-up from the page: the steps of `tvc calibrate`, with the page in the place of the
//! terminal.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Result, ensure};
use calibration::coverage::{AROUND, BANDS, Coverage};
use serde::{Deserialize, Serialize};

use super::handle::Handle;
use super::model::Model;
use super::{logs, relay};
use crate::vehicle::calibrate::keyboard::Typed;
use crate::vehicle::calibrate::options::{Calibrate, Servo};
use crate::vehicle::calibrate::person::{self, Ending, Person};
use crate::vehicle::calibrate::session::Session;
use crate::vehicle::calibrate::{guided, hold, polarity, servo};
use crate::vehicle::link::Vehicle;

/// Lines of a step that are kept.
const LINES: usize = 40;
/// Share of the progress that a page can show.
const LEAST_SHARE: f64 = 0.005;
/// How long a holding angle is measured, s.
const HOLD_S: f64 = 8.0;

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
    instruction: String,
    /// What was done.
    lines: Vec<String>,
    /// How far it is, 0 to 1, while that is known.
    share: Option<f64>,
    /// The same in words.
    progress: String,
    /// How often each direction was seen, from the lowest band up.
    seen: Option<[[u32; AROUND]; BANDS]>,
    /// The question that waits for its answer.
    question: Option<Question>,
    /// Names and values of what was found.
    figures: Vec<[String; 2]>,
    /// Whether the vehicle has what the last step was for, and what became of it.
    met: bool,
    ending: String,
    /// The answer that nobody has taken yet.
    #[serde(skip)]
    reply: Option<String>,
    /// Questions so far.
    #[serde(skip)]
    asked: u64,
}

/// A question to the page.
#[derive(Clone, Debug, Serialize)]
struct Question {
    /// Its number: an answer to another one counts for nothing.
    id: u64,
    words: String,
    /// Buttons, each with its reply.
    buttons: Vec<[String; 2]>,
    /// What may be typed.
    entry: Option<String>,
    /// The same question as before.
    again: bool,
}

impl SetUp {
    /// A step begins.
    pub fn begin(&mut self, step: Step) {
        *self = Self {
            running: true,
            step,
            asked: self.asked,
            ..Self::default()
        };
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

    fn end(&mut self, ending: Ending) {
        (self.running, self.question, self.share) = (false, None, None);
        (self.met, self.ending) = (ending.met, ending.words);
    }
}

/// The person at the pages.
struct Page(Arc<Model>);

impl Person for Page {
    fn is_there(&self) -> bool {
        true
    }

    fn instruct(&mut self, words: &str) {
        self.0.lock().change_set_up(|now| {
            now.instruction = words.to_owned();
            (now.share, now.seen) = (None, None);
        });
    }

    fn tell(&mut self, words: &str, seen: Option<&Coverage>) {
        self.0.lock().change_set_up(|now| {
            now.lines.push(words.to_owned());
            if now.lines.len() > LINES {
                now.lines.remove(0);
            }
            now.seen = seen.map(|seen| *seen.counts());
        });
    }

    fn progress(&mut self, share: f64, words: &str, seen: Option<&Coverage>) {
        let mut state = self.0.lock();
        let now = state.set_up();
        let is_shown = now.share.is_some_and(|at| (share - at).abs() < LEAST_SHARE);
        if !is_shown || now.progress != words {
            state.change_set_up(|now| {
                (now.share, now.progress) = (Some(share.clamp(0.0, 1.0)), words.to_owned());
                now.seen = seen.map(|seen| *seen.counts());
            });
        }
    }

    fn rest(&mut self) {
        self.0.lock().change_set_up(|now| now.share = None);
    }

    fn show(&mut self, rows: &[[String; 2]], _: &str) -> Result<()> {
        let figures = rows.to_vec();
        self.0.lock().change_set_up(|now| {
            now.instruction.clear();
            now.figures = figures;
        });
        Ok(())
    }

    fn ask(&mut self, question: &person::Question<'_>) {
        let buttons = question.buttons.iter();
        let buttons = buttons.map(|(label, reply)| [*label, *reply].map(str::to_owned));
        self.0.lock().change_set_up(|now| {
            now.asked += 1;
            now.share = None;
            now.question = Some(Question {
                id: now.asked,
                words: question.words.to_owned(),
                buttons: buttons.collect(),
                entry: question.entry.map(str::to_owned),
                again: question.again,
            });
        });
    }

    fn poll(&mut self) -> Typed {
        let mut state = self.0.lock();
        if state.set_up().reply.is_none() {
            return Typed::Nothing;
        }
        let reply = state.change_set_up(|now| now.reply.take());
        reply.map_or(Typed::Nothing, Typed::Line)
    }
}

/// Leads through a step, which has begun; `stop` ends it at any moment. Files go to `logs`.
pub fn run(
    step: Step,
    vehicle: &Handle,
    model: &Arc<Model>,
    logs: &Path,
    stop: &'static AtomicBool,
) {
    let led = catch_unwind(AssertUnwindSafe(|| lead(step, vehicle, model, logs, stop)));
    let ending = match led {
        Ok(Ok(ending)) => ending,
        Ok(Err(error)) => Ending::unchanged(format!("{error:#}")),
        Err(_) => Ending::unchanged("this step broke off"),
    };
    model.lock().change_set_up(|now| now.end(ending));
}

fn lead(
    step: Step,
    vehicle: &Handle,
    model: &Arc<Model>,
    logs: &Path,
    stop: &'static AtomicBool,
) -> Result<Ending> {
    let vehicle = Vehicle::at(relay::link(vehicle.clone()))?;
    let mut session = Session::new(vehicle, Box::new(Page(model.clone())), stop, false)?;
    Ok(match step {
        Step::Sensors => {
            let log = logs::free(logs, "calibration")?;
            guided::calibrate(&mut session, &Calibrate::guided(&log))?.1
        }
        Step::Servo => servo::set_up(&mut session, &Servo::default())?.1,
        Step::Polarity => polarity::check(&mut session)?.1,
        Step::Hold => hold::measure(&mut session, HOLD_S)?.1,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_counts_for_the_question_that_is_asked_and_once() {
        let model = Arc::new(Model::default());
        let mut page = Page(model.clone());
        let answer = |id, reply: &str| {
            let answered = model
                .lock()
                .change_set_up(|now| now.answer(id, reply.to_owned()));
            answered.is_ok()
        };
        let question = person::Question {
            words: "Is it so?",
            keys: "",
            buttons: &[("Yes", "y")],
            entry: None,
            again: false,
        };
        assert!(!answer(0, "y") && !answer(1, "y"), "nothing is asked");
        page.ask(&question);
        assert_eq!(page.poll(), Typed::Nothing);
        assert!(!answer(2, "y"), "not asked yet");
        assert!(answer(1, " n ") && !answer(1, "y"), "answered already");
        assert_eq!(page.poll(), Typed::Line("n".into()));
        assert_eq!(page.poll(), Typed::Nothing);
        // The numbers go on in the next step.
        model.lock().change_set_up(|now| now.begin(Step::Polarity));
        page.ask(&question);
        assert!(!answer(1, "y") && answer(2, "y"));
        // What a step has not taken when it ends is nothing to the next one.
        model.lock().change_set_up(|now| now.begin(Step::Servo));
        assert_eq!(page.poll(), Typed::Nothing);
    }
}
