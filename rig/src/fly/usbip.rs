//! The rig's USB device for another computer's kernel: a server of USB/IP 1.1.1, as the kernel's
//! `Documentation/usb/usbip_protocol.rst` has it. The kernel enumerates the emulated device, and
//! its drivers talk with the firmware.
//!
//! One client at a time. Isochronous transfers do not exist on this device.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};

use samd21::usb_host::{Answer, Host, Urb, UrbError};

/// The name by which a client attaches the device.
pub const BUS_ID: &str = "1-1";

/// What goes before a list or an import: version, code, status.
const VERSION: u16 = 0x0111;
const LIST: u16 = 5;
const IMPORT: u16 = 3;
/// Set in the code of a request.
const REQUEST: u16 = 0x8000;
/// Status of a device that cannot be had.
const NOT_AVAILABLE: u32 = 1;
/// Bytes of a bus id.
const BUS_ID_BYTES: usize = 32;

/// What goes before a transfer, and how long that is.
const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const HEADER: usize = 48;
/// Longest transfer that is taken, bytes.
const LONGEST: usize = 1 << 20;

/// Full speed, of Linux' `enum usb_device_speed`.
const FULL_SPEED: u32 = 2;
/// Linux' error numbers.
const ECONNRESET: i32 = -104;

/// The server.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    client: Option<Client>,
}

#[derive(Debug)]
struct Client {
    stream: TcpStream,
    /// It has the device.
    imported: bool,
    incoming: Vec<u8>,
    outgoing: Vec<u8>,
}

impl Server {
    /// Serves whoever connects.
    ///
    /// # Errors
    /// The system does not let it look without waiting.
    pub fn new(listener: TcpListener) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self { listener, client: None })
    }

    /// Passes on what the client has sent and what the device has answered, and waits for neither.
    /// A client that leaves gives the device back.
    pub fn poll(&mut self, host: &mut Host) {
        if self.client.is_none()
            && let Ok((stream, _)) = self.listener.accept()
            && stream.set_nonblocking(true).is_ok()
        {
            // Transfers are small, and each waits for the one before.
            let _ = stream.set_nodelay(true);
            let (incoming, outgoing) = (Vec::new(), Vec::new());
            self.client = Some(Client { stream, imported: false, incoming, outgoing });
        }
        let Some(client) = &mut self.client else { return };
        if client.serve(host).is_err() {
            self.client = None;
            host.take_back();
        }
    }
}

impl Client {
    /// # Errors
    /// It has gone, the device has left the bus, or what it sends is no USB/IP.
    fn serve(&mut self, host: &mut Host) -> io::Result<()> {
        if self.imported && !host.is_handed_over() {
            return Err(ErrorKind::ConnectionReset.into());
        }
        for answer in host.answers() {
            self.outgoing.extend(returned(&answer));
        }
        let mut chunk = [0; 4096];
        loop {
            match self.stream.read(&mut chunk) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.incoming.extend_from_slice(&chunk[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        loop {
            let taken = if self.imported { self.transfer(host)? } else { self.operation(host)? };
            if taken == 0 {
                break;
            }
            self.incoming.drain(..taken);
        }
        while !self.outgoing.is_empty() {
            match self.stream.write(&self.outgoing) {
                Ok(count) => drop(self.outgoing.drain(..count)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// A list or an import, if it has come whole: the number of its bytes.
    fn operation(&mut self, host: &mut Host) -> io::Result<usize> {
        let Some(head) = self.incoming.first_chunk::<8>() else { return Ok(0) };
        let [version, code] = [[head[0], head[1]], [head[2], head[3]]].map(u16::from_be_bytes);
        match code {
            _ if version != VERSION => Err(ErrorKind::InvalidData.into()),
            code if code == REQUEST | LIST => {
                let there = host.is_configured();
                self.reply(LIST, 0);
                self.outgoing.extend(u32::from(there).to_be_bytes());
                if there {
                    self.outgoing.extend(described(host));
                    self.outgoing.extend(interfaces(host.configuration()));
                }
                Ok(8)
            }
            code if code == REQUEST | IMPORT => {
                let Some(name) = self.incoming.get(8..8 + BUS_ID_BYTES) else { return Ok(0) };
                let asked = name.split(|byte| *byte == 0).next().unwrap_or_default();
                self.imported = asked == BUS_ID.as_bytes() && host.hand_over();
                self.reply(IMPORT, if self.imported { 0 } else { NOT_AVAILABLE });
                if self.imported {
                    self.outgoing.extend(described(host));
                }
                Ok(8 + BUS_ID_BYTES)
            }
            _ => Err(ErrorKind::InvalidData.into()),
        }
    }

    fn reply(&mut self, code: u16, status: u32) {
        self.outgoing.extend([VERSION, code].into_iter().flat_map(u16::to_be_bytes));
        self.outgoing.extend(status.to_be_bytes());
    }

    /// A transfer that is submitted or taken back, if it has come whole: the number of its bytes.
    fn transfer(&mut self, host: &mut Host) -> io::Result<usize> {
        let Some(head) = self.incoming.first_chunk::<HEADER>() else { return Ok(0) };
        let word = |index: usize| {
            let bytes = head[4 * index..].first_chunk().copied();
            u32::from_be_bytes(bytes.unwrap_or_default())
        };
        match word(0) {
            SUBMIT => {
                let (is_in, length) = (word(3) != 0, word(6) as usize);
                if length > LONGEST || word(4) > 15 {
                    return Err(ErrorKind::InvalidData.into());
                }
                let end = HEADER + if is_in { 0 } else { length };
                let Some(data) = self.incoming.get(HEADER..end) else { return Ok(0) };
                host.submit(Urb {
                    id: word(1),
                    endpoint: word(4) as u8,
                    is_in,
                    setup: head[40..].first_chunk().copied().unwrap_or_default(),
                    data: data.to_vec(),
                    length: if is_in { length } else { 0 },
                });
                Ok(end)
            }
            UNLINK => {
                // One that has ended was answered before.
                let status = if host.unlink(word(5)) { ECONNRESET } else { 0 };
                self.outgoing.extend(header(UNLINK, word(1), status, 0));
                Ok(HEADER)
            }
            _ => Err(ErrorKind::InvalidData.into()),
        }
    }
}

/// The header of an answer to a transfer of this kind.
fn header(kind: u32, id: u32, status: i32, length: usize) -> Vec<u8> {
    /// By how much the number of an answer is larger than that of what it answers.
    const ANSWER: u32 = 2;
    let words = [kind + ANSWER, id, 0, 0, 0, status as u32, length as u32, 0, 0, 0, 0, 0];
    words.into_iter().flat_map(u32::to_be_bytes).collect()
}

fn returned(answer: &Answer) -> Vec<u8> {
    let (status, data) = match &answer.data {
        Ok(data) => (0, data.as_slice()),
        Err(UrbError::NoEndpoint) => (-2, [].as_slice()),
        Err(UrbError::Stalled) => (-32, [].as_slice()),
        Err(UrbError::Silent) => (-71, [].as_slice()),
        Err(UrbError::Wrong) => (-75, [].as_slice()),
    };
    let mut bytes = header(SUBMIT, answer.id, status, data.len().max(answer.sent));
    bytes.extend_from_slice(data);
    bytes
}

/// The device in a list or an import, by its descriptors (USB 2.0, tables 9-8 and 9-10).
fn described(host: &Host) -> Vec<u8> {
    let mut bytes = format!("/sys/devices/tvc-nano/usb1/{BUS_ID}").into_bytes();
    bytes.resize(256, 0);
    bytes.extend(BUS_ID.bytes());
    bytes.resize(256 + BUS_ID_BYTES, 0);
    // Bus 1, device 2.
    bytes.extend([1, 2, FULL_SPEED].into_iter().flat_map(u32::to_be_bytes));
    let device = host.device_descriptor();
    let of_device = |at: usize| device.get(at).copied().unwrap_or_default();
    let of_configuration = |at: usize| host.configuration().get(at).copied().unwrap_or_default();
    // Vendor, product, release: big-endian here.
    bytes.extend([9, 8, 11, 10, 13, 12].map(of_device));
    // Class, subclass, protocol.
    bytes.extend([4, 5, 6].map(of_device));
    bytes.push(of_configuration(5));
    bytes.push(of_device(17));
    bytes.push(of_configuration(4));
    bytes
}

/// Class, subclass and protocol of each interface, and a byte of padding.
fn interfaces(configuration: &[u8]) -> Vec<u8> {
    let (mut bytes, mut rest) = (Vec::new(), configuration);
    while let [length, kind, ..] = *rest
        && length >= 2
    {
        if let (4, Some([class, subclass, protocol])) = (kind, rest.get(5..8)) {
            bytes.extend([*class, *subclass, *protocol, 0]);
        }
        rest = rest.get(usize::from(length)..).unwrap_or_default();
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfaces_are_those_of_the_configuration_and_damage_is_no_harm() {
        let configuration =
            [9, 2, 25, 0, 2, 1, 0, 0x80, 50, 9, 4, 0, 0, 1, 2, 2, 1, 0, 9, 4, 1, 0, 2, 10, 0, 0, 0];
        assert_eq!(interfaces(&configuration), [2, 2, 1, 0, 10, 0, 0, 0]);
        for cut in 0..configuration.len() {
            assert!(interfaces(&configuration[..cut]).len() <= 8);
        }
        assert!(interfaces(&[0, 4, 0, 0, 0, 1, 1, 1]).is_empty());
    }

    /// The header of a transfer that was answered: command, number, and behind the place of device,
    /// direction and endpoint, status and length.
    #[test]
    fn answers_are_told_as_the_protocol_has_them() {
        let answer = |data, sent| returned(&Answer { id: 0x0102, data, sent });
        let read = answer(Ok(vec![7, 8]), 0);
        assert_eq!(read[..8], [0, 0, 0, 3, 0, 0, 1, 2]);
        assert_eq!(read[20..28], [0, 0, 0, 0, 0, 0, 0, 2]);
        assert_eq!(read[48..], [7, 8]);
        let written = answer(Ok(Vec::new()), 7);
        assert_eq!((written.len(), written[27]), (48, 7));
        let stalled = answer(Err(UrbError::Stalled), 0);
        assert_eq!(stalled[20..24], (-32_i32).to_be_bytes());
    }
}
