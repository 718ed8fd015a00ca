//! Whether an order to arm would be obeyed: the vehicle is asked before anybody presses it.

use std::time::Duration;

use client::request::MAY_ARM;
use client::{RefusalKind, Request, StateKind, Ticket};

use super::Session;

/// Time between two questions.
const PERIOD: Duration = Duration::from_millis(500);

/// What the vehicle has answered.
#[derive(Default)]
pub(super) struct Readiness {
    asked: Option<Ticket>,
    due: Duration,
    /// The newest answer; `None` before it, or where the firmware does not know the question.
    answer: Option<Result<(), RefusalKind>>,
}

impl Session<'_> {
    /// Asks wherever somebody may press Arm, unless an order waits for its own answer.
    pub(super) fn ask_readiness(&mut self) {
        let now = self.link.now();
        let client = self.link.client();
        if let Some(ticket) = self.readiness.asked {
            let Some(answer) = client.answer(ticket) else {
                return;
            };
            self.readiness.asked = None;
            let answer = match answer {
                Ok(()) => Some(Ok(())),
                Err(failure) => failure.refusal().map(Err),
            };
            if self.readiness.answer != answer {
                self.readiness.answer = answer;
                self.status_due = Duration::ZERO;
            }
        }
        if now < self.readiness.due || !self.waiting.is_empty() || client.heard().is_none() {
            return;
        }
        self.readiness.due = now + PERIOD;
        if client.state() == Some(StateKind::Standby) {
            self.readiness.asked = Some(self.link.request(Request::Order(MAY_ARM)));
        } else {
            self.readiness.answer = None;
        }
    }

    /// Whether an order to arm would be obeyed, and if not why not, where that is known. Outside of
    /// standby the state is the reason.
    pub(super) fn readiness(&mut self) -> (bool, String) {
        let client = self.link.client();
        match (client.state(), self.readiness.answer) {
            (Some(StateKind::Standby), Some(Ok(()))) => (true, String::new()),
            (Some(StateKind::Standby), Some(Err(why))) if why != RefusalKind::WrongState => {
                (false, why.to_string())
            }
            (Some(StateKind::Boot | StateKind::SelfTest | StateKind::Latched), _) => {
                let said = client.reason();
                let words = if said.is_empty() { client.state_name() } else { said.to_owned() };
                (false, words)
            }
            _ => (false, String::new()),
        }
    }
}
