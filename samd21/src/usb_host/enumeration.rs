//! What the host asks of the device, and in which order.

use super::control::Transfer;
use super::descriptors::SerialPort;
use super::remote::{Remote, UrbError};
use super::request::{Request, Text};
use super::transaction::{Pipe, PipeState};
use super::{ATTEMPTS, Enumeration, Host, HostError, Phase, RESET, Session, System};
use crate::board::Ticks;

/// The address that the host gives.
const ADDRESS: u8 = 1;
/// Time for the device to take its address: 2 ms by USB 2.0, 9.2.6.3; hosts give 10 ms.
const ADDRESS_RECOVERY: Ticks = Ticks::from_ms(10);
/// From the end of one request to the next: an interrupt reports the end to the host's driver,
/// which queues the next request for the following frame. Devices rely on it: one that takes a
/// status packet from its endpoint's buffer would lose a SETUP that overwrote it in that moment.
const TURNAROUND: Ticks = Ticks::from_ms(1);
/// The least bcdUSB of devices that have a BOS, high byte first.
const BOS_VERSION: [u8; 2] = [0x02, 0x01];
/// US English.
const LANGUAGE: u16 = 0x0409;

impl Host {
    /// Begins with the first request; endpoint 0 is used from `ready` on.
    pub(super) fn begin_enumeration(&mut self, ready: Ticks) {
        if self.remote.is_some() {
            return self.address_device(ready);
        }
        self.session = Session::default();
        self.pipe(Pipe::Control).ready = ready;
        self.attempts += 1;
        let (control_packet, first) = if self.system.resets_twice() {
            (64, Request::DeviceFirst)
        } else {
            (8, Request::DeviceHead)
        };
        self.enumeration = Enumeration { control_packet, ..Enumeration::default() };
        self.session.requests.push_back(first);
    }

    /// Goes on after a bus reset: the device gets its address.
    pub(super) fn address_device(&mut self, ready: Ticks) {
        let port = self.session.port;
        self.session = Session { port, ..Session::default() };
        self.pipe(Pipe::Control).ready = ready;
        self.session.requests.push_back(Request::SetAddress);
    }

    /// Starts the next request if none is going on.
    pub(super) fn next_request(&mut self, now: Ticks) {
        if self.session.transfer.is_some() {
            return;
        }
        let has_remote = self.remote.as_ref().is_some_and(|with| with.waits(Pipe::Control));
        let remote_request = has_remote.then_some(Request::Remote);
        if let Some(request) = self.session.requests.pop_front().or(remote_request) {
            let (setup, data) = self.compose_request(request);
            self.session.transfer = Some(Transfer::new(now, request, setup, data));
        }
    }

    fn compose_request(&self, request: Request) -> ([u8; 8], Vec<u8>) {
        let port = self.session.port.unwrap_or_default();
        let interface = u16::from(port.control_interface);
        let total = self.enumeration.configuration.get(2..4);
        let total = total.map_or(9, |bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
        let setup = match request {
            Request::DeviceHead => setup(0x80, 6, 0x0100, 0, 8),
            Request::DeviceFirst => setup(0x80, 6, 0x0100, 0, 64),
            Request::SetAddress => setup(0x00, 5, u16::from(ADDRESS), 0, 0),
            Request::Device => setup(0x80, 6, 0x0100, 0, 18),
            Request::ConfigurationHead => {
                setup(0x80, 6, 0x0200, 0, self.system.configuration_head())
            }
            Request::Configuration => setup(0x80, 6, 0x0200, 0, total),
            Request::Bos => setup(0x80, 6, 0x0F00, 0, 5),
            Request::Qualifier => setup(0x80, 6, 0x0600, 0, 10),
            Request::MicrosoftString => setup(0x80, 6, 0x03EE, 0, 18),
            Request::Languages => setup(0x80, 6, 0x0300, 0, 255),
            Request::Text(text) => setup(0x80, 6, 0x0300 | self.string_index(text), LANGUAGE, 255),
            Request::SetConfiguration => setup(0x00, 9, u16::from(port.configuration), 0, 0),
            Request::ReadLineCoding => setup(0xA1, 0x21, 0, interface, 7),
            Request::LineCoding { baud } => {
                let coding = [baud.to_le_bytes().as_slice(), &[0, 0, 8]].concat();
                return (setup(0x21, 0x20, 0, interface, 7), coding);
            }
            Request::ControlLines { dtr } => {
                let lines = if dtr { 3 } else { 0 };
                setup(0x21, 0x22, lines, interface, 0)
            }
            Request::ClearHalt(endpoint) => setup(0x02, 1, 0, u16::from(endpoint), 0),
            Request::Remote => {
                return self.remote.as_ref().map(Remote::request).unwrap_or_default();
            }
        };
        (setup, Vec::new())
    }

    /// A request has succeeded.
    pub(super) fn finish(&mut self, now: Ticks, request: Request, data: Vec<u8>) {
        self.pipe(Pipe::Control).ready = now + TURNAROUND;
        match request {
            Request::DeviceHead | Request::DeviceFirst => {
                let Some(&size @ (8 | 16 | 32 | 64)) = data.get(7) else {
                    return self.fail(now, HostError::Descriptor("bMaxPacketSize0"));
                };
                self.enumeration.control_packet = size;
                if request == Request::DeviceHead {
                    self.session.requests.push_back(Request::SetAddress);
                } else {
                    // The host resets the device again before it addresses it.
                    self.session = Session::default();
                    self.phase = Phase::SecondReset;
                    self.due = now + RESET;
                }
            }
            Request::SetAddress => {
                self.session.address = ADDRESS;
                self.pipe(Pipe::Control).ready = now + ADDRESS_RECOVERY;
                if self.remote.is_none() {
                    self.session.requests.push_back(Request::Device);
                }
            }
            Request::Device => {
                let version = data.get(2..4).map(|bcd| [bcd[1], bcd[0]]);
                self.enumeration.device_descriptor = data;
                if version >= Some(BOS_VERSION) && self.system.asks_bos() {
                    self.session.requests.push_back(Request::Bos);
                }
                if self.system.asks_qualifier() {
                    self.session.requests.push_back(Request::Qualifier);
                }
                self.session.requests.push_back(Request::ConfigurationHead);
            }
            Request::ConfigurationHead => {
                self.enumeration.configuration = data;
                self.session.requests.push_back(Request::Configuration);
            }
            Request::Configuration => {
                self.enumeration.configuration = data;
                match SerialPort::parse(&self.enumeration.configuration) {
                    Ok(port) => self.ask_strings_and_configure(port),
                    Err(error) => self.fail(now, error),
                }
            }
            Request::Text(_) => {
                let units = data.get(2..).unwrap_or_default().chunks_exact(2);
                let units: Vec<_> = units.map(|u| u16::from_le_bytes([u[0], u[1]])).collect();
                self.enumeration.strings.push(String::from_utf16_lossy(&units));
            }
            Request::SetConfiguration => {
                self.session.configured = true;
                self.attempts = 0;
                self.statistics.enumerations += 1;
                for pipe in [Pipe::BulkIn, Pipe::BulkOut, Pipe::Interrupt] {
                    self.pipe(pipe).ready = now;
                }
                self.open_port();
            }
            Request::ClearHalt(endpoint) => {
                let state = PipeState { toggle: false, ready: now };
                let is_in = endpoint & 0x80 != 0;
                *self.pipe(if is_in { Pipe::BulkIn } else { Pipe::BulkOut }) = state;
            }
            Request::Remote => self.finish_remote(now, data),
            // Of the others the host needs no answer but that they are taken.
            _ => {}
        }
    }

    /// The index of a string, 0 where the device has none.
    fn string_index(&self, text: Text) -> u16 {
        self.enumeration.device_descriptor.get(text as usize).map_or(0, |&index| index.into())
    }

    fn ask_strings_and_configure(&mut self, port: SerialPort) {
        self.session.port = Some(port);
        let mut present = vec![Text::Manufacturer, Text::Product, Text::SerialNumber];
        present.retain(|&text| self.string_index(text) != 0);
        if self.system.asks_microsoft_string() {
            self.session.requests.push_back(Request::MicrosoftString);
        }
        if !present.is_empty() {
            self.session.requests.push_back(Request::Languages);
        }
        self.session.requests.extend(present.into_iter().map(Request::Text));
        self.session.requests.push_back(Request::SetConfiguration);
    }

    /// The driver starts, and a program opens the port.
    fn open_port(&mut self) {
        let coding = Request::LineCoding { baud: self.baud };
        let lines = Request::ControlLines { dtr: self.dtr };
        match self.system {
            System::Bare | System::MacOs => self.ask_lines(&[coding, lines]),
            System::Linux => self.ask_lines(&[
                Request::ControlLines { dtr: false },
                Request::LineCoding { baud: 9600 },
                lines,
                coding,
            ]),
            System::Windows => self.ask_lines(&[Request::ReadLineCoding, coding, lines]),
        }
    }

    /// The device has answered a request wrongly. It works without strings and line state; any
    /// other request starts enumeration again.
    pub(super) fn refused(&mut self, now: Ticks, request: Request, error: HostError) {
        match request {
            Request::Remote => {
                let why = match error {
                    HostError::Refused(_) => UrbError::Stalled,
                    HostError::NoAnswer(_) => UrbError::Silent,
                    _ => UrbError::Wrong,
                };
                self.remote.iter_mut().for_each(|remote| remote.end(Pipe::Control, Err(why)));
            }
            // A device need not have these.
            Request::Bos | Request::Qualifier | Request::MicrosoftString => {}
            Request::Languages
            | Request::Text(_)
            | Request::ReadLineCoding
            | Request::LineCoding { .. }
            | Request::ControlLines { .. }
            | Request::ClearHalt(_) => self.errors.push(error),
            _ => self.fail(now, error),
        }
    }

    /// Enumeration or a request cannot go on: the bus is reset, or the device given up.
    pub(super) fn fail(&mut self, now: Ticks, error: HostError) {
        self.errors.push(error);
        self.session = Session::default();
        self.remote = None;
        if self.attempts < ATTEMPTS {
            self.begin_reset(now);
        } else {
            self.phase = Phase::Idle;
            self.due = Ticks::NEVER;
        }
    }
}

fn setup(kind: u8, request: u8, value: u16, index: u16, length: u16) -> [u8; 8] {
    let [v0, v1] = value.to_le_bytes();
    let [i0, i1] = index.to_le_bytes();
    let [l0, l1] = length.to_le_bytes();
    [kind, request, v0, v1, i0, i1, l0, l1]
}
