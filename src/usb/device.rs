//! The device: endpoint 0's transfers, the requests, and what the host has said of the port.

#[cfg(test)]
mod tests;

use super::descriptors::{
    self, CONFIGURED, CONTROL_INTERFACE, INTERFACES, LANGUAGES, MANUFACTURER_TEXT, PRODUCT_TEXT,
    SERIAL_DESCRIPTOR_BYTES, WHOLE_CONFIGURATION,
};
use super::request::{kind, number};
use super::{Controller, Endpoint, PACKET_BYTES, Request};

/// Bytes of a line coding (PSTN 1.2, table 17): rate, stop bits, parity, data bits.
const CODING_BYTES: usize = 7;
/// 9,600 baud, 8N1.
const USUAL_CODING: [u8; CODING_BYTES] = [0x80, 0x25, 0, 0, 0, 0, 8];
/// wValue of a feature of an endpoint.
const ENDPOINT_HALT: u16 = 0;
/// Highest address of a device.
const LAST_ADDRESS: u16 = 127;

/// The device.
#[derive(Clone, Debug)]
pub struct Device {
    descriptor: &'static [u8; 18],
    serial_number: [u8; SERIAL_DESCRIPTOR_BYTES],
    stage: Stage,
    is_configured: bool,
    coding: [u8; CODING_BYTES],
    dtr: bool,
}

/// Where a control transfer is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Nothing is expected but a SETUP.
    Idle,
    /// The host takes data, of which `sent` bytes have been handed to the controller.
    Sending { data: Data, sent: usize, total: usize },
    /// All has been handed over; the host ends the transfer by an empty packet.
    Sent,
    /// The host has `left` bytes more to send.
    Receiving { what: Received, left: u16 },
    /// The empty packet that ends the transfer has been handed over. With it a new address counts.
    Acknowledging { address: Option<u8> },
}

/// Data for the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Data {
    Fixed(&'static [u8]),
    SerialNumber,
    LineCoding,
    /// A status.
    Two([u8; 2]),
    /// A configuration's or a setting's number.
    One([u8; 1]),
}

/// Data of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Received {
    LineCoding,
    /// A modem's command, which a serial port has to take and this one does not look at.
    Command,
}

/// What a request leads to.
enum Answer {
    Send(Data),
    Receive(Received),
    Done,
    Address(u8),
    Refuse,
}

impl Device {
    /// Not yet attached. `descriptor` is [`descriptors::device`]'s, `serial` the number that makes
    /// this device another than the next.
    pub fn new(descriptor: &'static [u8; 18], serial: [u8; 16]) -> Self {
        Self {
            descriptor,
            serial_number: descriptors::serial_number(serial),
            stage: Stage::Idle,
            is_configured: false,
            coding: USUAL_CODING,
            dtr: false,
        }
    }

    /// The host has reset the bus.
    pub fn reset(&mut self) {
        self.stage = Stage::Idle;
        self.is_configured = false;
        self.coding = USUAL_CODING;
        self.dtr = false;
    }

    /// Whether the host has chosen the configuration.
    pub fn is_configured(&self) -> bool {
        self.is_configured
    }

    /// A program has the port open (DTR).
    pub fn is_open(&self) -> bool {
        self.dtr
    }

    /// The rate that the host has set, baud.
    pub fn baud(&self) -> u32 {
        let [b0, b1, b2, b3, ..] = self.coding;
        u32::from_le_bytes([b0, b1, b2, b3])
    }

    /// The host begins a transfer, whatever became of the one before.
    pub fn setup(&mut self, controller: &mut impl Controller, bytes: [u8; 8]) {
        let request = Request::from(bytes);
        self.stage = Stage::Idle;
        match self.answer(controller, &request) {
            Answer::Send(data) => {
                self.send_next(controller, data, 0, request.length);
            }
            Answer::Receive(what) if request.length > 0 => {
                let left = request.length;
                self.stage = Stage::Receiving { what, left };
            }
            Answer::Receive(_) | Answer::Done => acknowledge(controller, &mut self.stage, None),
            Answer::Address(address) => {
                acknowledge(controller, &mut self.stage, Some(address));
            }
            Answer::Refuse => controller.stall(),
        }
    }

    /// The host has sent a packet on endpoint 0.
    pub fn received(&mut self, controller: &mut impl Controller, packet: &[u8]) {
        match self.stage {
            Stage::Receiving { what, left } => {
                let left = left.saturating_sub(packet.len() as u16);
                let whole: Option<&[u8; CODING_BYTES]> = packet.try_into().ok();
                match (what, whole) {
                    (Received::LineCoding, Some(coding)) => self.coding = *coding,
                    (Received::LineCoding, None) => return self.refuse(controller),
                    (Received::Command, _) => {}
                }
                if left == 0 || packet.len() < PACKET_BYTES {
                    acknowledge(controller, &mut self.stage, None);
                } else {
                    self.stage = Stage::Receiving { what, left };
                }
            }
            // The end of a transfer, or of one of which the host has seen enough.
            Stage::Sending { .. } | Stage::Sent if packet.is_empty() => self.stage = Stage::Idle,
            _ => self.refuse(controller),
        }
    }

    /// The host has taken the packet that was sent on endpoint 0.
    pub fn sent(&mut self, controller: &mut impl Controller) {
        match self.stage {
            Stage::Sending { data, sent, total } => {
                self.send_next(controller, data, sent, total as u16);
            }
            Stage::Acknowledging { address } => {
                if let Some(address) = address {
                    controller.set_address(address);
                }
                self.stage = Stage::Idle;
            }
            Stage::Idle | Stage::Sent | Stage::Receiving { .. } => {}
        }
    }

    fn refuse(&mut self, controller: &mut impl Controller) {
        self.stage = Stage::Idle;
        controller.stall();
    }

    /// Hand over the packet behind `sent` bytes. Data that are shorter than the `wanted` bytes end
    /// with a packet that is not full, or with an empty one (USB 2.0, 8.5.3.2).
    fn send_next(
        &mut self,
        controller: &mut impl Controller,
        data: Data,
        sent: usize,
        wanted: u16,
    ) {
        let total = usize::from(wanted);
        let rest = self.bytes(&data).get(sent..).unwrap_or(&[]);
        let longest = PACKET_BYTES.min(total.saturating_sub(sent));
        let packet = rest.get(..longest).unwrap_or(rest);
        controller.send(packet);
        let sent = sent + packet.len();
        self.stage = if packet.len() < PACKET_BYTES || sent >= total {
            Stage::Sent
        } else {
            Stage::Sending { data, sent, total }
        };
    }

    fn bytes<'a>(&'a self, data: &'a Data) -> &'a [u8] {
        match data {
            Data::Fixed(bytes) => bytes,
            Data::SerialNumber => &self.serial_number,
            Data::LineCoding => &self.coding,
            Data::Two(bytes) => bytes,
            Data::One(bytes) => bytes,
        }
    }

    fn answer(&mut self, controller: &mut impl Controller, request: &Request) -> Answer {
        let Request { value, index, .. } = *request;
        let is_interface = index < u16::from(INTERFACES);
        match (request.kind, request.number) {
            (kind::FROM_DEVICE, number::GET_STATUS) => Answer::Send(Data::Two([0, 0])),
            (kind::FROM_INTERFACE, number::GET_STATUS) if is_interface => {
                Answer::Send(Data::Two([0, 0]))
            }
            (kind::FROM_ENDPOINT, number::GET_STATUS) => {
                let halted = match Endpoint::at(index) {
                    Some(endpoint) => controller.is_halted(endpoint),
                    None if is_control(index) => false,
                    None => return Answer::Refuse,
                };
                Answer::Send(Data::Two([halted.into(), 0]))
            }
            (kind::TO_ENDPOINT, number::CLEAR_FEATURE | number::SET_FEATURE)
                if value == ENDPOINT_HALT =>
            {
                match Endpoint::at(index) {
                    Some(endpoint) => {
                        controller.halt(endpoint, request.number == number::SET_FEATURE);
                        Answer::Done
                    }
                    None if is_control(index) => Answer::Done,
                    None => Answer::Refuse,
                }
            }
            (kind::TO_DEVICE, number::SET_ADDRESS) if value <= LAST_ADDRESS => {
                Answer::Address(value as u8)
            }
            (kind::FROM_DEVICE, number::GET_DESCRIPTOR) => {
                self.descriptor(value).map_or(Answer::Refuse, Answer::Send)
            }
            (kind::FROM_DEVICE, number::GET_CONFIGURATION) => {
                let configuration = if self.is_configured { CONFIGURED } else { 0 };
                Answer::Send(Data::One([configuration]))
            }
            (kind::TO_DEVICE, number::SET_CONFIGURATION) if value <= u16::from(CONFIGURED) => {
                self.is_configured = value == u16::from(CONFIGURED);
                restart_endpoints(controller);
                Answer::Done
            }
            (kind::FROM_INTERFACE, number::GET_INTERFACE) if is_interface => {
                Answer::Send(Data::One([0]))
            }
            (kind::TO_INTERFACE, number::SET_INTERFACE) if is_interface && value == 0 => {
                restart_endpoints(controller);
                Answer::Done
            }
            (kind::TO_PORT | kind::FROM_PORT, _) if index == u16::from(CONTROL_INTERFACE) => {
                self.answer_for_port(request)
            }
            _ => Answer::Refuse,
        }
    }

    /// The requests of the class.
    fn answer_for_port(&mut self, request: &Request) -> Answer {
        match (request.kind, request.number) {
            (kind::TO_PORT, number::SEND_ENCAPSULATED_COMMAND) => {
                Answer::Receive(Received::Command)
            }
            (kind::TO_PORT, number::SET_LINE_CODING)
                if usize::from(request.length) == CODING_BYTES =>
            {
                Answer::Receive(Received::LineCoding)
            }
            (kind::FROM_PORT, number::GET_LINE_CODING) => Answer::Send(Data::LineCoding),
            (kind::TO_PORT, number::SET_CONTROL_LINE_STATE) => {
                self.dtr = request.value & 1 != 0;
                Answer::Done
            }
            _ => Answer::Refuse,
        }
    }

    /// By kind, in the upper byte, and index.
    fn descriptor(&self, value: u16) -> Option<Data> {
        let [index, kind] = value.to_le_bytes();
        Some(match (kind, index) {
            (descriptors::DEVICE, 0) => Data::Fixed(self.descriptor),
            (descriptors::CONFIGURATION, 0) => Data::Fixed(&WHOLE_CONFIGURATION),
            (descriptors::STRING, 0) => Data::Fixed(&LANGUAGES),
            (descriptors::STRING, descriptors::MANUFACTURER) => Data::Fixed(&MANUFACTURER_TEXT),
            (descriptors::STRING, descriptors::PRODUCT) => Data::Fixed(&PRODUCT_TEXT),
            (descriptors::STRING, descriptors::SERIAL_NUMBER) => Data::SerialNumber,
            _ => return None,
        })
    }
}

/// Whether a request's index means endpoint 0, in either direction.
fn is_control(index: u16) -> bool {
    index & !0x80 == 0
}

/// The empty packet that ends a transfer.
fn acknowledge(controller: &mut impl Controller, stage: &mut Stage, address: Option<u8>) {
    controller.send(&[]);
    *stage = Stage::Acknowledging { address };
}

/// As after a configuration has been chosen (USB 2.0, 9.1.1.5).
#[inline(never)]
fn restart_endpoints(controller: &mut impl Controller) {
    for endpoint in Endpoint::ALL {
        controller.halt(endpoint, false);
    }
}
