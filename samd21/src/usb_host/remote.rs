//! A driver elsewhere has the device: the kernel of another computer, over USB/IP. This host resets
//! the bus, gives the address, sends start-of-frame packets, and carries out what the driver
//! submits. The device must have been enumerated before, since its endpoints are known from that.

use super::transaction::{Pipe, PipeState};
use super::{Acknowledgement, Host, Phase};
use crate::board::Ticks;
use std::collections::VecDeque;
use thiserror::Error;

/// bRequest of SET_CONFIGURATION, SET_INTERFACE and CLEAR_FEATURE (USB 2.0, 9.4).
const SET_CONFIGURATION: u8 = 9;
const SET_INTERFACE: u8 = 11;
const CLEAR_FEATURE: u8 = 1;

/// A transfer that a driver submits: a USB request block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Urb {
    /// The driver's number for it.
    pub id: u32,
    /// The endpoint's number, 0 to 15.
    pub endpoint: u8,
    /// From the device.
    pub is_in: bool,
    /// The request, on endpoint 0.
    pub setup: [u8; 8],
    /// What goes to the device.
    pub data: Vec<u8>,
    /// How many bytes may come from the device.
    pub length: usize,
}

/// What became of a [`Urb`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The driver's number.
    pub id: u32,
    /// What came from the device, or how it failed.
    pub data: Result<Vec<u8>, UrbError>,
    /// How many bytes went to the device.
    pub sent: usize,
}

/// Why a transfer failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum UrbError {
    /// The device answered STALL.
    #[error("refused with STALL")]
    Stalled,
    /// The device did not answer, or not in five seconds.
    #[error("no answer")]
    Silent,
    /// More bytes came than were asked for, or with the wrong toggle.
    #[error("wrong data")]
    Wrong,
    /// The device has no such endpoint.
    #[error("no such endpoint")]
    NoEndpoint,
}

/// A transfer, and how far it has come.
#[derive(Clone, Debug, Default)]
pub(super) struct Submitted {
    urb: Urb,
    received: Vec<u8>,
    sent: usize,
}

impl Submitted {
    /// Bytes that are yet to go out.
    fn left(&self) -> usize {
        self.urb.data.len() - self.sent
    }
}

/// What the driver has submitted, by pipe, and the answers that it has not taken.
#[derive(Clone, Debug, Default)]
pub(super) struct Remote {
    /// By pipe. Of those of endpoint 0, the first one is on the bus.
    queues: [VecDeque<Submitted>; 4],
    answers: Vec<Answer>,
}

impl Remote {
    pub(super) fn queue(&mut self, pipe: Pipe) -> &mut VecDeque<Submitted> {
        &mut self.queues[pipe as usize]
    }

    /// Whether the driver has submitted a transfer of a pipe that has not ended.
    pub(super) fn waits(&self, pipe: Pipe) -> bool {
        !self.queues[pipe as usize].is_empty()
    }

    /// The request that is next, and what goes with it.
    pub(super) fn request(&self) -> ([u8; 8], Vec<u8>) {
        let first = self.queues[Pipe::Control as usize].front();
        first.map(|first| (first.urb.setup, first.urb.data.clone())).unwrap_or_default()
    }

    /// What is left of the transfer that goes out: no packet has bytes of two.
    pub(super) fn left(&self) -> Option<usize> {
        self.queues[Pipe::BulkOut as usize].front().map(Submitted::left)
    }

    /// The first transfer of a pipe has ended.
    pub(super) fn end(&mut self, pipe: Pipe, data: Result<Vec<u8>, UrbError>) {
        if let Some(Submitted { urb, sent, .. }) = self.queue(pipe).pop_front() {
            // The data of a request have gone out whole, or it has failed.
            let (data, sent) = match data {
                Ok(_) if pipe == Pipe::Control && !urb.is_in => (Ok(Vec::new()), urb.data.len()),
                data => (data, sent),
            };
            self.answers.push(Answer { id: urb.id, data, sent });
        }
    }

    /// A packet has come from the device: `size` bytes are a whole one.
    pub(super) fn take(&mut self, pipe: Pipe, bytes: &[u8], size: usize) {
        let Some(Submitted { urb, received, .. }) = self.queue(pipe).front_mut() else { return };
        received.extend_from_slice(bytes);
        if received.len() > urb.length {
            self.end(pipe, Err(UrbError::Wrong));
        } else if bytes.len() < size || received.len() == urb.length {
            let data = std::mem::take(received);
            self.end(pipe, Ok(data));
        }
    }

    /// The device has taken a packet.
    pub(super) fn sent(&mut self, bytes: usize) {
        let Some(output) = self.queue(Pipe::BulkOut).front_mut() else { return };
        output.sent += bytes;
        if output.left() == 0 {
            self.end(Pipe::BulkOut, Ok(Vec::new()));
        }
    }
}

impl Host {
    /// Hands the device over to a driver elsewhere, by a bus reset and a new address. `false` if
    /// none is configured.
    pub fn hand_over(&mut self) -> bool {
        if self.is_configured() && self.phase == Phase::Frames {
            self.remote = Some(Remote::default());
            self.reset_at_once();
        }
        self.remote.is_some()
    }

    /// Whether a driver elsewhere has the device: until [`take_back`](Self::take_back), or until
    /// the device leaves the bus.
    pub fn is_handed_over(&self) -> bool {
        self.remote.is_some()
    }

    /// Ends that; the device is enumerated anew.
    pub fn take_back(&mut self) {
        if self.remote.take().is_some() {
            self.attempts = 0;
            self.reset_at_once();
        }
    }

    pub(super) fn reset_at_once(&mut self) {
        self.to_send.clear();
        self.received.clear();
        self.quiet_until = Ticks::ZERO;
        self.session.transaction = None;
        self.acknowledgement = Acknowledgement::Comes;
        self.phase = Phase::Debounce;
        self.due = Ticks::ZERO;
    }

    /// The driver elsewhere submits a transfer. Without such a driver it is dropped.
    pub fn submit(&mut self, urb: Urb) {
        let pipe = self.pipe_of(&urb);
        let Some(remote) = &mut self.remote else { return };
        self.quiet_until = Ticks::ZERO;
        match pipe {
            Some(Pipe::BulkOut) if urb.data.is_empty() => {
                remote.answers.push(Answer { id: urb.id, data: Ok(Vec::new()), sent: 0 });
            }
            Some(pipe) => {
                if pipe == Pipe::BulkOut {
                    self.to_send.extend(&urb.data);
                }
                remote.queue(pipe).push_back(Submitted { urb, ..Submitted::default() });
            }
            None => {
                let data = Err(UrbError::NoEndpoint);
                remote.answers.push(Answer { id: urb.id, data, sent: 0 });
            }
        }
    }

    fn pipe_of(&self, urb: &Urb) -> Option<Pipe> {
        let port = self.session.port.unwrap_or_default();
        match (urb.endpoint, urb.is_in) {
            (0, _) => Some(Pipe::Control),
            (number, false) if number == port.bulk_out.number => Some(Pipe::BulkOut),
            (number, true) if number == port.bulk_in.number => Some(Pipe::BulkIn),
            (number, true) if port.interrupt.is_some_and(|with| with.number == number) => {
                Some(Pipe::Interrupt)
            }
            _ => None,
        }
    }

    /// The driver takes a transfer back. `false` if it has ended.
    pub fn unlink(&mut self, id: u32) -> bool {
        let Some(remote) = &mut self.remote else { return false };
        for pipe in [Pipe::Control, Pipe::BulkOut, Pipe::BulkIn, Pipe::Interrupt] {
            let queue = remote.queue(pipe);
            let Some(place) = queue.iter().position(|one| one.urb.id == id) else { continue };
            let ahead: usize = queue.iter().take(place).map(Submitted::left).sum();
            let left = queue.remove(place).map_or(0, |one| one.left());
            match pipe {
                // The next SETUP ends it for the device.
                Pipe::Control if place == 0 => self.session.transfer = None,
                Pipe::BulkOut => drop(self.to_send.drain(ahead..ahead + left)),
                _ => {}
            }
            // Its packet may be on the bus.
            self.session.transaction = None;
            self.quiet_until = Ticks::ZERO;
            return true;
        }
        false
    }

    /// What has become of transfers since the last call.
    pub fn answers(&mut self) -> Vec<Answer> {
        self.remote.as_mut().map_or_else(Vec::new, |remote| std::mem::take(&mut remote.answers))
    }

    /// The device descriptor, as the device sent it; empty before enumeration.
    pub fn device_descriptor(&self) -> &[u8] {
        &self.enumeration.device_descriptor
    }

    /// The configuration descriptor and all that belongs to it.
    pub fn configuration(&self) -> &[u8] {
        &self.enumeration.configuration
    }

    /// The driver's request has succeeded. Configurations, interfaces and halts that end begin
    /// their endpoints with DATA0 (USB 2.0, 9.1.1.5, 9.4.5).
    pub(super) fn finish_remote(&mut self, now: Ticks, data: Vec<u8>) {
        let Some(remote) = &mut self.remote else { return };
        let ([kind, request, value, _, endpoint, ..], _) = remote.request();
        remote.end(Pipe::Control, Ok(data));
        let begun = PipeState { toggle: false, ready: now };
        match (kind, request) {
            (0x00, SET_CONFIGURATION) | (0x01, SET_INTERFACE) => {
                self.session.configured |= request == SET_CONFIGURATION && value != 0;
                for pipe in [Pipe::BulkIn, Pipe::BulkOut, Pipe::Interrupt] {
                    *self.pipe(pipe) = begun;
                }
            }
            (0x02, CLEAR_FEATURE) => {
                let urb =
                    Urb { endpoint: endpoint & 0xF, is_in: endpoint & 0x80 != 0, ..Urb::default() };
                if let Some(pipe) = self.pipe_of(&urb) {
                    *self.pipe(pipe) = begun;
                }
            }
            _ => {}
        }
    }
}
