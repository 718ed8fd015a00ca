//! What the flight remembers, once a second: V2_EXTENSION in parts.

use heapless::Vec;
use mavlink::dialects::common::V2_EXTENSION_DATA;

use super::queue::Priority;
use super::{OVERHEAD, Telemetry};
use crate::flight::{Flight, Snapshot};
use tvc_imu::Refresh;

/// `message_type` of the first part; each further one has the next. The protocol leaves numbers
/// from here on to everybody.
pub const MEMORY_TYPE: u16 = 0x8000;

/// Words in a part, but for the last.
pub const PART_WORDS: usize = 21;

/// All words: first the time of the step that they follow, us, as SERVO_OUTPUT_RAW has it, last
/// what is known of the sensor's refresh.
pub const WORDS: usize = 1 + Flight::WORDS + Refresh::WORDS;

/// The message's own fields: its type, and an address that means everybody.
const HEAD: usize = 5;
const PAYLOAD: usize = HEAD + 4 * PART_WORDS;
/// Bytes of all parts as frames.
const FRAMES: usize = WORDS.div_ceil(PART_WORDS) * (OVERHEAD + HEAD) + 4 * WORDS;

/// A part as far as it is filled.
struct Part {
    number: u16,
    payload: Vec<u8, PAYLOAD>,
}

impl Part {
    fn new(number: u16) -> Self {
        let mut payload = Vec::new();
        let [low, high] = (MEMORY_TYPE + number).to_le_bytes();
        // There is room for all that is written to a part.
        let _ = payload.extend_from_slice(&[low, high, 0, 0, 0]);
        Self { number, payload }
    }
}

impl Telemetry {
    /// Sends what the flight remembers after this step, if that is due and there is room for all of
    /// it.
    // Inlined it would cost the loop its registers.
    #[inline(never)]
    pub fn tell_memory(&mut self, snapshot: &Snapshot, flight: &Flight, refresh: &Refresh) {
        let is_whole = snapshot.sample.is_some() && snapshot.state.is_past_start_up();
        if !(self.memory_due && is_whole && self.queue.has_room(FRAMES, Priority::Stream)) {
            return;
        }
        self.memory_due = false;
        let mut part = Part::new(0);
        self.tell_word(&mut part, snapshot.now.0 as i32);
        flight.tell(&mut |word| self.tell_word(&mut part, word));
        for word in refresh.words() {
            self.tell_word(&mut part, *word as i32);
        }
        if part.payload.len() > HEAD {
            self.send_payload::<V2_EXTENSION_DATA>(Priority::Stream, &part.payload);
        }
    }

    fn tell_word(&mut self, part: &mut Part, word: i32) {
        let _ = part.payload.extend_from_slice(&word.to_le_bytes());
        if part.payload.is_full() {
            self.send_payload::<V2_EXTENSION_DATA>(Priority::Stream, &part.payload);
            *part = Part::new(part.number + 1);
        }
    }
}
