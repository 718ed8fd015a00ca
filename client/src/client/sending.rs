//! What is sent for a request, and when.

use core::time::Duration;

use super::{ANSWER, Client, Copy, Failure, Pending, Request};
use crate::request::{self, Order};

/// Parameters that are asked for at once by their index: the answers fit into the vehicle's queue.
pub(super) const BATCH: usize = 16;

impl Client {
    /// Sends a request, unless another answer could be taken for its own: its time begins later
    /// then.
    pub(super) fn send_or_hold(&mut self, now: Duration, index: usize) {
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
        let Pending { ticket, request, .. } = self.pending[index].clone();
        match &request {
            Request::Order(order) => {
                if order.command != request::BRINGUP {
                    self.copies.push(Copy { command: order.command, ticket, sent: now });
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
    pub(super) fn overtake(&mut self, disarm: Order) {
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
}
