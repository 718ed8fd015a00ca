//! MAVLink frames on a stream of bytes, as any ground station reads and writes them.

use mavlink::dialects::common::MavMessage;
use mavlink::types::CharArray;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message};

/// First byte of a frame.
pub const START: u8 = 0xFD;
/// Bytes of a frame before its payload.
pub const HEADER: usize = 10;
/// Where a frame has the number of the system that sent it.
pub const SYSTEM_AT: usize = 5;
/// Bytes of a frame's checksum.
pub const CHECKSUM: usize = 2;
/// Bytes of a frame's signature.
pub const SIGNATURE: usize = 13;
/// The flag of a frame that is signed.
pub const SIGNED: u8 = 1;

/// What has been counted on a wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Frames that arrived whole.
    pub messages: u64,
    /// Frames missing by their sequence numbers.
    pub lost: u64,
    /// Frames whose checksum was wrong or that could not be understood.
    pub crc_errors: u64,
    /// Bytes outside of any frame.
    pub stray_bytes: u64,
}

/// A frame that arrived whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its bytes, from start marker to checksum or signature.
    pub bytes: Vec<u8>,
    /// What it says; control characters in what people are shown are question marks.
    pub message: MavMessage,
}

impl Frame {
    /// MAVLink system id of whoever sent it.
    pub fn system(&self) -> u8 {
        self.bytes[SYSTEM_AT]
    }

    /// Its payload as it came: without trailing zeros, with extensions that the dialect's types do
    /// not have.
    pub fn payload(&self) -> &[u8] {
        &self.bytes[HEADER..HEADER + usize::from(self.bytes[1])]
    }
}

/// Takes messages out of received bytes and puts messages into bytes to send.
#[derive(Clone, Debug, Default)]
pub struct Wire {
    buffer: Vec<u8>,
    sequence: Option<u8>,
    sent: u8,
    counts: LinkCounts,
}

impl Wire {
    /// What has been counted.
    pub fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// Starts counting anew; frames under way are kept.
    pub fn reset_counts(&mut self) {
        self.counts = LinkCounts::default();
    }

    /// Takes in received bytes; the messages that are complete now.
    pub fn receive(&mut self, bytes: &[u8]) -> Vec<MavMessage> {
        let frames = self.receive_frames(bytes);
        frames.into_iter().map(|frame| frame.message).collect()
    }

    /// Takes in received bytes; the frames that are complete now, for whoever keeps or passes on
    /// their bytes.
    pub fn receive_frames(&mut self, bytes: &[u8]) -> Vec<Frame> {
        self.buffer.extend_from_slice(bytes);
        let mut frames = Vec::new();
        let mut at = 0;
        while let Some(&first) = self.buffer.get(at) {
            if first != START {
                self.counts.stray_bytes += 1;
                at += 1;
                continue;
            }
            let Some(frame) = whole(&self.buffer[at..]) else {
                break;
            };
            let length = frame.len();
            if let Some(message) = decode(frame) {
                let sequence = frame[4];
                if let Some(last) = self.sequence.replace(sequence) {
                    let missing = sequence.wrapping_sub(last).wrapping_sub(1);
                    self.counts.lost += u64::from(missing);
                }
                self.counts.messages += 1;
                frames.push(Frame { bytes: frame.to_vec(), message });
                at += length;
            } else {
                // Perhaps no frame at all: look for one behind this start byte.
                self.counts.crc_errors += 1;
                at += 1;
            }
        }
        self.buffer.drain(..at);
        frames
    }

    /// Length of the frame that `bytes` begin with, if they do and hold all of it.
    pub fn frame_length(bytes: &[u8]) -> Option<usize> {
        match bytes.first() {
            Some(&START) => whole(bytes).map(<[u8]>::len),
            _ => None,
        }
    }

    /// Whether `frame` is one whole frame: as long as it says, with the right checksum.
    pub fn is_whole(frame: &[u8]) -> bool {
        Self::frame_length(frame) == Some(frame.len()) && is_sound(frame)
    }

    /// The bytes of a message from ground station 255.
    pub fn frame(&mut self, message: &MavMessage) -> Vec<u8> {
        let header = MavHeader { system_id: 255, component_id: 190, sequence: self.sent };
        self.sent = self.sent.wrapping_add(1);
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(header, message);
        raw.raw_bytes().to_vec()
    }
}

/// The frame at the beginning of `bytes`, if it is complete by its own length.
fn whole(bytes: &[u8]) -> Option<&[u8]> {
    let (length, flags) = (usize::from(*bytes.get(1)?), *bytes.get(2)?);
    let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE };
    bytes.get(..HEADER + length + CHECKSUM + signature)
}

/// Whether the checksum of a complete frame is right.
fn is_sound(frame: &[u8]) -> bool {
    let end = HEADER + usize::from(frame[1]);
    let sum = mavlink::calculate_crc(&frame[1..end], MavMessage::extra_crc(message_id(frame)));
    sum.to_le_bytes() == frame[end..end + CHECKSUM]
}

fn message_id(frame: &[u8]) -> u32 {
    u32::from_le_bytes([frame[7], frame[8], frame[9], 0])
}

fn decode(frame: &[u8]) -> Option<MavMessage> {
    if !is_sound(frame) {
        return None;
    }
    let payload = &frame[HEADER..HEADER + usize::from(frame[1])];
    let mut message = MavMessage::parse(MavlinkVersion::V2, message_id(frame), payload).ok()?;
    match &mut message {
        MavMessage::STATUSTEXT(said) => make_visible(&mut said.text),
        MavMessage::PARAM_VALUE(told) => make_visible(&mut told.param_id),
        MavMessage::NAMED_VALUE_FLOAT(told) => make_visible(&mut told.name),
        MavMessage::NAMED_VALUE_INT(told) => make_visible(&mut told.name),
        _ => {}
    }
    Some(message)
}

/// Replaces control characters, by which a device would command the terminal that shows its text.
fn make_visible<const N: usize>(field: &mut CharArray<N>) {
    if let Ok(text) = field.to_str()
        && text.contains(char::is_control)
    {
        let visible = text.replace(char::is_control, "?");
        *field = CharArray::from(visible.as_str());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{HEARTBEAT_DATA, STATUSTEXT_DATA};

    fn heartbeat(mode: u32) -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { custom_mode: mode, ..HEARTBEAT_DATA::default() })
    }

    #[test]
    fn frames_survive_being_cut_anywhere() {
        let mut sender = Wire::default();
        let bytes: Vec<u8> = (0..5).flat_map(|i| sender.frame(&heartbeat(i))).collect();
        for size in 1..bytes.len() {
            let mut wire = Wire::default();
            let messages: Vec<_> = bytes.chunks(size).flat_map(|c| wire.receive(c)).collect();
            assert_eq!(messages, (0..5).map(heartbeat).collect::<Vec<_>>());
            assert_eq!(wire.counts(), LinkCounts { messages: 5, ..LinkCounts::default() });
        }
    }

    #[test]
    fn gaps_damage_and_noise_are_counted() {
        let mut sender = Wire::default();
        let frames: Vec<_> = (0..4).map(|i| sender.frame(&heartbeat(i))).collect();
        let mut damaged = frames[1].clone();
        damaged[12] ^= 0x10;
        let mut wire = Wire::default();
        let mut messages = wire.receive(b"noise");
        messages.extend(wire.receive(&frames[0]));
        messages.extend(wire.receive(&damaged));
        messages.extend(wire.receive(&frames[3]));
        assert_eq!(messages, [heartbeat(0), heartbeat(3)]);
        let counts = wire.counts();
        assert_eq!((counts.messages, counts.lost, counts.crc_errors), (2, 2, 1));
        assert!(counts.stray_bytes >= 5);
    }

    #[test]
    fn a_device_commands_no_terminal() {
        let said = |text: &str| {
            MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                text: text.into(),
                ..STATUSTEXT_DATA::default()
            })
        };
        let evil = said("\x1b]0;title\x07 and\nerror: \u{9b}31m");
        let bytes = Wire::default().frame(&evil);
        let frames = Wire::default().receive_frames(&bytes);
        assert_eq!(frames[0].message, said("?]0;title? and?error: ?31m"));
        assert_eq!(frames[0].bytes, bytes, "a log keeps it as it came");
    }

    #[test]
    fn sequence_numbers_wrap() {
        let mut sender = Wire::default();
        let mut wire = Wire::default();
        for i in 0..600 {
            let frame = sender.frame(&heartbeat(i));
            assert_eq!(wire.receive(&frame).len(), 1);
        }
        assert_eq!(wire.counts().lost, 0);
    }
}
