//! Frames on their way into the queue.

use core::fmt::{self, Write};

use heapless::Vec;
use mavlink::MessageData;
use mavlink::dialects::common::{MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

use super::checksum::checksum;
use super::queue::Priority;
use super::{MAX_FRAME, MAX_PAYLOAD, Telemetry};
use crate::config::COMPONENT_ID;

impl Telemetry {
    /// A STATUSTEXT, cut to the 50 characters that STATUSTEXT holds.
    pub(super) fn status_text(&mut self, severity: MavSeverity, text: fmt::Arguments<'_>) {
        self.send_event(&STATUSTEXT_DATA {
            severity,
            text: CharArray::new(line(text)),
        });
    }

    /// A warning in words: a STATUSTEXT.
    pub(super) fn warn(&mut self, text: fmt::Arguments<'_>) {
        self.status_text(MavSeverity::MAV_SEVERITY_WARNING, text);
    }

    pub(super) fn send_event<D: MessageData>(&mut self, data: &D) {
        self.send(Priority::Event, data);
    }

    pub(super) fn send_stream<D: MessageData>(&mut self, data: &D) {
        self.send(Priority::Stream, data);
    }

    pub(super) fn send<D: MessageData>(&mut self, priority: Priority, data: &D) {
        let mut payload = [0; MAX_PAYLOAD];
        let len = data.ser(mavlink::MavlinkVersion::V2, &mut payload);
        let payload = payload.get(..len).unwrap_or_default();
        self.send_payload::<D>(priority, payload);
    }

    /// A message by its payload, for those that the dialect's own encoder is not used for.
    pub(super) fn send_payload<D: MessageData>(&mut self, priority: Priority, payload: &[u8]) {
        self.send_frame(priority, D::ID, D::EXTRA_CRC, payload);
    }

    fn send_frame(&mut self, priority: Priority, id: u32, extra_crc: u8, payload: &[u8]) {
        let [id0, id1, id2, _] = id.to_le_bytes();
        // The protocol leaves trailing zeros out, all but the first byte.
        let len = payload.iter().rposition(|byte| *byte != 0).unwrap_or(0) + 1;
        let payload = payload.get(..len).unwrap_or_default();
        let header = [
            mavlink::MAV_STX_V2,
            payload.len() as u8,
            0,
            0,
            self.sequence,
            self.identity.system,
            COMPONENT_ID,
            id0,
            id1,
            id2,
        ];
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame: Vec<u8, MAX_FRAME> = Vec::new();
        let filled =
            frame.extend_from_slice(&header).is_ok() && frame.extend_from_slice(payload).is_ok();
        let summed = frame.get(1..).unwrap_or_default();
        let crc = checksum(summed, extra_crc).to_le_bytes();
        if filled && frame.extend_from_slice(&crc).is_ok() {
            self.queue.push(&frame, priority);
        }
    }
}

/// A text as its first 50 bytes, zeros behind it.
pub(super) fn line(text: fmt::Arguments<'_>) -> [u8; 50] {
    let mut line = Line {
        bytes: [0; 50],
        len: 0,
    };
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
