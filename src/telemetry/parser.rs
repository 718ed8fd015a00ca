//! Frames out of a stream of bytes: MAVLink 2, and MAVLink 1 for clients that have not yet heard
//! from us.
//!
//! Only the messages that the flight understands are taken. Anything else is given up as soon as
//! its header shows it, and the search goes on at the very next byte. So noise that looks like a
//! start marker does not cost the frames behind it, and the buffer needs to hold no more than the
//! longest message of interest.

use heapless::Vec;
use mavlink::MessageData;
use mavlink::dialects::common::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, FILE_TRANSFER_PROTOCOL_DATA, HEARTBEAT_DATA,
    LOG_REQUEST_DATA_DATA, LOG_REQUEST_END_DATA, LOG_REQUEST_LIST_DATA, MISSION_CLEAR_ALL_DATA,
    MISSION_COUNT_DATA, MISSION_REQUEST_LIST_DATA, PARAM_REQUEST_LIST_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, TIMESYNC_DATA,
};

use super::checksum::Checksum;

/// Longest payload taken: COMMAND_INT has 35 bytes, and a request for a file 15 and the file's
/// name.
const MAX_PAYLOAD: usize = 64;
const SIGNATURE: usize = 13;
const MAX_FRAME: usize = 10 + MAX_PAYLOAD + 2 + SIGNATURE;

const START_V1: u8 = 0xFE;
const START_V2: u8 = 0xFD;
/// Incompatibility flag: a signature follows the checksum.
const SIGNED: u8 = 1;

/// PING: TIMESYNC has taken its place, and stations send it nevertheless.
#[allow(deprecated)]
pub(super) type Ping = mavlink::dialects::common::PING_DATA;

/// System and component; 0 stands for all.
pub(super) type Address = [u8; 2];

/// A message with a valid checksum.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message {
    /// Message id, one of those that [`Parser`] takes.
    pub(super) id: u32,
    /// Who sent it.
    pub(super) source: Address,
    /// Whom it is for.
    pub(super) target: Address,
    /// Its payload, trailing zeros left out as they came.
    pub(super) payload: Vec<u8, MAX_PAYLOAD>,
}

impl Message {
    /// The byte of the payload at this place; trailing zeros may have been left out.
    pub(super) fn byte(&self, at: usize) -> u8 {
        byte(&self.payload, at)
    }
}

fn byte(payload: &[u8], at: usize) -> u8 {
    payload.get(at).copied().unwrap_or(0)
}

/// Collects bytes until they make a message.
#[derive(Clone, Debug)]
pub(super) struct Parser {
    buffer: Vec<u8, MAX_FRAME>,
    crc_errors: u16,
}

/// What the bytes so far are.
enum Found {
    /// The beginning of a frame, perhaps.
    Part,
    /// No frame begins here.
    Nothing,
    /// A frame of this length whose checksum is wrong.
    Corrupt,
    /// A message, and its frame's length.
    Whole(Message, usize),
}

impl Parser {
    pub(super) const fn new() -> Self {
        Self { buffer: Vec::new(), crc_errors: 0 }
    }

    /// Take one byte. Follow with [`Parser::next_message`] until it gives nothing.
    pub(super) fn push(&mut self, byte: u8) {
        // Noise costs next to nothing: neither what lies between frames, nor a length that no
        // message of interest has.
        if self.buffer.len() == 1 && usize::from(byte) > MAX_PAYLOAD {
            self.buffer.clear();
        }
        if self.buffer.is_empty() && !matches!(byte, START_V1 | START_V2) {
            return;
        }
        if self.buffer.push(byte).is_err() {
            // Cannot happen while every frame taken fits: start over rather than lose step.
            self.buffer.clear();
        }
    }

    /// The next complete message.
    pub(super) fn next_message(&mut self) -> Option<Message> {
        loop {
            match examine(&self.buffer) {
                Found::Part => return None,
                Found::Nothing => self.discard(1),
                Found::Corrupt => {
                    self.crc_errors = self.crc_errors.wrapping_add(1);
                    self.discard(1);
                }
                Found::Whole(message, len) => {
                    self.discard(len);
                    return Some(message);
                }
            }
        }
    }

    /// Frames whose checksum was wrong.
    pub(super) fn crc_errors(&self) -> u16 {
        self.crc_errors
    }

    /// Drop the first `count` bytes, and what follows up to the next start marker.
    fn discard(&mut self, count: usize) {
        let (mut left, mut begun) = (count, false);
        self.buffer.retain(|byte| {
            if left > 0 {
                left -= 1;
            } else {
                begun |= matches!(*byte, START_V1 | START_V2);
            }
            begun
        });
    }
}

/// CRC_EXTRA of a message that is taken, and where its payload says whom it is for.
fn taken(id: u32) -> Option<(u8, usize)> {
    /// Nowhere: it is for all.
    const ALL: usize = MAX_PAYLOAD;
    Some(match id {
        HEARTBEAT_DATA::ID => (HEARTBEAT_DATA::EXTRA_CRC, ALL),
        // PING names the one that it answers.
        Ping::ID => (Ping::EXTRA_CRC, ALL),
        TIMESYNC_DATA::ID => (TIMESYNC_DATA::EXTRA_CRC, ALL),
        PARAM_REQUEST_READ_DATA::ID => (PARAM_REQUEST_READ_DATA::EXTRA_CRC, 2),
        PARAM_REQUEST_LIST_DATA::ID => (PARAM_REQUEST_LIST_DATA::EXTRA_CRC, 0),
        PARAM_SET_DATA::ID => (PARAM_SET_DATA::EXTRA_CRC, 4),
        MISSION_REQUEST_LIST_DATA::ID => (MISSION_REQUEST_LIST_DATA::EXTRA_CRC, 0),
        MISSION_COUNT_DATA::ID => (MISSION_COUNT_DATA::EXTRA_CRC, 2),
        MISSION_CLEAR_ALL_DATA::ID => (MISSION_CLEAR_ALL_DATA::EXTRA_CRC, 0),
        FILE_TRANSFER_PROTOCOL_DATA::ID => (FILE_TRANSFER_PROTOCOL_DATA::EXTRA_CRC, 1),
        COMMAND_INT_DATA::ID => (COMMAND_INT_DATA::EXTRA_CRC, 30),
        COMMAND_LONG_DATA::ID => (COMMAND_LONG_DATA::EXTRA_CRC, 30),
        LOG_REQUEST_LIST_DATA::ID => (LOG_REQUEST_LIST_DATA::EXTRA_CRC, 4),
        LOG_REQUEST_DATA_DATA::ID => (LOG_REQUEST_DATA_DATA::EXTRA_CRC, 10),
        LOG_REQUEST_END_DATA::ID => (LOG_REQUEST_END_DATA::EXTRA_CRC, 0),
        _ => return None,
    })
}

fn examine(bytes: &[u8]) -> Found {
    // Header length, sender, id and signature length, as far as the header has come.
    let (header, source, id, signature) = match *bytes {
        [] => return Found::Part,
        [START_V1 | START_V2, len, ..] if usize::from(len) > MAX_PAYLOAD => return Found::Nothing,
        [START_V1, _, _, system, component, id, ..] => (6, [system, component], u32::from(id), 0),
        [START_V2, _, flags, _, _, system, component, id0, id1, id2, ..] => {
            let signature = match flags {
                0 => 0,
                SIGNED => SIGNATURE,
                _ => return Found::Nothing,
            };
            let id = u32::from_le_bytes([id0, id1, id2, 0]);
            (10, [system, component], id, signature)
        }
        [START_V1 | START_V2, ..] => return Found::Part,
        _ => return Found::Nothing,
    };
    let Some((extra_crc, target_at)) = taken(id) else {
        return Found::Nothing;
    };
    let len = bytes.get(1).copied().map_or(0, usize::from);
    let end = header + len;
    let (Some(summed), Some(payload), Some(&[crc0, crc1])) =
        (bytes.get(1..end), bytes.get(header..end), bytes.get(end..end + 2))
    else {
        return Found::Part;
    };
    if Checksum::of(summed, extra_crc) != u16::from_le_bytes([crc0, crc1]) {
        return Found::Corrupt;
    }
    let total = end + 2 + signature;
    if bytes.len() < total {
        return Found::Part;
    }
    let target = [target_at, target_at + 1].map(|at| byte(payload, at));
    Vec::from_slice(payload).map_or(Found::Nothing, |payload| {
        let message = Message { id, source, target, payload };
        Found::Whole(message, total)
    })
}
