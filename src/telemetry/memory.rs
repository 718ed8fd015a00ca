//! What the flight remembers, once a second: V2_EXTENSION in parts, one a step.

use heapless::Vec;
use mavlink::dialects::common::V2_EXTENSION_DATA;

use super::queue::Priority;
use super::{MAX_FRAME, OVERHEAD, Telemetry};
use crate::flight::{Flight, Snapshot};

/// `message_type` of the first part; each further one has the next. The protocol leaves numbers
/// from here on to everybody.
pub const MEMORY_TYPE: u16 = 0x8000;

/// Words in a part, but for the last.
pub const PART_WORDS: usize = 21;

/// All words: first the time of the step that they follow, us, as SERVO_OUTPUT_RAW has it.
pub const WORDS: usize = 1 + Flight::MEMORY_WORDS;

/// The message's own fields: its type, and an address that means everybody.
const HEAD: usize = 5;
const PAYLOAD: usize = HEAD + 4 * PART_WORDS;

const _: () = assert!(OVERHEAD + PAYLOAD <= MAX_FRAME);

/// What the host is told.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    words: Vec<i32, WORDS>,
    /// The next part, `None` if all have been sent.
    part: Option<u16>,
}

impl Memory {
    pub(super) const fn new() -> Self {
        Self {
            words: Vec::new(),
            part: None,
        }
    }

    /// Nothing is under way any more.
    pub(super) fn end(&mut self) {
        self.part = None;
    }

    // Not inlined: it is called from many places.
    #[inline(never)]
    fn push(&mut self, word: i32) {
        // There is room for all of them.
        let _ = self.words.push(word);
    }
}

impl Telemetry {
    /// Notes what the flight remembers after this step, if that is due, and else sends a part of
    /// it, if there is room.
    // Inlined it would cost the loop its registers.
    #[inline(never)]
    pub fn tell_memory(&mut self, snapshot: &Snapshot, flight: &mut Flight) {
        if let Some(part) = self.memory.part {
            return self.send_part(part);
        }
        if self.memory_due && snapshot.sample.is_some() && snapshot.state.is_past_start_up() {
            self.memory_due = false;
            self.memory.words.clear();
            self.memory.part = Some(0);
            self.memory.push(snapshot.now.0 as i32);
            flight.memory(&mut |word| {
                self.memory.push(word);
                word
            });
        }
    }

    fn send_part(&mut self, part: u16) {
        if !self.queue.has_room(OVERHEAD + PAYLOAD, Priority::Stream) {
            return;
        }
        let mut parts = self.memory.words.chunks(PART_WORDS).skip(part.into());
        let mut payload: Vec<u8, PAYLOAD> = Vec::new();
        let [low, high] = (MEMORY_TYPE + part).to_le_bytes();
        // There is room for all of it.
        let _ = payload.extend_from_slice(&[low, high, 0, 0, 0]);
        for word in parts.next().unwrap_or_default() {
            let _ = payload.extend_from_slice(&word.to_le_bytes());
        }
        self.memory.part = parts.next().map(|_| part + 1);
        self.send_payload::<V2_EXTENSION_DATA>(Priority::Stream, &payload);
    }
}
