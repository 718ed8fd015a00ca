//! Requests and their answers over a link that loses, delays and repeats.
//!
//! Every request has an answer: the vehicle's, or [`Failure::Silence`] when nothing has come for
//! [`ANSWER`]. Until then it is repeated; an order to disarm every 100 ms, anything else every
//! second. What comes in parts (the list of parameters, the recorder's content) has made
//! progress with every part, and only what is missing is asked for again.
//!
//! COMMAND_ACK names the command and who sent it, not what was ordered by it, and arming and
//! disarming are one command. The vehicle takes commands in order, so acknowledgements of one
//! command belong to its copies in the order in which these were sent, each to one copy. An
//! acknowledgement of a copy whose request has been answered says nothing new.
//!
//! Where an acknowledgement was lost, a later one is taken for it, never the other way round; the
//! request that still waits is then repeated. So that none answers another order of the same
//! command, an order is not sent before an earlier, different one of its command has been answered;
//! only an order to disarm waits for nothing. An order to the board itself is answered by a value
//! with its number; of its acknowledgements only a refusal counts.

mod failure;
mod receiving;
mod sending;

use core::time::Duration;
use std::collections::{BTreeMap, VecDeque};

use mavlink::Message as _;
use mavlink::dialects::common::{MavAutopilot, MavCmd, MavMessage};
use tvc_nano::failsafe::{StateCode, StateKind};

use crate::request::{self, Order};
use crate::state::{state_name, state_of};
use crate::wire::{Frame, LinkCounts, Wire};

pub use failure::Failure;

/// Silence after which a request has failed.
pub const ANSWER: Duration = Duration::from_secs(5);
/// Silence after which a request is repeated.
const REPEAT: Duration = Duration::from_secs(1);
/// Time between two copies of an order to disarm.
const INSIST: Duration = Duration::from_millis(100);
/// Time between two heartbeats of the ground station. A vehicle that watches over its host takes
/// three seconds without one for its end, by its own clock: that of a rig runs up to 20 times as
/// fast.
const HEARTBEAT: Duration = Duration::from_millis(100);
/// A parameter as the vehicle has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f32,
}

impl Parameter {
    /// The parameter of this name, with a value.
    pub fn new(name: impl Into<String>, value: f32) -> Self {
        Self { name: name.into(), value }
    }
}

/// What the vehicle is asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// To obey a command.
    Order(Order),
    /// To change a parameter.
    Set(Parameter),
    /// To tell a parameter by its name.
    Read(String),
    /// To tell all parameters: [`Client::parameters`].
    List,
    /// To send what its recorder holds: [`Client::recording`].
    Download,
}

impl Request {
    /// What a person calls it.
    fn name(&self) -> &str {
        match self {
            Self::Order(order) => order.name,
            Self::Set(Parameter { name, .. }) | Self::Read(name) => name,
            Self::List => "the list of parameters",
            Self::Download => "the recording",
        }
    }

    /// Time between two copies.
    fn interval(&self) -> Duration {
        if *self == Self::Order(request::DISARM) { INSIST } else { REPEAT }
    }
}

/// Names a request until it is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// What comes of a request; lists, values and recordings are in the [`Client`].
pub type Answer = Result<(), Failure>;

/// A request without its answer.
#[derive(Clone, Debug)]
struct Pending {
    ticket: Ticket,
    request: Request,
    /// When it has failed.
    until: Duration,
    /// When it is repeated, if it is.
    again: Option<Duration>,
}

/// A copy of a command that has not been acknowledged.
#[derive(Clone, Copy, Debug)]
struct Copy {
    command: MavCmd,
    ticket: Ticket,
    sent: Duration,
}

/// The ground station's end of the link.
///
/// Times are since any fixed start, and never fall.
#[derive(Clone, Debug, Default)]
pub struct Client {
    wire: Wire,
    outgoing: VecDeque<Vec<u8>>,
    /// When the next heartbeat is due.
    heartbeat: Duration,
    silent: bool,
    heard: Option<Duration>,
    autopilot: Option<MavAutopilot>,
    /// The vehicle's system id, 0 before it has been heard.
    vehicle: u8,
    /// `custom_mode` of the last heartbeat.
    code: Option<u32>,
    /// The vehicle's words about its state.
    reason: String,
    /// The next text explains the newest state.
    explains: bool,
    /// The vehicle's words, if they were its last message.
    words: Option<String>,
    next: u64,
    pending: Vec<Pending>,
    copies: Vec<Copy>,
    answers: BTreeMap<Ticket, Answer>,
    parameters: BTreeMap<u16, Parameter>,
    parameter_count: Option<u16>,
    recording: Vec<u8>,
    recording_size: Option<usize>,
    board_values: BTreeMap<u32, BoardValue>,
}

/// What the board itself has answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardValue {
    /// The vehicle's clock, ms.
    pub time_ms: u32,
    /// The value.
    pub value: u32,
}

impl Client {
    /// A client that sends no heartbeats: another ground station does.
    pub fn without_heartbeat() -> Self {
        Self { silent: true, ..Self::default() }
    }

    /// Takes in received bytes; the frames that are complete now.
    pub fn receive(&mut self, now: Duration, bytes: &[u8]) -> Vec<Frame> {
        let frames = self.wire.receive_frames(bytes);
        for frame in &frames {
            self.take(now, frame);
        }
        frames
    }

    /// Does what is due: the heartbeat, repeats, and the end of patience. Call it every 20 ms or
    /// so.
    pub fn poll(&mut self, now: Duration) {
        if !self.silent && now >= self.heartbeat {
            self.heartbeat = now + HEARTBEAT;
            self.send(&request::heartbeat());
        }
        self.copies.retain(|copy| now.saturating_sub(copy.sent) < ANSWER);
        let missing = self.missing();
        let over = |pending: &Pending| {
            let failure = match (&pending.request, &missing) {
                (Request::List, Some(missing)) => missing.clone(),
                (request, _) => Failure::Silence(request.name().to_owned()),
            };
            (now >= pending.until).then_some(Err(failure))
        };
        self.answer_all(over);
        for index in 0..self.pending.len() {
            if self.pending[index].again.is_some_and(|again| now >= again) {
                self.send_or_hold(now, index);
            }
        }
    }

    /// The next frame to send. Take them until there is none after every request, [`Client::send`]
    /// and [`Client::poll`].
    pub fn outgoing(&mut self) -> Option<Vec<u8>> {
        self.outgoing.pop_front()
    }

    /// Sends a message that asks for no answer, to the vehicle that has been heard.
    pub fn send(&mut self, message: &MavMessage) {
        let mut message = message.clone();
        if let Some(target) = message.target_system_id_mut() {
            *target = self.vehicle;
        }
        let frame = self.wire.frame(&message);
        self.outgoing.push_back(frame);
    }

    /// Asks the vehicle; [`Client::answer`] has the answer later.
    ///
    /// An order to disarm ends other orders of its command that wait, and the repeats of all
    /// others: nothing that was ordered before is sent after it.
    pub fn request(&mut self, now: Duration, request: Request) -> Ticket {
        match &request {
            Request::Order(order) if *order == request::DISARM => self.overtake(*order),
            Request::List => {
                self.parameters.clear();
                self.parameter_count = None;
            }
            Request::Download => {
                self.recording.clear();
                self.recording_size = None;
            }
            _ => {}
        }
        let ticket = Ticket(self.next);
        self.next += 1;
        self.pending.push(Pending { ticket, request, until: now + ANSWER, again: Some(now) });
        self.send_or_hold(now, self.pending.len() - 1);
        ticket
    }

    /// Sends no further copy of a request; its answer may still come.
    pub fn repeat_no_more(&mut self, ticket: Ticket) {
        for pending in &mut self.pending {
            if pending.ticket == ticket {
                pending.again = None;
            }
        }
    }

    /// The answer to a request, once.
    pub fn answer(&mut self, ticket: Ticket) -> Option<Answer> {
        self.answers.remove(&ticket)
    }

    /// Ends every request: nothing will come any more.
    pub fn close(&mut self) {
        self.answer_all(|pending| Some(Err(Failure::Gone(pending.request.name().to_owned()))));
    }

    /// The state of the flight by the last heartbeat; `None` before it, or for an unknown one.
    pub fn state(&self) -> Option<StateKind> {
        self.code.and_then(state_of)
    }

    /// The state by the last heartbeat, and the kind of reason for it; `None` as for
    /// [`Self::state`].
    pub fn state_code(&self) -> Option<StateCode> {
        self.code.and_then(|code| StateCode::try_from(code).ok())
    }

    /// The state in words.
    pub fn state_name(&self) -> String {
        state_name(self.code.unwrap_or(u32::MAX))
    }

    /// The vehicle's words about its state; empty before it said any.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// System id of the vehicle, 0 before it has been heard.
    pub fn vehicle(&self) -> u8 {
        self.vehicle
    }

    /// The kind of autopilot by the last heartbeat; `None` before it.
    pub fn autopilot(&self) -> Option<MavAutopilot> {
        self.autopilot
    }

    /// When the vehicle's last heartbeat came.
    pub fn heard(&self) -> Option<Duration> {
        self.heard
    }

    /// What has been counted on the link.
    pub fn counts(&self) -> LinkCounts {
        self.wire.counts()
    }

    /// Starts counting anew.
    pub fn reset_counts(&mut self) {
        self.wire.reset_counts();
    }

    /// The parameters told since the last [`Request::List`], in the vehicle's order.
    pub fn parameters(&self) -> impl Iterator<Item = &Parameter> {
        self.parameters.values()
    }

    /// What has not come of the list that the vehicle has begun to tell.
    fn missing(&self) -> Option<Failure> {
        let count = self.parameter_count?;
        let mut missing = (0..count).filter(|index| !self.parameters.contains_key(index));
        let first = u32::from(missing.next()?) + 1;
        Some(Failure::Incomplete { count, missing: 1 + missing.count(), first })
    }

    /// Whether these are all.
    pub fn has_all_parameters(&self) -> bool {
        self.parameter_count.map(usize::from) == Some(self.parameters.len())
    }

    /// A parameter's value as last told.
    pub fn parameter(&self, name: &str) -> Option<f32> {
        let mut rows = self.parameters.values();
        rows.find(|row| row.name == name).map(|row| row.value)
    }

    /// What has come of the recorder's content since the last [`Request::Download`].
    pub fn recording(&self) -> &[u8] {
        &self.recording
    }

    /// The answer to the last [order to the board](request::bringup) with this number, once.
    pub fn board_value(&mut self, number: u32) -> Option<BoardValue> {
        self.board_values.remove(&number)
    }

    /// Ends the first request for which `by` has an answer: the vehicle answers in order.
    fn answer_first(&mut self, by: impl Fn(&Request) -> Option<Answer>) {
        let mut found = false;
        self.answer_all(|pending| {
            let answer = by(&pending.request).filter(|_| !found);
            found |= answer.is_some();
            answer
        });
    }

    /// Ends every request for which `by` has an answer.
    fn answer_all(&mut self, mut by: impl FnMut(&Pending) -> Option<Answer>) {
        let answers = &mut self.answers;
        self.pending.retain(|pending| match by(pending) {
            Some(answer) => {
                answers.insert(pending.ticket, answer);
                false
            }
            None => true,
        });
    }
}

#[cfg(test)]
mod tests;
