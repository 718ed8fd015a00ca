//! Control transfers (USB 2.0, 8.5.3): SETUP, data, status.

use super::request::Request;
use super::transaction::Pipe;
use super::{FRAME, Host, HostError, RETRY};
use crate::board::Ticks;
use crate::memory::Memory;
use crate::peripherals::usb::{Refused, Usb};

/// Limit on any request (USB 2.0, 9.2.6.1).
const TIME_LIMIT: Ticks = Ticks::from_ms(5000);
/// Tokens without an answer that end a transfer.
const SILENCES: u8 = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Setup,
    DataIn,
    DataOut,
    StatusIn,
    StatusOut,
}

/// A control transfer going on.
#[derive(Clone, Debug)]
pub(super) struct Transfer {
    request: Request,
    setup: [u8; 8],
    data: Vec<u8>,
    sent: usize,
    stage: Stage,
    toggle: bool,
    silences: u8,
    deadline: Ticks,
}

impl Transfer {
    pub(super) fn new(now: Ticks, request: Request, setup: [u8; 8], data: Vec<u8>) -> Self {
        Self {
            request,
            setup,
            data,
            sent: 0,
            stage: Stage::Setup,
            toggle: true,
            silences: 0,
            deadline: now + TIME_LIMIT,
        }
    }

    pub(super) fn is_setup(&self) -> bool {
        self.stage == Stage::Setup
    }

    /// Whether the next token is IN.
    pub(super) fn is_in(&self) -> bool {
        matches!(self.stage, Stage::DataIn | Stage::StatusIn)
    }

    fn length(&self) -> usize {
        usize::from(u16::from_le_bytes([self.setup[6], self.setup[7]]))
    }

    fn after_setup(&self) -> Stage {
        match (self.setup[0] & 0x80 != 0, self.length()) {
            (_, 0) => Stage::StatusIn,
            (true, _) => Stage::DataIn,
            (false, _) => Stage::DataOut,
        }
    }

    /// The device has acknowledged SETUP, data up to `end`, or the status stage.
    fn acknowledged(&mut self, end: usize) -> Outcome {
        match self.stage {
            Stage::Setup => self.stage = self.after_setup(),
            Stage::DataOut => {
                self.toggle = !self.toggle;
                self.sent = end;
                if end == self.data.len() {
                    self.stage = Stage::StatusIn;
                }
            }
            Stage::DataIn | Stage::StatusIn | Stage::StatusOut => return Outcome::Done,
        }
        Outcome::Progress
    }

    /// A packet of an IN data stage, of `size` bytes at most, or of an IN status stage.
    fn take(&mut self, bytes: &[u8], toggle: bool, size: usize) -> Outcome {
        let is_status = self.stage == Stage::StatusIn;
        if toggle != (is_status || self.toggle) {
            return Outcome::Failed(HostError::WrongToggle);
        }
        let limit = if is_status { 0 } else { size };
        self.toggle = !toggle;
        self.data.extend_from_slice(bytes);
        if bytes.len() > limit || (!is_status && self.data.len() > self.length()) {
            return Outcome::Failed(HostError::TooLong);
        }
        if is_status {
            return Outcome::Done;
        }
        if bytes.len() < size || self.data.len() == self.length() {
            self.stage = Stage::StatusOut;
        }
        Outcome::Progress
    }
}

/// What one transaction did to the transfer.
enum Outcome {
    Progress,
    Done,
    Later,
    Silent,
    Failed(HostError),
}

impl Host {
    /// Gives up the request on endpoint 0 behind its SETUP, and makes it anew: the next SETUP comes
    /// where the device expects data or status (USB 2.0, 5.5.5). `false` if there is none.
    pub fn abort_request(&mut self) -> bool {
        let is_begun = |transfer: &mut Transfer| !transfer.is_setup();
        let Some(transfer) = self.session.transfer.take_if(is_begun) else {
            return false;
        };
        self.quiet_until = Ticks::ZERO;
        if transfer.request != Request::Remote {
            self.session.requests.push_front(transfer.request);
        }
        true
    }

    /// The transaction on endpoint 0 ends.
    pub(super) fn advance_control(&mut self, now: Ticks, usb: &mut Usb, memory: &mut Memory) {
        let Some(mut transfer) = self.session.transfer.take() else {
            return;
        };
        let outcome = self.transact(&mut transfer, usb, memory);
        let is_cut_short = transfer.request == Request::DeviceFirst
            && transfer.stage == Stage::StatusOut
            && self.system.cuts_status_short();
        match outcome {
            Outcome::Done => return self.finish(now, transfer.request, transfer.data),
            Outcome::Progress if is_cut_short => {
                return self.finish(now, transfer.request, transfer.data);
            }
            Outcome::Progress => transfer.silences = 0,
            Outcome::Later => {
                self.session.transfer = Some(transfer);
                return self.delay_control(now);
            }
            Outcome::Silent => {
                transfer.silences += 1;
                if transfer.silences == SILENCES {
                    return self.unanswered(now, transfer.request);
                }
                self.pipe(Pipe::Control).ready = now + FRAME;
            }
            Outcome::Failed(error) => return self.refused(now, transfer.request, error),
        }
        self.session.transfer = Some(transfer);
    }

    /// Endpoint 0 answered NAK: it is tried again later, up to the deadline.
    pub(super) fn delay_control(&mut self, now: Ticks) {
        self.pipe(Pipe::Control).ready = now + RETRY;
        if let Some(transfer) = self.session.transfer.take_if(|transfer| now >= transfer.deadline) {
            self.unanswered(now, transfer.request);
        }
    }

    fn unanswered(&mut self, now: Ticks, request: Request) {
        let error = HostError::NoAnswer(request.name());
        match request {
            Request::Remote => self.refused(now, request, error),
            _ => self.fail(now, error),
        }
    }

    fn transact(&self, transfer: &mut Transfer, usb: &mut Usb, memory: &mut Memory) -> Outcome {
        let address = self.session.address;
        let size = usize::from(self.enumeration.control_packet);
        let end = (transfer.sent + size).min(transfer.data.len());
        let answer = match transfer.stage {
            Stage::Setup => usb.setup(address, 0, transfer.setup, memory),
            Stage::DataOut => {
                let chunk = &transfer.data[transfer.sent..end];
                usb.output(address, 0, transfer.toggle, chunk, memory)
            }
            Stage::StatusOut => usb.output(address, 0, true, &[], memory),
            Stage::DataIn | Stage::StatusIn => match usb.input(address, 0, true, memory) {
                Ok((bytes, toggle)) => return transfer.take(&bytes, toggle, size),
                Err(refused) => Err(refused),
            },
        };
        match answer {
            Ok(()) => transfer.acknowledged(end),
            Err(Refused::Nak) => Outcome::Later,
            Err(Refused::Stall) => Outcome::Failed(HostError::Refused(transfer.request.name())),
            Err(Refused::Silence) => Outcome::Silent,
        }
    }
}
