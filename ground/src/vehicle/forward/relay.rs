//! Between a ground station and the vehicle: frames are passed on, but for what is answered here.
//!
//! The vehicle has no room for files. Requests for files, and for where the description of its
//! parameters is, are answered in its name and never reach it. Its own frames are numbered on past
//! these answers, so that the station still counts every frame that is lost on the vehicle's link.

use client::{Frame, Wire};
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMPONENT_METADATA_DATA, FILE_TRANSFER_PROTOCOL_DATA, MavCmd, MavMessage,
    MavResult,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, Message as _, MessageData as _};
use tvc_nano::config::COMPONENT_ID;

use super::ftp::{self, File};
use super::metadata;

/// Where a frame has its sequence number, and the system that sent it.
const SEQUENCE_AT: usize = 4;
const SYSTEM_AT: usize = 5;
/// Bytes before its payload, and of its checksum.
const HEADER: usize = 10;
const CHECKSUM: usize = 2;

/// What becomes of a datagram from the station.
#[derive(Debug, Default)]
pub struct Relayed {
    /// What the vehicle gets.
    pub to_vehicle: Vec<u8>,
    /// Frames that the station gets.
    pub to_station: Vec<Vec<u8>>,
}

/// The relay.
#[derive(Clone, Debug)]
pub struct Relay {
    files: [File; 2],
    /// The vehicle's system id, 0 before it has been heard.
    system: u8,
    /// Number of the newest frame that the station has got.
    sequence: u8,
    /// Answers so far, modulo 256.
    answers: u8,
}

impl Relay {
    /// A relay that has heard no vehicle yet: it answers nothing before.
    pub fn new() -> Self {
        Self {
            files: metadata::files(),
            system: 0,
            sequence: 0,
            answers: 0,
        }
    }

    /// A frame of the vehicle, as the station gets it.
    pub fn pass(&mut self, frame: &Frame) -> Vec<u8> {
        let mut bytes = frame.bytes.clone();
        self.system = frame.system();
        self.sequence = bytes[SEQUENCE_AT].wrapping_add(self.answers);
        if self.answers != 0 {
            bytes[SEQUENCE_AT] = self.sequence;
            let end = HEADER + usize::from(bytes[1]);
            let extra = MavMessage::extra_crc(frame.message.message_id());
            let crc = mavlink::calculate_crc(&bytes[1..end], extra);
            bytes[end..end + CHECKSUM].copy_from_slice(&crc.to_le_bytes());
        }
        bytes
    }

    /// The vehicle has this system id.
    pub fn hears(&mut self, system: u8) {
        self.system = system;
    }

    /// A datagram of the station. Of the requests in it that are answered here the first is, since
    /// a station waits for its answer; what is no frame is passed on as it is.
    pub fn take(&mut self, datagram: &[u8]) -> Relayed {
        let mut relayed = Relayed::default();
        let mut rest = datagram;
        while !rest.is_empty() {
            let length = Wire::frame_length(rest).unwrap_or(1);
            let frame = Wire::default().receive_frames(&rest[..length]).pop();
            let answers = frame.as_ref().and_then(|frame| self.answers_to(frame));
            let (bytes, next) = match frame {
                Some(_) => rest.split_at(length),
                // Perhaps there is a frame behind this byte.
                None => rest.split_at(1),
            };
            rest = next;
            match answers {
                None => relayed.to_vehicle.extend_from_slice(bytes),
                Some(answers) if relayed.to_station.is_empty() => {
                    let frames = answers.iter().map(|answer| self.frame(answer));
                    relayed.to_station = frames.collect();
                }
                Some(_) => {}
            }
        }
        relayed
    }

    /// The answers to what is not for the vehicle; `None` for what is.
    fn answers_to(&self, frame: &Frame) -> Option<Vec<MavMessage>> {
        let asked = |system: u8, component: u8| {
            let is_here = [0, self.system].contains(&system) && self.system != 0;
            is_here && [0, COMPONENT_ID].contains(&component)
        };
        let where_it_is = |command, param1| {
            command == MavCmd::MAV_CMD_REQUEST_MESSAGE
                && param1 == COMPONENT_METADATA_DATA::ID as f32
        };
        match &frame.message {
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => {
                let asked = asked(m.target_system, m.target_component);
                let payloads = match asked {
                    true => ftp::answers(&self.files, &m.payload),
                    false => Vec::new(),
                };
                let answer = |payload| {
                    MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
                        target_network: 0,
                        target_system: frame.system(),
                        target_component: frame.bytes[SYSTEM_AT + 1],
                        payload,
                    })
                };
                Some(payloads.into_iter().map(answer).collect())
            }
            MavMessage::COMMAND_LONG(m)
                if where_it_is(m.command, m.param1)
                    && asked(m.target_system, m.target_component) =>
            {
                Some(self.metadata())
            }
            MavMessage::COMMAND_INT(m)
                if where_it_is(m.command, m.param1)
                    && asked(m.target_system, m.target_component) =>
            {
                Some(self.metadata())
            }
            _ => None,
        }
    }

    fn metadata(&self) -> Vec<MavMessage> {
        let [general, _] = &self.files;
        vec![
            MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
                result: MavResult::MAV_RESULT_ACCEPTED,
            }),
            MavMessage::COMPONENT_METADATA(COMPONENT_METADATA_DATA {
                time_boot_ms: 0,
                file_crc: general.checksum(),
                uri: metadata::GENERAL.into(),
            }),
        ]
    }

    /// A frame in the vehicle's name, numbered behind the newest.
    fn frame(&mut self, message: &MavMessage) -> Vec<u8> {
        self.answers = self.answers.wrapping_add(1);
        self.sequence = self.sequence.wrapping_add(1);
        let header = MavHeader {
            system_id: self.system.into(),
            component_id: COMPONENT_ID,
            sequence: self.sequence,
        };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(header, message);
        raw.raw_bytes().to_vec()
    }
}

#[cfg(test)]
mod tests;
