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
//! acknowledgement of a copy whose request has been answered says nothing new. Where an
//! acknowledgement was lost, a later one is taken for it, never the other way round; the request
//! that still waits is then repeated. So that none answers another order of the same command, an
//! order is not sent before an earlier, different one of its command has been answered; only an
//! order to disarm waits for nothing. An order to the board itself is answered by a value with its
//! number; of its acknowledgements only a refusal counts.

use core::mem;
use core::time::Duration;
use std::collections::{BTreeMap, VecDeque};

use mavlink::Message as _;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, LOG_DATA_DATA, MavAutopilot, MavCmd, MavMessage, MavResult, PARAM_VALUE_DATA,
};
use thiserror::Error;
use tvc_nano::failsafe::{RefusalKind, StateCode, StateKind};
use tvc_nano::params::ParamError;

use crate::request::{self, Order};
use crate::state::StateTracker;
use crate::text;
use crate::wire::{Frame, LinkCounts, Wire};

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
/// Parameters that are asked for at once by their index: the answers fit into the vehicle's queue.
const BATCH: usize = 16;

/// A parameter as the vehicle has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f32,
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
        if *self == Self::Order(request::DISARM) {
            INSIST
        } else {
            REPEAT
        }
    }
}

/// Names a request until it is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// Why a request was not fulfilled.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Failure {
    /// The vehicle does not obey.
    #[error("{}", refused(order, *result, reason))]
    Refused {
        /// What was ordered.
        order: String,
        /// Its answer.
        result: MavResult,
        /// Why, where it is one of the firmware's refusals.
        refusal: Option<RefusalKind>,
        /// Its words, if it said any.
        reason: String,
    },
    /// The vehicle has no parameter of this name.
    #[error("the vehicle has no parameter {0}")]
    UnknownParameter(String),
    /// The vehicle keeps another value.
    #[error("{} stays at {}: {reason}", kept.name, kept.value)]
    Kept {
        /// The parameter as it is.
        kept: Parameter,
        /// The vehicle's words.
        reason: String,
    },
    /// Nothing came.
    #[error("no answer about {0} from the vehicle within {s} s", s = ANSWER.as_secs())]
    Silence(String),
    /// An order to disarm was given meanwhile.
    #[error("{0}: overtaken by an order to disarm")]
    Overtaken(String),
    /// The port went away before the answer came.
    #[error("{0}: the port went away")]
    Gone(String),
}

impl Failure {
    /// The firmware's refusal, if it is one.
    pub fn refusal(&self) -> Option<RefusalKind> {
        match self {
            Self::Refused { refusal, .. } => *refusal,
            _ => None,
        }
    }

    /// The fault that keeps the vehicle from standby, where an order to disarm was refused for that
    /// alone: its rudder is at neutral all the same.
    pub fn persisting_fault(&self) -> Option<&str> {
        match self {
            Self::Refused {
                refusal: Some(RefusalKind::FaultPersists),
                reason,
                ..
            } => Some(reason.strip_prefix("disarm refused: ").unwrap_or(reason)),
            _ => None,
        }
    }
}

fn refused(order: &str, result: MavResult, reason: &str) -> String {
    match result {
        MavResult::MAV_RESULT_UNSUPPORTED => {
            format!("this firmware does not know the command to {order}")
        }
        _ if reason.is_empty() => format!("{order} refused ({result:?})"),
        _ => reason.to_owned(),
    }
}

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

impl Pending {
    fn progress(&mut self, now: Duration) {
        self.until = now + ANSWER;
        self.again = Some(now + self.request.interval());
    }
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
    /// The vehicle's system id, 0 before it has been heard.
    vehicle: u8,
    state: StateTracker,
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
        Self {
            silent: true,
            ..Self::default()
        }
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
        self.copies
            .retain(|copy| now.saturating_sub(copy.sent) < ANSWER);
        let over = |pending: &Pending| {
            (now >= pending.until).then(|| Err(Failure::Silence(pending.request.name().to_owned())))
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
        self.pending.push(Pending {
            ticket,
            request,
            until: now + ANSWER,
            again: Some(now),
        });
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
        self.state.state()
    }

    /// The state by the last heartbeat, and the kind of reason for it; `None` as for
    /// [`Self::state`].
    pub fn state_code(&self) -> Option<StateCode> {
        self.state.code()
    }

    /// The state in words.
    pub fn state_name(&self) -> String {
        self.state.name()
    }

    /// The vehicle's words about its state; empty before it said any.
    pub fn reason(&self) -> &str {
        self.state.reason()
    }

    /// System id of the vehicle, 0 before it has been heard.
    pub fn vehicle(&self) -> u8 {
        self.vehicle
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

    /// Sends a request, unless another answer could be taken for its own: its time begins later
    /// then.
    fn send_or_hold(&mut self, now: Duration, index: usize) {
        if self.is_held(index) {
            self.pending[index].until = now + ANSWER;
        } else {
            self.send_request(now, index);
        }
    }

    /// An earlier, different order of the same command waits for its acknowledgement.
    fn is_held(&self, index: usize) -> bool {
        let (earlier, rest) = self.pending.split_at(index);
        let Some(Request::Order(order)) = rest.first().map(|pending| &pending.request) else {
            return false;
        };
        // What the board itself is asked is answered by its number.
        let waits = *order != request::DISARM && order.command != request::BRINGUP;
        waits
            && earlier.iter().any(|pending| match &pending.request {
                Request::Order(other) => other.command == order.command && other != order,
                _ => false,
            })
    }

    /// Sends a request for the first time or again: as a whole, or for what is missing.
    fn send_request(&mut self, now: Duration, index: usize) {
        let Pending {
            ticket, request, ..
        } = self.pending[index].clone();
        match &request {
            Request::Order(order) => {
                if order.command != request::BRINGUP {
                    self.copies.push(Copy {
                        command: order.command,
                        ticket,
                        sent: now,
                    });
                }
                self.send(&order.message());
            }
            Request::Set(row) => self.send(&request::set_parameter(&row.name, row.value)),
            Request::Read(name) => self.send(&request::read_parameter(name)),
            Request::List => match self.parameter_count {
                None => self.send(&request::list_parameters()),
                Some(count) => {
                    let missing = (0..count).filter(|index| !self.parameters.contains_key(index));
                    for index in missing.take(BATCH).collect::<Vec<_>>() {
                        self.send(&request::read_parameter_at(index));
                    }
                }
            },
            Request::Download => match self.recording_size {
                None => self.send(&request::list_logs()),
                Some(size) => {
                    let from = self.recording.len();
                    self.send(&request::log_data(from as u32, (size - from) as u32));
                }
            },
        }
        self.pending[index].again = Some(now + request.interval());
    }

    /// Ends what an order to disarm overtakes.
    fn overtake(&mut self, disarm: Order) {
        self.answer_all(|pending| match &pending.request {
            Request::Order(order) if order.command == disarm.command && *order != disarm => {
                Some(Err(Failure::Overtaken(order.name.to_owned())))
            }
            _ => None,
        });
        for pending in &mut self.pending {
            if matches!(&pending.request, Request::Order(order) if *order != disarm) {
                pending.again = None;
            }
        }
    }

    fn take(&mut self, now: Duration, frame: &Frame) {
        let message = &frame.message;
        self.state.take(message);
        let words = mem::take(&mut self.words);
        match message {
            MavMessage::HEARTBEAT(beat)
                if beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID =>
            {
                self.heard = Some(now);
                self.vehicle = frame.system();
            }
            MavMessage::STATUSTEXT(said) => {
                let words = text(&said.text);
                if words == ParamError::Unknown.to_string() {
                    self.answer_first(|request| match request {
                        Request::Set(Parameter { name, .. }) | Request::Read(name) => {
                            Some(Err(Failure::UnknownParameter(name.clone())))
                        }
                        _ => None,
                    });
                }
                self.words = Some(words.to_owned());
            }
            MavMessage::COMMAND_ACK(ack) => {
                // COMMAND_ACK's first extension: in a refusal, its kind.
                let kind = frame.payload().get(3).copied().map(RefusalKind::try_from);
                self.take_ack(ack, kind.and_then(Result::ok), words.unwrap_or_default());
            }
            MavMessage::PARAM_VALUE(row) => self.take_parameter(now, row, words),
            MavMessage::NAMED_VALUE_INT(told) => {
                if let Ok(number) = u32::from_str_radix(text(&told.name), 16) {
                    let (time_ms, value) = (told.time_boot_ms, told.value as u32);
                    let told = BoardValue { time_ms, value };
                    self.board_values.insert(number, told);
                    self.answer_all(|pending| match &pending.request {
                        Request::Order(order) => order.asks_board(number).then_some(Ok(())),
                        _ => None,
                    });
                }
            }
            MavMessage::LOG_ENTRY(entry) => {
                self.recording_size.get_or_insert(entry.size as usize);
                self.continue_download(now, Some(now));
            }
            MavMessage::LOG_DATA(part) => self.take_recording(now, part),
            _ => {}
        }
    }

    /// A refusal's reason stands directly before it. An order to the board is answered by its value
    /// or by a refusal.
    fn take_ack(&mut self, ack: &COMMAND_ACK_DATA, refusal: Option<RefusalKind>, reason: String) {
        let answer = |order: &Order| match ack.result {
            // What takes its time is obeyed when it has begun.
            MavResult::MAV_RESULT_ACCEPTED | MavResult::MAV_RESULT_IN_PROGRESS => Ok(()),
            result => Err(Failure::Refused {
                order: order.name.to_owned(),
                result,
                refusal,
                reason: reason.clone(),
            }),
        };
        if ack.command == request::BRINGUP {
            if ack.result != MavResult::MAV_RESULT_ACCEPTED {
                self.answer_first(|request| match request {
                    Request::Order(order) => {
                        (order.command == request::BRINGUP).then(|| answer(order))
                    }
                    _ => None,
                });
            }
            return;
        }
        let mut copies = self.copies.iter();
        let Some(index) = copies.position(|copy| copy.command == ack.command) else {
            return;
        };
        let ticket = self.copies.remove(index).ticket;
        self.answer_all(|pending| match &pending.request {
            Request::Order(order) if pending.ticket == ticket => Some(answer(order)),
            _ => None,
        });
    }

    fn take_parameter(&mut self, now: Duration, row: &PARAM_VALUE_DATA, reason: Option<String>) {
        let told = Parameter {
            name: text(&row.param_id).to_owned(),
            value: row.param_value,
        };
        self.answer_first(|request| match request {
            Request::Read(name) if *name == told.name => Some(Ok(())),
            Request::Set(wanted) if *wanted == told => Some(Ok(())),
            // The old value behind a reason is a refusal; without one it answers an earlier
            // request.
            Request::Set(wanted) if wanted.name == told.name => reason.clone().map(|reason| {
                let kept = told.clone();
                Err(Failure::Kept { kept, reason })
            }),
            _ => None,
        });
        self.parameters.insert(row.param_index, told);
        self.parameter_count = Some(row.param_count);
        let complete = self.has_all_parameters();
        for pending in &mut self.pending {
            if pending.request == Request::List {
                pending.progress(now);
            }
        }
        self.answer_all(|pending| (complete && pending.request == Request::List).then_some(Ok(())));
    }

    fn take_recording(&mut self, now: Duration, part: &LOG_DATA_DATA) {
        if part.ofs as usize == self.recording.len() {
            let bytes = part.data.iter().take(part.count.into());
            self.recording.extend(bytes);
            self.continue_download(now, None);
        }
    }

    /// The download has made progress: it has come to its end, or goes on, at `again` by another
    /// request.
    fn continue_download(&mut self, now: Duration, again: Option<Duration>) {
        let complete = self
            .recording_size
            .is_some_and(|size| self.recording.len() >= size);
        for pending in &mut self.pending {
            if pending.request == Request::Download {
                pending.progress(now);
                pending.again = again.or(pending.again);
            }
        }
        self.answer_all(|pending| {
            (complete && pending.request == Request::Download).then_some(Ok(()))
        });
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
