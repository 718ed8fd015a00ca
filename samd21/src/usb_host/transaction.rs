//! Transactions (USB 2.0, 8.5): which pipe has the bus next, and what comes of it.

use super::control::Transfer;
use super::remote::{Remote, UrbError};
use super::request::Request;
use super::{Acknowledgement, BYTE, Host, HostError, RETRY};
use crate::board::Ticks;
use crate::memory::Memory;
use crate::peripherals::usb::{Refused, Usb};

/// Tokens, headers, CRC, handshake and turn-around of a transaction, in bytes.
const OVERHEAD: u64 = 13;
/// A token and a NAK.
const NAK_TIME: Ticks = Ticks(8 * BYTE.0);

/// What goes to, or comes from, one endpoint (USB 2.0, 5.3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pipe {
    Control,
    BulkIn,
    BulkOut,
    Interrupt,
}

/// State of one pipe: toggle of its next packet, and when it is tried again. That of the control
/// pipe has its toggle in the transfer.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PipeState {
    pub(super) toggle: bool,
    pub(super) ready: Ticks,
}

/// A transaction on the wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Transaction {
    pipe: Pipe,
    /// What goes out on the bulk OUT pipe.
    bytes: Vec<u8>,
    /// The device answers with NAK.
    is_nak: bool,
}

impl Host {
    pub(super) fn pipe(&mut self, pipe: Pipe) -> &mut PipeState {
        &mut self.session.pipes[pipe as usize]
    }

    /// Puts the next transaction on the wire, if one is ready and fits into the frame.
    pub(super) fn begin_transaction(&mut self, now: Ticks, usb: &Usb) {
        self.due = self.next_frame;
        self.next_request(now);
        let mut candidates = [Pipe::Control, Pipe::Interrupt, Pipe::BulkOut, Pipe::BulkIn];
        if self.frame.is_multiple_of(2) {
            // Neither direction starves the other.
            candidates.swap(2, 3);
        }
        for pipe in candidates {
            if !self.is_wanted(pipe) {
                continue;
            }
            let ready = self.pipe(pipe).ready;
            if ready > now {
                self.due = self.due.min(ready);
                continue;
            }
            let (transaction, duration) = self.compose(pipe, usb);
            if now + duration <= self.next_frame {
                if transaction.is_nak && self.hears_only_naks(usb) {
                    self.quiet_until = self.next_frame;
                }
                self.session.transaction = Some(transaction);
                self.due = now + duration;
                return;
            }
            self.due = self.next_frame;
        }
    }

    /// Whether a pipe has something to do.
    fn is_wanted(&self, pipe: Pipe) -> bool {
        let session = &self.session;
        match pipe {
            Pipe::Control => session.transfer.is_some(),
            Pipe::BulkOut => session.configured && !self.to_send.is_empty(),
            Pipe::BulkIn | Pipe::Interrupt if !session.configured => false,
            Pipe::BulkIn => self.remote.as_ref().map_or(self.reading, |with| with.waits(pipe)),
            Pipe::Interrupt => self.remote.as_ref().map_or_else(
                || session.port.is_some_and(|port| port.interrupt.is_some()),
                |with| with.waits(pipe),
            ),
        }
    }

    /// Whether every pipe that has something to do is answered with NAK, which the device notices
    /// only where it looks.
    pub(super) fn hears_only_naks(&self, usb: &Usb) -> bool {
        let session = &self.session;
        let is_bulk_in_alone = session.transfer.is_none()
            && session.requests.is_empty()
            && !self.remote.as_ref().is_some_and(|with| with.waits(Pipe::Control))
            && self.to_send.is_empty();
        let pipes = [Pipe::Interrupt, Pipe::BulkIn];
        is_bulk_in_alone
            && pipes.into_iter().all(|pipe| {
                let (number, is_in, _) = self.target(pipe);
                !self.is_wanted(pipe)
                    || usb.would_nak(number, is_in) && !usb.interrupts_at_nak(number)
            })
    }

    /// A pipe's endpoint number, whether it is IN now, and its packet size in bytes.
    fn target(&self, pipe: Pipe) -> (u8, bool, u16) {
        let port = self.session.port.unwrap_or_default();
        let endpoint = match pipe {
            Pipe::Control => {
                let is_in = self.session.transfer.as_ref().is_some_and(Transfer::is_in);
                return (0, is_in, u16::from(self.enumeration.control_packet));
            }
            Pipe::BulkOut => port.bulk_out,
            Pipe::BulkIn => port.bulk_in,
            Pipe::Interrupt => port.interrupt.unwrap_or_default(),
        };
        (endpoint.number, pipe != Pipe::BulkOut, endpoint.packet_size)
    }

    /// The transaction that a pipe wants, and how long it takes.
    fn compose(&self, pipe: Pipe, usb: &Usb) -> (Transaction, Ticks) {
        let (number, is_in, size) = self.target(pipe);
        let transfer = self.session.transfer.as_ref();
        let is_setup = pipe == Pipe::Control && transfer.is_some_and(Transfer::is_setup);
        let mut transaction = Transaction {
            pipe,
            bytes: Vec::new(),
            is_nak: !is_setup && usb.would_nak(number, is_in),
        };
        let mut length = if is_setup { 8 } else { u64::from(size) };
        if pipe == Pipe::BulkOut {
            let left = self.remote.as_ref().and_then(Remote::left).unwrap_or(usize::MAX);
            let next = self.to_send.iter().take(left.min(size.into()));
            transaction.bytes = next.copied().collect();
            length = transaction.bytes.len() as u64;
        }
        let duration = if transaction.is_nak { NAK_TIME } else { BYTE * (OVERHEAD + length) };
        (transaction, duration)
    }

    /// The transaction on the wire has ended.
    pub(super) fn complete(
        &mut self,
        now: Ticks,
        transaction: Transaction,
        usb: &mut Usb,
        memory: &mut Memory,
    ) {
        let Transaction { pipe, bytes, .. } = transaction;
        let address = self.session.address;
        let (number, is_in, size) = self.target(pipe);
        if transaction.is_nak {
            usb.nak(number, is_in);
        }
        let is_lost = self.acknowledgement == Acknowledgement::IsLost;
        match pipe {
            Pipe::Control if transaction.is_nak => self.delay_control(now),
            Pipe::Control => self.advance_control(now, usb, memory),
            Pipe::Interrupt => {
                if !transaction.is_nak
                    && let Ok((bytes, toggle)) = usb.input(address, number, true, memory)
                {
                    self.pipe(pipe).toggle = !toggle;
                    if let Some(remote) = &mut self.remote {
                        remote.take(pipe, &bytes, size.into());
                    }
                }
                let port = self.session.port.unwrap_or_default();
                let interval_ms = port.interrupt.unwrap_or_default().interval_ms;
                self.pipe(pipe).ready = now + Ticks::from_ms(u64::from(interval_ms));
            }
            Pipe::BulkIn | Pipe::BulkOut if transaction.is_nak => {
                self.statistics.naks += 1;
                self.pipe(pipe).ready = now + RETRY;
            }
            Pipe::BulkIn => match usb.input(address, number, !is_lost, memory) {
                Ok((bytes, toggle)) => {
                    let was_lost = self.acknowledgement == Acknowledgement::WasLost;
                    self.acknowledgement = match is_lost {
                        true => Acknowledgement::WasLost,
                        false => Acknowledgement::Comes,
                    };
                    self.statistics.packets_in += 1;
                    if bytes.len() > usize::from(size) {
                        self.errors.push(HostError::TooLong);
                    } else if toggle == self.pipe(pipe).toggle {
                        self.pipe(pipe).toggle = !toggle;
                        if let Some(remote) = &mut self.remote {
                            remote.take(pipe, &bytes, size.into());
                        }
                        self.received.extend(bytes);
                    } else if !was_lost {
                        self.errors.push(HostError::WrongToggle);
                    }
                }
                Err(Refused::Nak | Refused::Silence) => self.pipe(pipe).ready = now + RETRY,
                Err(Refused::Stall) => self.clear_halt(pipe, 0x80 | number),
            },
            Pipe::BulkOut => {
                let toggle = self.pipe(pipe).toggle;
                match usb.output(address, number, toggle, &bytes, memory) {
                    Ok(()) if is_lost => self.acknowledgement = Acknowledgement::Comes,
                    Ok(()) => {
                        self.pipe(pipe).toggle = !toggle;
                        self.to_send.drain(..bytes.len());
                        self.remote.iter_mut().for_each(|remote| remote.sent(bytes.len()));
                    }
                    Err(Refused::Nak | Refused::Silence) => self.pipe(pipe).ready = now + RETRY,
                    Err(Refused::Stall) => self.clear_halt(pipe, number),
                }
            }
        }
    }

    /// A pipe was refused with STALL: it waits for the request that ends that.
    fn clear_halt(&mut self, pipe: Pipe, endpoint: u8) {
        if let Some(remote) = &mut self.remote {
            if let Some(left) = remote.left().filter(|_| pipe == Pipe::BulkOut) {
                self.to_send.drain(..left);
            }
            return remote.end(pipe, Err(UrbError::Stalled));
        }
        self.pipe(pipe).ready = Ticks::NEVER;
        let requests = &mut self.session.requests;
        requests.push_back(Request::ClearHalt(endpoint));
    }
}
