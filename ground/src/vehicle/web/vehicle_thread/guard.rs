//! What keeps the vehicle from being left armed: its own watch over this program, and this
//! program's last act.

use std::io::Write;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use anyhow::Result;
use client::request::DISARM;
use client::state::is_in_operation;
use client::{Failure, Parameter, Request, Ticket};

use super::super::handle::Ask;
use super::Session;
use crate::vehicle::calibrate::write::{UNCHECKED, WATCHED};
use crate::vehicle::watch::{CUT_POWER, FS_HOST};
use flights::param_file::{POLARITY, SECOND_POLARITY};

/// Time between two attempts to set it.
const RETRY: Duration = Duration::from_secs(1);
/// How long the last orders wait for their answers, each.
const LAST: Duration = Duration::from_millis(500);
/// What the person at the terminal is told.
const DISARMED: &str = "the vehicle has been disarmed";

/// The vehicle's watch over this program: on while it works, never stored in the vehicle's flash.
/// Whoever sets it at a page decides about it.
#[derive(Default)]
pub(super) struct HostWatch {
    /// This program has set it.
    on: bool,
    /// A page has set it.
    chosen: bool,
    asked: Option<Ticket>,
    due: Duration,
}

impl HostWatch {
    /// Whether it is on by this program's wish.
    pub(super) fn is_on(&self) -> bool {
        self.on && !self.chosen
    }

    /// The same at a port that was opened again, where nothing is asked yet.
    pub(super) fn at_new_port(self) -> Self {
        Self { on: self.on, chosen: self.chosen, ..Self::default() }
    }

    /// The vehicle's flash has it on: an operator decides about it.
    pub(super) fn leave_to_operator(&mut self) {
        self.on = false;
    }

    /// Takes note of what a page asks for.
    pub(super) fn before(&mut self, request: &Request) {
        self.chosen |= matches!(request, Request::Set(row) if row.name == FS_HOST);
    }
}

/// To set a parameter.
pub(super) fn set(name: &str, value: f32) -> Request {
    Request::Set(Parameter::new(name, value))
}

impl Session<'_> {
    /// Asks the vehicle to watch over this program, wherever it does not.
    pub(super) fn watch_host(&mut self) {
        let now = self.link.now();
        let client = self.link.client();
        let answer = |ticket| client.answer(ticket);
        if self.host.asked.and_then(answer).is_some() {
            self.host.asked = None;
        }
        let is_off = client.parameter(FS_HOST) == Some(0.0);
        let is_busy = self.host.asked.is_some() || self.storing.is_some() || now < self.host.due;
        if is_off && !is_busy && !self.host.chosen {
            self.host.on = true;
            self.host.due = now + RETRY;
            self.host.asked = Some(self.link.request(set(FS_HOST, 1.0)));
        }
    }

    /// What ends a polarity check that is under way: it lets the rudder answer a tilt, disarmed.
    pub(super) fn end_of_polarity_check(&mut self) -> Option<Request> {
        let is_watched = |name: &&str| self.link.client().parameter(name) == Some(WATCHED);
        let mut polarities = [POLARITY, SECOND_POLARITY].into_iter();
        let watched = polarities.find(is_watched)?;
        Some(set(watched, UNCHECKED))
    }

    /// Disarms, and goes on until who listens has put back what it has changed; not for long.
    pub(super) fn await_listeners(&mut self, asks: &Receiver<Ask>) -> Result<()> {
        let is_flown = !self.listeners.is_empty() && self.is_in_operation();
        if is_flown {
            self.link.request(Request::Order(DISARM));
        }
        let end = self.link.now() + LAST;
        while !self.listeners.is_empty() && self.link.now() < end {
            self.turn(asks)?;
        }
        if is_flown && !self.is_in_operation() {
            say(DISARMED);
        }
        Ok(())
    }

    /// The last act at a port that is still there: disarms what is or may be armed, and ends the
    /// watch over this program. Where the order to disarm is not answered, the watch stays.
    pub(super) fn rest(&mut self) {
        let client = self.link.client();
        if client.heard().is_none() {
            return;
        }
        if client.state().is_none_or(is_in_operation) || !self.waiting.is_empty() {
            match self.last(Request::Order(DISARM)) {
                Some(Ok(())) => say(DISARMED),
                Some(Err(failure)) => {
                    say(&fault_that_stays(&failure).unwrap_or_else(|| failure.to_string()));
                }
                None => return say(CUT_POWER),
            }
        }
        if let Some(end) = self.end_of_polarity_check() {
            self.last(end);
        }
        if self.host.is_on() {
            self.last(set(FS_HOST, 0.0));
        }
    }

    /// The answer to a last request; nothing if there is none in time.
    fn last(&mut self, request: Request) -> Option<Result<(), Failure>> {
        let ticket = self.link.request(request);
        let end = self.link.now() + LAST;
        while self.link.now() < end {
            let received = self.link.receive();
            self.without_log(received).ok()?;
            if let Some(answer) = self.link.client().answer(ticket) {
                return Some(answer);
            }
        }
        None
    }
}

impl Drop for Session<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.rest();
        }
    }
}

/// What to say where only a fault that is still there keeps the vehicle from standby: the order to
/// disarm was obeyed as far as it matters.
pub fn fault_that_stays(failure: &Failure) -> Option<String> {
    let fault = failure.persisting_fault()?;
    Some(format!("the rudder is at neutral; the fault stays: {fault}"))
}

/// Tells the person at the terminal, who may be gone.
pub(super) fn say(words: &str) {
    let _ = writeln!(std::io::stderr(), "{words}");
}
