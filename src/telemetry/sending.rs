//! Frames on their way into the queue.

use core::fmt::{self, Write};

use mavlink::MessageData;
use mavlink::dialects::common::{LOG_DATA_DATA, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

use super::checksum::Checksum;
use super::queue::Priority;
use super::{MAX_PAYLOAD, OVERHEAD, Telemetry};
use crate::config::COMPONENT_ID;

/// Bytes of a frame's header behind its start.
const HEADER: usize = 9;
/// Longest payload: LOG_DATA's.
const LONGEST: usize = LOG_DATA_DATA::ENCODED_LEN;

impl Telemetry {
    /// A STATUSTEXT, cut to the 50 characters that STATUSTEXT holds.
    pub(super) fn status_text(&mut self, severity: MavSeverity, text: fmt::Arguments<'_>) {
        self.send_event(&STATUSTEXT_DATA { severity, text: CharArray::new(line(text)) });
    }

    /// A warning in words: a STATUSTEXT.
    pub(super) fn warn(&mut self, text: fmt::Arguments<'_>) {
        self.status_text(MavSeverity::MAV_SEVERITY_WARNING, text);
    }

    pub(super) fn send_event<D: MessageData>(&mut self, data: &D) {
        let mut payload = [0; MAX_PAYLOAD];
        let len = data.ser(mavlink::MavlinkVersion::V2, &mut payload);
        let payload = payload.get(..len).unwrap_or_default();
        self.send_payload::<D>(Priority::Event, payload);
    }

    /// A message by its payload, for those that the dialect's own encoder is not used for.
    pub(super) fn send_payload<D: MessageData>(&mut self, priority: Priority, payload: &[u8]) {
        self.send_bytes(priority, [D::ID, D::EXTRA_CRC.into()], payload);
    }

    /// A message by the words of its payload, little endian: for what comes by itself.
    pub(super) fn send_words<D: MessageData>(&mut self, priority: Priority, words: &[u32]) {
        self.send_frame(priority, [D::ID, D::EXTRA_CRC.into()], words);
    }

    fn send_bytes(&mut self, priority: Priority, kind: [u32; 2], payload: &[u8]) {
        let mut words = [0; LONGEST.div_ceil(4)];
        for (index, byte) in payload.iter().enumerate() {
            if let Some(word) = words.get_mut(index / 4) {
                *word |= u32::from(*byte) << (8 * (index % 4));
            }
        }
        self.send_frame(priority, kind, &words);
    }

    /// A frame with the payload `words`; `kind` is the message's number and CRC_EXTRA. A frame that
    /// is dropped uses up its sequence number, too.
    fn send_frame(&mut self, priority: Priority, kind: [u32; 2], words: &[u32]) {
        let [id, extra_crc] = kind;
        let sequence = u32::from(self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
        // The protocol leaves trailing zeros out, all but the first byte.
        let last = words.iter().rposition(|word| *word != 0).unwrap_or(0);
        let top = words.get(last).copied().unwrap_or(0);
        let len = 4 * last
            + 1
            + usize::from(top > 0xFF)
            + usize::from(top > 0xFFFF)
            + usize::from(top > 0xFF_FFFF);
        let Some([start, rest @ ..]) = self.queue.push(len + OVERHEAD, priority) else {
            return;
        };
        *start = mavlink::MAV_STX_V2;
        let addresses = u32::from(self.identity.system) | u32::from(COMPONENT_ID) << 8;
        let header = [len as u32 | sequence << 24, addresses | id << 16, id >> 16];
        let (header_place, rest) = rest.split_at_mut_checked(HEADER).unwrap_or_default();
        let (payload_place, end) = rest.split_at_mut_checked(len).unwrap_or_default();
        let checksum = Checksum::new().write(&header, header_place);
        let mut checksum = checksum.write(words, payload_place);
        checksum.add(extra_crc);
        for (place, byte) in end.iter_mut().zip(checksum.value().to_le_bytes()) {
            *place = byte;
        }
    }
}

/// A text as its first 50 bytes, zeros behind it.
pub(super) fn line(text: fmt::Arguments<'_>) -> [u8; 50] {
    let mut line = Line { bytes: [0; 50], len: 0 };
    // A line that is cut reports an error; what fits is kept.
    let _ = line.write_fmt(text);
    line.bytes
}

struct Line {
    bytes: [u8; 50],
    len: usize,
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            *self.bytes.get_mut(self.len).ok_or(fmt::Error)? = byte;
            self.len += 1;
        }
        Ok(())
    }
}
