//! The USB host at the other end of the cable: a laptop that opens the device's CDC-ACM port.
//!
//! | step | when |
//! |---|---|
//! | sees the pull-up | DETACH = 0 |
//! | debounce | 100 ms (USB 2.0, 7.1.7.3) |
//! | bus reset | 10 ms; then 10 ms recovery with start-of-frame packets each 1 ms |
//! | enumeration | device descriptor, SET_ADDRESS, configuration, strings, SET_CONFIGURATION |
//! | opens the port | SET_LINE_CODING, SET_CONTROL_LINE_STATE (DTR, RTS) |
//! | suspends | no packets at all; resumes with 20 ms of K (USB 2.0, 7.1.7.7) |
//! | traffic | bulk OUT when it has bytes, bulk IN all the time, interrupt IN at its interval |
//!
//! A frame carries as many transactions as fit: a 64-byte packet takes 53 us with its token and
//! handshake (13 bytes of overhead at 12 Mbit/s, USB 2.0 5.8.4, and 2 us between transactions). A
//! NAK is tried again after 50 us. Control requests follow one another a frame apart. Three tokens
//! without any answer, or five seconds, end a control transfer; the host then resets the bus and
//! starts anew, three times at most. What systems do differently is in `system`.
//!
//! | left out | why |
//! |---|---|
//! | remote wake-up, power | the host wakes when it wants to |
//! | bit errors but lost acknowledgements | the cable is good |
//! | other classes, isochronous endpoints, hubs | the device has one serial port |

mod control;
mod descriptors;
mod enumeration;
mod remote;
mod request;
mod system;
#[cfg(test)]
mod tests;
mod transaction;

pub use remote::{Answer, Urb, UrbError};
pub use system::System;

use crate::board::Ticks;
use crate::memory::Memory;
use crate::peripherals::usb::Usb;
use control::Transfer;
use descriptors::SerialPort;
use remote::Remote;
use request::Request;
use std::collections::VecDeque;
use thiserror::Error;
use transaction::{PipeState, Transaction};

const FRAME: Ticks = Ticks::from_ms(1);
const DEBOUNCE: Ticks = Ticks::from_ms(100);
const RESET: Ticks = Ticks::from_ms(10);
const RECOVERY: Ticks = Ticks::from_ms(10);
const RESUME: Ticks = Ticks::from_ms(20);
const RETRY: Ticks = Ticks::from_us(50);
/// Between two transactions.
const GAP: Ticks = Ticks::from_us(2);
/// A byte at 12 Mbit/s.
const BYTE: Ticks = Ticks(32);
/// Attempts at enumeration.
const ATTEMPTS: u8 = 3;

/// What went wrong on the host's side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum HostError {
    /// The device did not answer this request, or not in five seconds.
    #[error("no answer to {0}")]
    NoAnswer(&'static str),
    /// The device refused this request with STALL.
    #[error("{0} refused")]
    Refused(&'static str),
    /// A data packet came with the toggle of the one before it; it was dropped.
    #[error("data packet with the wrong toggle")]
    WrongToggle,
    /// More bytes came than the endpoint's packet size or the request allow.
    #[error("more data than announced")]
    TooLong,
    /// A descriptor is wrong: what about it.
    #[error("descriptor: {0}")]
    Descriptor(&'static str),
}

/// What the host has counted since power-on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Start-of-frame packets.
    pub frames: u64,
    /// Bulk IN packets received, those without data included.
    pub packets_in: u64,
    /// Bulk transactions answered with NAK.
    pub naks: u64,
    /// Times that the device was configured.
    pub enumerations: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    /// No cable, or no device, or given up.
    #[default]
    Idle,
    /// The cable has just been put in.
    Plugged,
    Debounce,
    Reset,
    /// Again, after the first descriptor.
    SecondReset,
    Frames,
    Suspended,
    /// The host is to wake.
    Waking,
    /// The host signals that it has woken.
    Resume,
}

/// The host.
#[derive(Clone, Debug, Default)]
pub struct Host {
    system: System,
    cable: bool,
    phase: Phase,
    due: Ticks,
    next_frame: Ticks,
    /// Until this time every token would be answered with NAK, if neither side acts; the chip need
    /// not stop for the host before it.
    quiet_until: Ticks,
    frame: u16,
    attempts: u8,
    session: Session,
    enumeration: Enumeration,
    baud: u32,
    dtr: bool,
    reading: bool,
    received: Vec<u8>,
    to_send: VecDeque<u8>,
    errors: Vec<HostError>,
    acknowledgement: Acknowledgement,
    statistics: Statistics,
    /// A driver elsewhere has the device.
    remote: Option<Remote>,
}

/// What becomes of the handshake of a bulk packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Acknowledgement {
    #[default]
    Comes,
    /// That of the next packet does not.
    IsLost,
    /// The host has a packet whose acknowledgement the device has not: it comes once more.
    WasLost,
}

/// The state that lasts from one bus reset to the next.
#[derive(Clone, Debug, Default)]
struct Session {
    transaction: Option<Transaction>,
    transfer: Option<Transfer>,
    requests: VecDeque<Request>,
    address: u8,
    port: Option<SerialPort>,
    configured: bool,
    /// By [`Pipe`](transaction::Pipe).
    pipes: [PipeState; 4],
}

/// What the device has reported of itself; kept until the next enumeration.
#[derive(Clone, Debug, Default)]
struct Enumeration {
    /// Packet size of endpoint 0.
    control_packet: u8,
    /// Manufacturer, product and serial number, as far as the device has them.
    strings: Vec<String>,
    device_descriptor: Vec<u8>,
    configuration: Vec<u8>,
}

impl Host {
    /// A host with the cable in, that opens the port at 115,200 baud with DTR as `system` has it.
    pub fn of(system: System) -> Self {
        Self {
            system,
            cable: true,
            due: Ticks::NEVER,
            next_frame: Ticks::NEVER,
            baud: 115_200,
            dtr: system.raises_dtr(),
            reading: true,
            ..Self::default()
        }
    }

    /// Whether the port is open: the device is configured and knows line coding and DTR.
    pub fn is_configured(&self) -> bool {
        let session = &self.session;
        session.configured && session.requests.is_empty() && session.transfer.is_none()
    }

    /// Queues bytes for the device.
    pub fn write(&mut self, bytes: &[u8]) {
        self.quiet_until = Ticks::ZERO;
        self.to_send.extend(bytes);
    }

    /// Bytes queued that the device has not taken yet.
    pub fn unsent(&self) -> usize {
        self.to_send.len()
    }

    /// Takes what the device has sent, to a driver elsewhere too.
    pub fn read(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.received)
    }

    /// Sets the line coding: `baud`, 8 data bits, no parity, one stop bit. An Arduino board takes
    /// 1200 with DTR dropped as the request to enter its bootloader.
    pub fn set_line_coding(&mut self, baud: u32) {
        self.baud = baud;
        self.ask_lines(&[Request::LineCoding { baud }]);
    }

    /// Sets or drops DTR (and RTS).
    pub fn set_dtr(&mut self, dtr: bool) {
        self.dtr = dtr;
        self.ask_lines(&[Request::ControlLines { dtr }]);
    }

    /// A program opens or closes the port and leaves DTR to the system.
    pub fn set_open(&mut self, open: bool) {
        self.set_dtr(open && self.system.raises_dtr());
    }

    /// Line coding or lines change, if the port is there and the system sends that.
    fn ask_lines(&mut self, requests: &[Request]) {
        let sent = !self.system.heeds_capabilities()
            || self.session.port.is_some_and(|port| port.announces_lines);
        if self.session.configured && sent {
            self.quiet_until = Ticks::ZERO;
            self.session.requests.extend(requests);
        }
    }

    /// Resets the bus with the cable in, and enumerates the device anew. What is queued is lost.
    pub fn reset_bus(&mut self) {
        if self.phase == Phase::Frames {
            self.attempts = 0;
            self.reset_at_once();
        }
    }

    /// The acknowledgement of the next bulk packet is lost on the wire (USB 2.0, 8.6.4), unless one
    /// has been lost whose packet is still to come again.
    pub fn lose_acknowledgement(&mut self) {
        if self.acknowledgement == Acknowledgement::Comes {
            self.quiet_until = Ticks::ZERO;
            self.acknowledgement = Acknowledgement::IsLost;
        }
    }

    /// Falls asleep: the bus idles, and the device is to suspend.
    pub fn suspend(&mut self) {
        if self.phase == Phase::Frames {
            self.quiet_until = Ticks::ZERO;
            self.session.transaction = None;
            self.phase = Phase::Suspended;
            self.due = Ticks::NEVER;
        }
    }

    /// Wakes, and goes on where it was.
    pub fn resume(&mut self) {
        if self.phase == Phase::Suspended {
            self.phase = Phase::Waking;
            self.due = Ticks::ZERO;
        }
    }

    /// The operating system.
    pub fn system(&self) -> System {
        self.system
    }

    /// Stops asking for bulk data, as a program that no longer reads its port, or goes on.
    pub fn pause_reading(&mut self, paused: bool) {
        self.quiet_until = Ticks::ZERO;
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

    /// What went wrong, oldest first.
    pub fn errors(&self) -> &[HostError] {
        &self.errors
    }

    /// Counters.
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// When the host acts next so that the device notices. A time that has passed means at once.
    pub(crate) fn next(&self) -> Ticks {
        self.due.max(self.quiet_until)
    }

    /// Does what was left out up to `now`, because nothing but NAKs comes of it. To be called
    /// before the device looks at its USB controller or changes anything, and before the host is
    /// looked at or told something.
    pub(crate) fn settle(&mut self, now: Ticks, usb: &mut Usb, memory: &mut Memory) {
        while self.due <= now && self.due < self.quiet_until {
            self.advance(self.due, usb, memory);
        }
    }

    /// The device may have changed: its pull-up, and what it has ready.
    pub(crate) fn observe(&mut self, now: Ticks, usb: &Usb) {
        if self.quiet_until != Ticks::ZERO && !self.hears_only_naks(usb) {
            self.quiet_until = Ticks::ZERO;
        }
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
                self.begin_frames(now);
                self.begin_enumeration(now + RECOVERY);
            }
            Phase::SecondReset => {
                usb.bus_reset(now);
                self.begin_frames(now);
                self.address_device(now + RECOVERY);
            }
            Phase::Suspended => self.due = Ticks::NEVER,
            Phase::Waking => {
                usb.wake(now);
                self.phase = Phase::Resume;
                self.due = now + RESUME;
            }
            Phase::Resume => self.begin_frames(now),
            Phase::Frames => return self.advance_frame(now, usb, memory),
        }
        false
    }

    fn advance_frame(&mut self, now: Ticks, usb: &mut Usb, memory: &mut Memory) -> bool {
        if let Some(transaction) = self.session.transaction.take() {
            self.due = now + GAP;
            self.complete(now, transaction, usb, memory);
            return false;
        }
        if now >= self.next_frame {
            self.frame = (self.frame + 1) & 0x7FF;
            usb.start_of_frame(now, self.frame);
            self.statistics.frames += 1;
            self.quiet_until = Ticks::ZERO;
            self.next_frame += FRAME;
            self.due = now + BYTE * 4;
            return true;
        }
        self.begin_transaction(now, usb);
        false
    }

    fn begin_frames(&mut self, now: Ticks) {
        self.phase = Phase::Frames;
        self.next_frame = now;
        self.due = now;
    }

    fn begin_reset(&mut self, now: Ticks) {
        self.phase = Phase::Reset;
        self.due = now + RESET;
    }

    /// The device, or the cable, is gone.
    fn forget_device(&mut self) {
        self.phase = Phase::Idle;
        self.due = Ticks::NEVER;
        self.quiet_until = Ticks::ZERO;
        self.attempts = 0;
        self.session = Session::default();
        self.acknowledgement = Acknowledgement::Comes;
        self.remote = None;
    }
}
