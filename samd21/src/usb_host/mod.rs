//! The USB host at the other end of the cable: a laptop that opens the device's CDC-ACM port.
//!
//! | step | when |
//! |---|---|
//! | sees the pull-up | DETACH = 0 |
//! | debounce | 100 ms (USB 2.0, 7.1.7.3) |
//! | bus reset | 10 ms; then 10 ms recovery with start-of-frame packets each 1 ms |
//! | enumeration | device descriptor 8, SET_ADDRESS, 18, configuration 9 and whole, strings, SET_CONFIGURATION |
//! | opens the port | SET_LINE_CODING, SET_CONTROL_LINE_STATE (DTR, RTS) |
//! | traffic | bulk OUT when there is something to send, bulk IN all the time, interrupt IN at its interval |
//!
//! A frame carries as many transactions as fit: a 64-byte packet takes 53 us with its token and
//! handshake (13 bytes of overhead at 12 Mbit/s, USB 2.0 5.8.4, and 2 us between transactions). A
//! NAK is tried again after 50 us. Control requests follow one another a frame apart. Three tokens
//! without any answer, or five seconds, end a control transfer; the host then resets the bus and
//! starts anew, three times at most.
//!
//! | left out | why |
//! |---|---|
//! | suspend, remote wake-up, power | the rig's host is awake while the cable is in |
//! | bit errors | the cable is good |
//! | other classes, isochronous endpoints, hubs | the device has one serial port |

mod control;
mod descriptors;
mod enumeration;
#[cfg(test)]
mod tests;

pub use descriptors::{Endpoint, SerialPort};
pub use enumeration::Strings;

use crate::board::Ticks;
use crate::memory::Memory;
use crate::peripherals::usb::{Handshake, Packet, Usb};
use control::Transfer;
use enumeration::Request;
use std::collections::VecDeque;
use std::fmt;

const FRAME: Ticks = Ticks::from_ms(1);
const DEBOUNCE: Ticks = Ticks::from_ms(100);
const RESET: Ticks = Ticks::from_ms(10);
const RECOVERY: Ticks = Ticks::from_ms(10);
const RETRY: Ticks = Ticks::from_us(50);
/// Between two transactions.
const GAP: Ticks = Ticks::from_us(2);
/// A byte at 12 Mbit/s.
const BYTE: Ticks = Ticks(32);
/// Tokens, headers, CRC, handshake and turn-around of a transaction, in bytes.
const OVERHEAD: u64 = 13;
/// A token and a NAK.
const NAK_TIME: Ticks = Ticks(8 * BYTE.0);
/// Attempts at enumeration.
const ATTEMPTS: u8 = 3;

/// What went wrong on the host's side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostError {
    /// The device did not answer this request, or not in five seconds.
    NoAnswer(&'static str),
    /// The device refused this request with STALL.
    Refused(&'static str),
    /// A data packet came with the toggle of the one before it; it was dropped.
    WrongToggle,
    /// More bytes came than the endpoint's packet size or the request allow.
    TooLong,
    /// A descriptor is wrong: what about it.
    Descriptor(&'static str),
}

impl fmt::Display for HostError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAnswer(request) => write!(f, "no answer to {request}"),
            Self::Refused(request) => write!(f, "{request} refused"),
            Self::WrongToggle => write!(f, "data packet with the wrong toggle"),
            Self::TooLong => write!(f, "more data than announced"),
            Self::Descriptor(what) => write!(f, "descriptor: {what}"),
        }
    }
}

/// What the host has counted since power-on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Start-of-frame packets.
    pub frames: u64,
    /// Bulk IN packets received, those without data included.
    pub packets_in: u64,
    /// Bulk OUT packets acknowledged.
    pub packets_out: u64,
    /// Bulk transactions answered with NAK.
    pub naks: u64,
    /// Times that the device was configured.
    pub enumerations: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No cable, or no device, or given up.
    Idle,
    /// The cable has just been put in.
    Plugged,
    Debounce,
    Reset,
    Frames,
}

/// A transaction on the wire; it ends at `due`.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Transaction {
    Control,
    BulkIn,
    BulkOut(Vec<u8>),
    Interrupt,
    /// One that is answered with NAK.
    Nak(Pipe),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pipe {
    Control,
    BulkIn,
    BulkOut,
    Interrupt,
}

/// State of one pipe: toggle of its next packet, and when it is tried again.
#[derive(Clone, Copy, Debug, Default)]
struct PipeState {
    toggle: bool,
    ready: Ticks,
}

/// The host.
#[derive(Clone, Debug)]
pub struct Host {
    cable: bool,
    phase: Phase,
    due: Ticks,
    next_frame: Ticks,
    frame: u16,
    transaction: Option<Transaction>,
    transfer: Option<Transfer>,
    control_ready: Ticks,
    requests: VecDeque<Request>,
    attempts: u8,
    address: u8,
    control_packet: u8,
    port: Option<SerialPort>,
    strings: Strings,
    device_descriptor: Vec<u8>,
    configuration: Vec<u8>,
    configured: bool,
    bulk_in: PipeState,
    bulk_out: PipeState,
    interrupt: PipeState,
    baud: u32,
    dtr: bool,
    reading: bool,
    received: Vec<u8>,
    to_send: VecDeque<u8>,
    errors: Vec<HostError>,
    statistics: Statistics,
}

impl Default for Host {
    fn default() -> Self {
        Self::new()
    }
}

impl Host {
    /// A host with the cable in, that opens the port at 115,200 baud with DTR set.
    pub fn new() -> Self {
        Self {
            cable: true,
            phase: Phase::Idle,
            due: Ticks::NEVER,
            next_frame: Ticks::NEVER,
            frame: 0,
            transaction: None,
            transfer: None,
            control_ready: Ticks::ZERO,
            requests: VecDeque::new(),
            attempts: 0,
            address: 0,
            control_packet: 8,
            port: None,
            strings: Strings::default(),
            device_descriptor: Vec::new(),
            configuration: Vec::new(),
            configured: false,
            bulk_in: PipeState::default(),
            bulk_out: PipeState::default(),
            interrupt: PipeState::default(),
            baud: 115_200,
            dtr: true,
            reading: true,
            received: Vec::new(),
            to_send: VecDeque::new(),
            errors: Vec::new(),
            statistics: Statistics::default(),
        }
    }

    /// Whether the port is open: the device is configured and knows line coding and DTR.
    pub fn is_configured(&self) -> bool {
        self.configured && self.requests.is_empty() && self.transfer.is_none()
    }

    /// Queues bytes for the device.
    pub fn write(&mut self, bytes: &[u8]) {
        self.to_send.extend(bytes);
    }

    /// Bytes queued that the device has not taken yet.
    pub fn unsent(&self) -> usize {
        self.to_send.len()
    }

    /// Takes what the device has sent.
    pub fn read(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.received)
    }

    /// Sets the line coding: `baud`, 8 data bits, no parity, one stop bit. A device takes 1200 with DTR
    /// dropped as the request to enter its bootloader.
    pub fn set_line_coding(&mut self, baud: u32) {
        self.baud = baud;
        if self.configured {
            self.requests.push_back(Request::LineCoding);
        }
    }

    /// Sets or drops DTR (and RTS).
    pub fn set_dtr(&mut self, dtr: bool) {
        self.dtr = dtr;
        if self.configured {
            self.requests.push_back(Request::ControlLines { dtr });
        }
    }

    /// Stops asking for bulk data, as a program that no longer reads its port, or goes on.
    pub fn pause_reading(&mut self, paused: bool) {
        self.reading = !paused;
    }

    /// Pulls the cable. What is queued is lost.
    pub fn detach(&mut self) {
        self.cable = false;
        self.forget_device();
        self.to_send.clear();
    }

    /// Puts the cable in.
    pub fn attach(&mut self) {
        if !self.cable {
            self.cable = true;
            self.phase = Phase::Plugged;
            self.due = Ticks::ZERO;
        }
    }

    /// Whether the cable is in.
    pub fn is_attached(&self) -> bool {
        self.cable
    }

    /// The serial port found in the descriptors.
    pub fn serial_port(&self) -> Option<&SerialPort> {
        self.port.as_ref()
    }

    /// Manufacturer, product and serial number.
    pub fn strings(&self) -> &Strings {
        &self.strings
    }

    /// The device descriptor as received.
    pub fn device_descriptor(&self) -> &[u8] {
        &self.device_descriptor
    }

    /// The whole configuration as received.
    pub fn configuration_descriptor(&self) -> &[u8] {
        &self.configuration
    }

    /// What went wrong, oldest first.
    pub fn errors(&self) -> &[HostError] {
        &self.errors
    }

    /// Counters.
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// When the host acts next. A time that has passed means at once.
    pub(crate) fn next(&self) -> Ticks {
        self.due
    }

    /// The device's pull-up may have changed.
    pub(crate) fn observe(&mut self, now: Ticks, usb: &Usb) {
        if !usb.is_attached() {
            if self.phase != Phase::Idle || self.attempts != 0 {
                self.forget_device();
            }
        } else if self.cable && self.phase == Phase::Idle && self.attempts == 0 {
            self.phase = Phase::Debounce;
            self.due = now + DEBOUNCE;
        }
    }

    /// Does what is due at `now`; true if a start-of-frame packet went out.
    pub(crate) fn advance(&mut self, now: Ticks, usb: &mut Usb, memory: &mut Memory) -> bool {
        match self.phase {
            Phase::Idle => self.due = Ticks::NEVER,
            Phase::Plugged => {
                self.phase = Phase::Idle;
                self.due = Ticks::NEVER;
                self.observe(now, usb);
            }
            Phase::Debounce => self.begin_reset(now),
            Phase::Reset => {
                usb.bus_reset(now);
                self.phase = Phase::Frames;
                self.next_frame = now;
                self.due = now;
                self.control_ready = now + RECOVERY;
                self.begin_enumeration();
            }
            Phase::Frames => return self.advance_frame(now, usb, memory),
        }
        false
    }

    fn advance_frame(&mut self, now: Ticks, usb: &mut Usb, memory: &mut Memory) -> bool {
        if let Some(transaction) = self.transaction.take() {
            self.due = now + GAP;
            self.complete(now, transaction, usb, memory);
            return false;
        }
        if now >= self.next_frame {
            self.frame = (self.frame + 1) & 0x7FF;
            usb.start_of_frame(now, self.frame);
            self.statistics.frames += 1;
            self.next_frame += FRAME;
            self.due = now + BYTE * 4;
            return true;
        }
        self.begin_transaction(now, usb);
        false
    }

    /// Puts the next transaction on the wire, if one is ready and fits into the frame.
    fn begin_transaction(&mut self, now: Ticks, usb: &Usb) {
        self.due = self.next_frame;
        self.next_request(now);
        let mut candidates = [Pipe::Control, Pipe::Interrupt, Pipe::BulkOut, Pipe::BulkIn];
        if self.frame.is_multiple_of(2) {
            // Neither direction starves the other.
            candidates.swap(2, 3);
        }
        for pipe in candidates {
            let Some(ready) = self.ready(pipe) else {
                continue;
            };
            if ready > now {
                self.due = self.due.min(ready);
                continue;
            }
            let (transaction, duration) = self.compose(pipe, usb);
            if now + duration <= self.next_frame {
                self.transaction = Some(transaction);
                self.due = now + duration;
                return;
            }
            self.due = self.next_frame;
        }
    }

    /// When a pipe has something to do, if it has.
    fn ready(&self, pipe: Pipe) -> Option<Ticks> {
        match pipe {
            Pipe::Control => self.transfer.as_ref().map(|_| self.control_ready),
            Pipe::BulkOut => {
                (self.configured && !self.to_send.is_empty()).then_some(self.bulk_out.ready)
            }
            Pipe::BulkIn => (self.configured && self.reading).then_some(self.bulk_in.ready),
            Pipe::Interrupt => {
                (self.configured && self.port?.interrupt.is_some()).then_some(self.interrupt.ready)
            }
        }
    }

    /// The transaction that a pipe wants, and how long it takes.
    fn compose(&self, pipe: Pipe, usb: &Usb) -> (Transaction, Ticks) {
        let port = self.port.unwrap_or_default();
        let interrupt = port.interrupt.unwrap_or_default();
        let (number, is_in, transaction, length) = match pipe {
            Pipe::Control => {
                let transfer = self.transfer.as_ref();
                let is_in = transfer.is_some_and(Transfer::is_in);
                if transfer.is_some_and(Transfer::is_setup) {
                    let duration = BYTE * (OVERHEAD + 8);
                    return (Transaction::Control, duration);
                }
                let length = u64::from(self.control_packet);
                (0, is_in, Transaction::Control, length)
            }
            Pipe::BulkOut => {
                let size = usize::from(port.bulk_out.packet_size);
                let bytes: Vec<u8> = self.to_send.iter().take(size).copied().collect();
                let length = bytes.len() as u64;
                (
                    port.bulk_out.number,
                    false,
                    Transaction::BulkOut(bytes),
                    length,
                )
            }
            Pipe::BulkIn => {
                let length = u64::from(port.bulk_in.packet_size);
                (port.bulk_in.number, true, Transaction::BulkIn, length)
            }
            Pipe::Interrupt => {
                let length = u64::from(interrupt.packet_size);
                (interrupt.number, true, Transaction::Interrupt, length)
            }
        };
        if usb.would_nak(number, is_in) {
            (Transaction::Nak(pipe), NAK_TIME)
        } else {
            (transaction, BYTE * (OVERHEAD + length))
        }
    }

    fn complete(
        &mut self,
        now: Ticks,
        transaction: Transaction,
        usb: &mut Usb,
        memory: &mut Memory,
    ) {
        let port = self.port.unwrap_or_default();
        match transaction {
            Transaction::Nak(pipe) => self.answered_nak(now, pipe, usb),
            Transaction::Control => self.advance_control(now, usb, memory),
            Transaction::BulkIn => match usb.input(self.address, port.bulk_in.number, memory) {
                Packet::Data(bytes, toggle) => {
                    self.statistics.packets_in += 1;
                    if bytes.len() > usize::from(port.bulk_in.packet_size) {
                        self.errors.push(HostError::TooLong);
                    } else if toggle == self.bulk_in.toggle {
                        self.bulk_in.toggle = !toggle;
                        self.received.extend(bytes);
                    } else {
                        self.errors.push(HostError::WrongToggle);
                    }
                }
                Packet::Nak | Packet::Silence => self.bulk_in.ready = now + RETRY,
                Packet::Stall => {
                    self.bulk_in.ready = Ticks::NEVER;
                    self.requests
                        .push_back(Request::ClearHalt(0x80 | port.bulk_in.number));
                }
            },
            Transaction::BulkOut(bytes) => {
                let toggle = self.bulk_out.toggle;
                match usb.output(self.address, port.bulk_out.number, toggle, &bytes, memory) {
                    Handshake::Ack => {
                        self.statistics.packets_out += 1;
                        self.bulk_out.toggle = !toggle;
                        self.to_send.drain(..bytes.len());
                    }
                    Handshake::Nak | Handshake::Silence => self.bulk_out.ready = now + RETRY,
                    Handshake::Stall => {
                        self.bulk_out.ready = Ticks::NEVER;
                        self.requests
                            .push_back(Request::ClearHalt(port.bulk_out.number));
                    }
                }
            }
            Transaction::Interrupt => {
                let endpoint = port.interrupt.unwrap_or_default();
                if let Packet::Data(_, toggle) = usb.input(self.address, endpoint.number, memory) {
                    self.interrupt.toggle = !toggle;
                }
                self.interrupt.ready = now + Ticks::from_ms(u64::from(endpoint.interval_ms));
            }
        }
    }

    fn answered_nak(&mut self, now: Ticks, pipe: Pipe, usb: &mut Usb) {
        let port = self.port.unwrap_or_default();
        match pipe {
            Pipe::Control => {
                usb.nak(0, self.transfer.as_ref().is_some_and(Transfer::is_in));
                self.delay_control(now);
            }
            Pipe::BulkIn => {
                usb.nak(port.bulk_in.number, true);
                self.statistics.naks += 1;
                self.bulk_in.ready = now + RETRY;
            }
            Pipe::BulkOut => {
                usb.nak(port.bulk_out.number, false);
                self.statistics.naks += 1;
                self.bulk_out.ready = now + RETRY;
            }
            Pipe::Interrupt => {
                let endpoint = port.interrupt.unwrap_or_default();
                usb.nak(endpoint.number, true);
                self.interrupt.ready = now + Ticks::from_ms(u64::from(endpoint.interval_ms));
            }
        }
    }

    fn begin_reset(&mut self, now: Ticks) {
        self.phase = Phase::Reset;
        self.due = now + RESET;
    }

    /// The device, or the cable, is gone.
    fn forget_device(&mut self) {
        self.phase = Phase::Idle;
        self.due = Ticks::NEVER;
        self.attempts = 0;
        self.end_session();
    }

    fn end_session(&mut self) {
        self.transaction = None;
        self.transfer = None;
        self.requests.clear();
        self.address = 0;
        self.configured = false;
        self.port = None;
        self.bulk_in = PipeState::default();
        self.bulk_out = PipeState::default();
        self.interrupt = PipeState::default();
    }
}
