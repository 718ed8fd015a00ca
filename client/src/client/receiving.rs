//! What the vehicle says, and which requests it answers by that.

use core::mem;
use core::time::Duration;

use mavlink::dialects::common::{
    COMMAND_ACK_DATA, LOG_DATA_DATA, MavAutopilot, MavMessage, MavResult, PARAM_VALUE_DATA,
};
use tvc_nano::failsafe::RefusalKind;
use tvc_nano::params::ParamError;

use super::failure::REFUSED;
use super::{ANSWER, BoardValue, Client, Failure, Parameter, Request};
use crate::request::{self, Order};
use crate::text;
use crate::wire::Frame;

/// No recorder of a vehicle holds more, bytes.
const LONGEST_RECORDING: usize = 1 << 20;

impl Client {
    /// Takes in a frame of the vehicle: its state, and what it answers.
    pub(super) fn take(&mut self, now: Duration, frame: &Frame) {
        let message = &frame.message;
        let words = mem::take(&mut self.words);
        match message {
            MavMessage::HEARTBEAT(beat)
                if beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID =>
            {
                self.heard = Some(now);
                self.autopilot = Some(beat.autopilot);
                self.vehicle = frame.system();
                self.explains = self.code.replace(beat.custom_mode) != Some(beat.custom_mode);
            }
            MavMessage::STATUSTEXT(said) => {
                let words = text(&said.text);
                if mem::take(&mut self.explains) {
                    words.clone_into(&mut self.reason);
                }
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
                self.take_ack(ack, kind.and_then(Result::ok), words);
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
                let size = entry.size as usize;
                if size > LONGEST_RECORDING {
                    self.answer_first(|request| {
                        let why = Failure::Recording(size);
                        (*request == Request::Download).then_some(Err(why))
                    });
                } else if self.recording_size.is_none() {
                    self.recording_size = Some(size);
                    self.continue_download(now, Some(now));
                }
            }
            MavMessage::LOG_DATA(part) => self.take_recording(now, part),
            _ => {}
        }
    }

    /// A refusal's reason stands directly before it, where the vehicle has not told it before. An
    /// order to the board is answered by its value or by a refusal.
    fn take_ack(
        &mut self,
        ack: &COMMAND_ACK_DATA,
        refusal: Option<RefusalKind>,
        words: Option<String>,
    ) {
        let (told, untold) = match refusal {
            None => (words, String::new()),
            Some(kind) => (words.filter(|words| words.contains(REFUSED)), self.reason_of(kind)),
        };
        let answer = |order: &Order| match ack.result {
            // What takes its time is obeyed when it has begun.
            MavResult::MAV_RESULT_ACCEPTED | MavResult::MAV_RESULT_IN_PROGRESS => Ok(()),
            result => Err(Failure::Refused {
                order: order.name.to_owned(),
                result,
                refusal,
                reason: match &told {
                    Some(words) => words.clone(),
                    None if untold.is_empty() => String::new(),
                    None => format!("{}{REFUSED}{untold}", order.name),
                },
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

    /// Why the vehicle refuses an order, by the kind of refusal and by what it says of its state.
    /// It tells a reason only once to a host that asks again and again.
    fn reason_of(&self, kind: RefusalKind) -> String {
        match (kind, self.reason()) {
            (RefusalKind::WrongState, "") => format!("in {}", self.state_name()),
            (RefusalKind::WrongState, state) => state.to_owned(),
            (RefusalKind::FaultPersists, state) => match state.split_once(": ") {
                Some((_, fault)) => fault.to_owned(),
                None => kind.to_string(),
            },
            _ => kind.to_string(),
        }
    }

    fn take_parameter(&mut self, now: Duration, row: &PARAM_VALUE_DATA, reason: Option<String>) {
        let told = Parameter::new(text(&row.param_id), row.param_value);
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
        let is_new = self.parameters.insert(row.param_index, told).is_none();
        self.parameter_count = Some(row.param_count);
        let complete = self.has_all_parameters();
        if is_new || complete {
            self.make_progress(&Request::List, now, None, complete);
        }
    }

    fn take_recording(&mut self, now: Duration, part: &LOG_DATA_DATA) {
        if part.ofs as usize == self.recording.len() && part.count > 0 {
            let bytes = part.data.iter().take(part.count.into());
            self.recording.extend(bytes);
            self.continue_download(now, None);
        }
    }

    /// The download has made progress: it has come to its end, or goes on, at `again` by another
    /// request.
    fn continue_download(&mut self, now: Duration, again: Option<Duration>) {
        let complete = self.recording_size.is_some_and(|size| self.recording.len() >= size);
        self.make_progress(&Request::Download, now, again, complete);
    }

    /// What comes in parts is complete, or its time begins anew.
    fn make_progress(
        &mut self,
        request: &Request,
        now: Duration,
        again: Option<Duration>,
        complete: bool,
    ) {
        for pending in self.pending.iter_mut().filter(|pending| pending.request == *request) {
            pending.until = now + ANSWER;
            pending.again = again.or(Some(now + request.interval()));
        }
        self.answer_all(|pending| (complete && pending.request == *request).then_some(Ok(())));
    }
}
