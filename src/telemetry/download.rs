//! What the recorder holds, on request: MAVLink's log protocol with at most one log, number 0.

use mavlink::dialects::common::{LOG_DATA_DATA, LOG_ENTRY_DATA, LOG_REQUEST_DATA_DATA};

use super::queue::Priority;
use super::{OVERHEAD, Telemetry};
use crate::recorder::Recorder;

/// Bytes of a log in one LOG_DATA.
const PART: usize = 90;
const PAYLOAD: usize = LOG_DATA_DATA::ENCODED_LEN;

/// What the host has asked for and has not got yet.
#[derive(Clone, Debug)]
pub(super) struct Download {
    list: bool,
    /// From this byte to that one.
    range: Option<(usize, usize)>,
}

impl Download {
    pub(super) const fn new() -> Self {
        Self { list: false, range: None }
    }
}

impl Telemetry {
    pub(super) fn order_log_list(&mut self) {
        self.download.list = true;
    }

    pub(super) fn order_log_data(&mut self, request: &LOG_REQUEST_DATA_DATA) {
        if request.id == 0 {
            let from = request.ofs as usize;
            self.download.range = Some((from, from.saturating_add(request.count as usize)));
        }
    }

    pub(super) fn end_log_data(&mut self) {
        self.download.range = None;
    }

    /// Send a part of what the host has asked for, if there is room for it.
    pub fn serve_recorder(&mut self, recorder: &Recorder) {
        if core::mem::take(&mut self.download.list) {
            // Time, size, number, how many there are, the last one's number.
            let [a, b, c, d] = (recorder.len() as u32).to_le_bytes();
            let logs = u8::from(!recorder.is_empty());
            let entry = [0, 0, 0, 0, a, b, c, d, 0, 0, logs];
            self.send_payload::<LOG_ENTRY_DATA>(Priority::Event, &entry);
        }
        let Some((from, to)) = self.download.range else {
            return;
        };
        if !self.queue.has_room(OVERHEAD + PAYLOAD, Priority::Stream) {
            return;
        }
        let mut payload = [0; PAYLOAD];
        // Offset, number, count, data.
        let (offset, rest) = payload.split_at_mut(4);
        let (head, data) = rest.split_at_mut(3);
        offset.copy_from_slice(&(from as u32).to_le_bytes());
        let most = to.saturating_sub(from).min(PART);
        let count = recorder.read(from, data.get_mut(..most).unwrap_or_default());
        head.copy_from_slice(&[0, 0, count as u8]);
        self.send_payload::<LOG_DATA_DATA>(Priority::Stream, &payload);
        let next = from + count;
        self.download.range = (count == PART && next < to).then_some((next, to));
    }
}
