//! The set-up from the page: the steps of `tvc calibrate`, with the page in the place of the
//! terminal.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use ::report::measure::Figures;
use anyhow::Result;
use calibration::coverage::Coverage;
use calibration::{STANDARD_GRAVITY, Wanted};

use super::handle::Handle;
use super::model::Model;
use super::model::set_up::{Question, Step};
use super::{logs, relay};
use crate::vehicle::calibrate::keyboard::Typed;
use crate::vehicle::calibrate::options::{Files, Servo};
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

/// The person at the pages.
struct Page(Arc<Model>);

impl Person for Page {
    fn is_there(&self) -> bool {
        true
    }

    fn instruct(&mut self, words: &str) {
        let now = &mut *self.0.lock().set_up;
        now.instruction = words.to_owned();
        (now.share, now.seen) = (None, None);
    }

    fn tell(&mut self, words: &str, seen: Option<&Coverage>) {
        let now = &mut *self.0.lock().set_up;
        now.lines.push(words.to_owned());
        if now.lines.len() > LINES {
            now.lines.remove(0);
        }
        now.seen = seen.map(|seen| *seen.counts());
    }

    fn progress(&mut self, share: f64, words: &str, seen: Option<&Coverage>) {
        let mut state = self.0.lock();
        let is_shown = state.set_up.share.is_some_and(|at| (share - at).abs() < LEAST_SHARE);
        if !is_shown || state.set_up.progress != words {
            let now = &mut *state.set_up;
            (now.share, now.progress) = (Some(share.clamp(0.0, 1.0)), words.to_owned());
            now.seen = seen.map(|seen| *seen.counts());
        }
    }

    fn rest(&mut self) {
        self.0.lock().set_up.share = None;
    }

    fn show(&mut self, figures: &Figures) -> Result<()> {
        let figures = figures.named();
        let now = &mut *self.0.lock().set_up;
        now.instruction.clear();
        now.figures = figures;
        Ok(())
    }

    fn ask(&mut self, question: &person::Question) {
        let now = &mut *self.0.lock().set_up;
        now.asked += 1;
        now.share = None;
        now.question = Some(Question { id: now.asked, asked: question.clone() });
    }

    fn poll(&mut self) -> Typed {
        let mut state = self.0.lock();
        if state.set_up.reply.is_none() {
            return Typed::Nothing;
        }
        let reply = state.set_up.reply.take();
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
    let lead = || -> Result<Ending> {
        let vehicle = Vehicle::at(relay::link(vehicle.clone()))?;
        let mut session = Session::new(vehicle, Box::new(Page(model.clone())), stop, false)?;
        Ok(match step {
            Step::Sensors => {
                let files = Files::beside(&logs::free(logs, "calibration")?);
                let wanted = Wanted { only: Vec::new(), gravity: STANDARD_GRAVITY, level_s: None };
                let (_, ending, written) = guided::calibrate(&mut session, &wanted, None, &files)?;
                if let Err(why) = written {
                    session.say(&format!("{why:#}"));
                }
                ending
            }
            Step::Servo => servo::set_up(&mut session, &Servo::default())?.1,
            Step::Polarity => polarity::check(&mut session)?.1,
            Step::Hold => hold::measure(&mut session, HOLD_S)?.1,
        })
    };
    let ending = match catch_unwind(AssertUnwindSafe(lead)) {
        Ok(Ok(ending)) => ending,
        Ok(Err(error)) => Ending::unchanged(format!("{error:#}")),
        Err(_) => Ending::unchanged("this step broke off"),
    };
    model.lock().set_up.end(ending);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_counts_for_the_question_that_is_asked_and_once() {
        let model = Arc::new(Model::default());
        let mut page = Page(model.clone());
        let answer = |id, reply: &str| {
            let answered = model.lock().set_up.answer(id, reply.to_owned());
            answered.is_ok()
        };
        let question = person::Question::new("Is it so?", "", &[("Yes", "y")]);
        assert!(!answer(0, "y") && !answer(1, "y"), "nothing is asked");
        page.ask(&question);
        assert_eq!(page.poll(), Typed::Nothing);
        assert!(!answer(2, "y"), "not asked yet");
        assert!(answer(1, " n ") && !answer(1, "y"), "answered already");
        assert_eq!(page.poll(), Typed::Line("n".into()));
        assert_eq!(page.poll(), Typed::Nothing);
        // The numbers go on in the next step.
        model.lock().set_up.begin(Step::Polarity);
        page.ask(&question);
        assert!(!answer(1, "y") && answer(2, "y"));
        // What a step has not taken when it ends is nothing to the next one.
        model.lock().set_up.begin(Step::Servo);
        assert_eq!(page.poll(), Typed::Nothing);
    }
}
