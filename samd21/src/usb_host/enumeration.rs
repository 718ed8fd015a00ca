//! What the host asks of the device, and in which order.

use super::control::Transfer;
use super::pipe::{Pipe, PipeState};
use super::request::{Request, Text};
use super::{ATTEMPTS, Enumeration, Host, HostError, SerialPort, Session};
use crate::board::Ticks;

/// The address that the host gives.
const ADDRESS: u8 = 1;
/// Time for the device to take its address: 2 ms by USB 2.0, 9.2.6.3; hosts give 10 ms.
const ADDRESS_RECOVERY: Ticks = Ticks::from_ms(10);
/// From the end of one request to the next: an interrupt reports the end to the host's driver,
/// which queues the next request for the following frame. Devices rely on it: one that takes a
/// status packet from its endpoint's buffer would lose a SETUP that overwrote it in that moment.
const TURNAROUND: Ticks = Ticks::from_ms(1);
/// US English.
const LANGUAGE: u16 = 0x0409;

/// The device's strings, empty where it has none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Strings {
    /// iManufacturer.
    pub manufacturer: String,
    /// iProduct.
    pub product: String,
    /// iSerialNumber.
    pub serial_number: String,
}

impl Host {
    /// Begins with the first request; endpoint 0 is used from `ready` on.
    pub(super) fn begin_enumeration(&mut self, ready: Ticks) {
        self.session = Session::default();
        self.pipe(Pipe::Control).ready = ready;
        self.attempts += 1;
        self.enumeration = Enumeration {
            control_packet: 8,
            ..Enumeration::default()
        };
        self.session.requests.push_back(Request::DeviceHead);
    }

    /// Starts the next request if none is going on.
    pub(super) fn next_request(&mut self, now: Ticks) {
        if self.session.transfer.is_none()
            && let Some(request) = self.session.requests.pop_front()
        {
            let (setup, data) = self.compose_request(request);
            self.session.transfer = Some(Transfer::new(now, request, setup, data));
        }
    }

    fn compose_request(&self, request: Request) -> ([u8; 8], Vec<u8>) {
        let port = self.session.port.unwrap_or_default();
        let interface = u16::from(port.control_interface);
        let total = self
            .enumeration
            .configuration
            .get(2..4)
            .map_or(9, |bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
        let index = |text: Text| {
            let index = self.enumeration.device_descriptor.get(text as usize);
            u16::from(index.copied().unwrap_or(0))
        };
        let setup = match request {
            Request::DeviceHead => setup(0x80, 6, 0x0100, 0, 8),
            Request::SetAddress => setup(0x00, 5, u16::from(ADDRESS), 0, 0),
            Request::Device => setup(0x80, 6, 0x0100, 0, 18),
            Request::ConfigurationHead => setup(0x80, 6, 0x0200, 0, 9),
            Request::Configuration => setup(0x80, 6, 0x0200, 0, total),
            Request::Languages => setup(0x80, 6, 0x0300, 0, 255),
            Request::Text(text) => setup(0x80, 6, 0x0300 | index(text), LANGUAGE, 255),
            Request::SetConfiguration => setup(0x00, 9, u16::from(port.configuration), 0, 0),
            Request::LineCoding => {
                let coding = [self.baud.to_le_bytes().as_slice(), &[0, 0, 8]].concat();
                return (setup(0x21, 0x20, 0, interface, 7), coding);
            }
            Request::ControlLines { dtr } => {
                let lines = if dtr { 3 } else { 0 };
                setup(0x21, 0x22, lines, interface, 0)
            }
            Request::ClearHalt(endpoint) => setup(0x02, 1, 0, u16::from(endpoint), 0),
        };
        (setup, Vec::new())
    }

    /// A request has succeeded.
    pub(super) fn finish(&mut self, now: Ticks, request: Request, data: Vec<u8>) {
        self.pipe(Pipe::Control).ready = now + TURNAROUND;
        match request {
            Request::DeviceHead => match data.get(7) {
                Some(&size @ (8 | 16 | 32 | 64)) => {
                    self.enumeration.control_packet = size;
                    self.session.requests.push_back(Request::SetAddress);
                }
                _ => self.fail(now, HostError::Descriptor("bMaxPacketSize0")),
            },
            Request::SetAddress => {
                self.session.address = ADDRESS;
                self.pipe(Pipe::Control).ready = now + ADDRESS_RECOVERY;
                self.session.requests.push_back(Request::Device);
            }
            Request::Device => {
                self.enumeration.device_descriptor = data;
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
            Request::Text(text) => {
                let units: Vec<u16> = data
                    .get(2..)
                    .unwrap_or_default()
                    .chunks_exact(2)
                    .map(|unit| u16::from_le_bytes([unit[0], unit[1]]))
                    .collect();
                *self.text(text) = String::from_utf16_lossy(&units);
            }
            Request::SetConfiguration => {
                self.session.configured = true;
                self.attempts = 0;
                self.statistics.enumerations += 1;
                for pipe in [Pipe::BulkIn, Pipe::BulkOut, Pipe::Interrupt] {
                    self.pipe(pipe).ready = now;
                }
            }
            Request::ClearHalt(endpoint) => {
                let state = PipeState {
                    toggle: false,
                    ready: now,
                };
                let is_in = endpoint & 0x80 != 0;
                *self.pipe(if is_in { Pipe::BulkIn } else { Pipe::BulkOut }) = state;
            }
            Request::Languages | Request::LineCoding | Request::ControlLines { .. } => {}
        }
    }

    fn ask_strings_and_configure(&mut self, port: SerialPort) {
        self.session.port = Some(port);
        let texts = [Text::Manufacturer, Text::Product, Text::SerialNumber];
        let present: Vec<Text> = texts
            .into_iter()
            .filter(|&text| {
                self.enumeration
                    .device_descriptor
                    .get(text as usize)
                    .is_some_and(|&index| index != 0)
            })
            .collect();
        if !present.is_empty() {
            self.session.requests.push_back(Request::Languages);
        }
        self.session
            .requests
            .extend(present.into_iter().map(Request::Text));
        self.session.requests.push_back(Request::SetConfiguration);
        self.session.requests.push_back(Request::LineCoding);
        self.session
            .requests
            .push_back(Request::ControlLines { dtr: self.dtr });
    }

    fn text(&mut self, text: Text) -> &mut String {
        match text {
            Text::Manufacturer => &mut self.enumeration.strings.manufacturer,
            Text::Product => &mut self.enumeration.strings.product,
            Text::SerialNumber => &mut self.enumeration.strings.serial_number,
        }
    }

    /// The device has answered a request wrongly. It works without strings and line state; any
    /// other request starts enumeration again.
    pub(super) fn refused(&mut self, now: Ticks, request: Request, error: HostError) {
        match request {
            Request::Languages
            | Request::Text(_)
            | Request::LineCoding
            | Request::ControlLines { .. }
            | Request::ClearHalt(_) => self.errors.push(error),
            _ => self.fail(now, error),
        }
    }

    /// Enumeration or a request cannot go on: the bus is reset, or the device given up.
    pub(super) fn fail(&mut self, now: Ticks, error: HostError) {
        self.errors.push(error);
        self.session = Session::default();
        if self.attempts < ATTEMPTS {
            self.begin_reset(now);
        } else {
            self.phase = super::Phase::Idle;
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
