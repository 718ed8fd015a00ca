//! Bytes that wait for the host: whole frames in, any number of bytes out.

use heapless::Vec;

use crate::config::{QUEUE_BYTES, QUEUE_RESERVE_BYTES};

/// How much a frame matters when the queue is nearly full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Priority {
    /// Comes again next step: leaves the reserve free.
    Stream,
    /// An answer or an event: may use the reserve.
    Event,
}

/// A queue that never blocks. A frame is taken whole or dropped whole, and drops are counted.
#[derive(Clone, Debug)]
pub(super) struct Queue {
    bytes: Vec<u8, QUEUE_BYTES>,
    /// Bytes at the front that the host has already taken.
    sent: usize,
    dropped: u32,
}

impl Queue {
    pub(super) const fn new() -> Self {
        Self {
            bytes: Vec::new(),
            sent: 0,
            dropped: 0,
        }
    }

    /// As new, in place.
    pub(super) fn restart(&mut self) {
        self.bytes.clear();
        (self.sent, self.dropped) = (0, 0);
    }

    /// Append a frame, or drop and count it. Says whether it was taken.
    pub(super) fn push(&mut self, frame: &[u8], priority: Priority) -> bool {
        if !self.has_room(frame.len(), priority) {
            self.dropped = self.dropped.wrapping_add(1);
            return false;
        }
        if self.bytes.len() + frame.len() > QUEUE_BYTES {
            self.compact();
        }
        self.bytes.extend_from_slice(frame).is_ok()
    }

    /// Whether a frame of this length would be taken.
    pub(super) fn has_room(&self, len: usize, priority: Priority) -> bool {
        let reserve = match priority {
            Priority::Stream => QUEUE_RESERVE_BYTES,
            Priority::Event => 0,
        };
        self.pending().len() + len + reserve <= QUEUE_BYTES
    }

    /// Everything that waits, oldest first.
    pub(super) fn pending(&self) -> &[u8] {
        self.bytes.get(self.sent..).unwrap_or_default()
    }

    /// The host has taken the first `count` bytes of [`Queue::pending`], frame boundary or not.
    pub(super) fn sent(&mut self, count: usize) {
        self.sent = (self.sent + count).min(self.bytes.len());
        if self.sent == self.bytes.len() {
            self.bytes.clear();
            self.sent = 0;
        }
    }

    /// Frames dropped since start-up.
    pub(super) fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Move what waits to the front. Happens only when the host lags, once in about
    /// [`QUEUE_BYTES`].
    ///
    /// In blocks no longer than the way they go, which do not overlap themselves: the general
    /// `memmove` takes 1.3 KB.
    fn compact(&mut self) {
        let gap = self.sent;
        let waiting = self.pending().len();
        let mut rest = self.bytes.as_mut_slice();
        while let Some((free, tail)) = rest.split_at_mut_checked(gap)
            && !(free.is_empty() || tail.is_empty())
        {
            for (to, from) in free.iter_mut().zip(&*tail) {
                *to = *from;
            }
            rest = tail;
        }
        self.bytes.truncate(waiting);
        self.sent = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_full_queue_drops_whole_frames_and_counts_them() {
        let mut queue = Queue::new();
        let frame = [7; 100];
        while queue.push(&frame, Priority::Stream) {}
        assert_eq!(queue.pending().len(), 1500);
        assert_eq!(queue.dropped(), 1);
        assert!(
            queue.push(&frame, Priority::Event),
            "the reserve is for events"
        );
        while queue.push(&frame, Priority::Event) {}
        assert_eq!(queue.pending().len(), 2000);
        assert_eq!(queue.dropped(), 2);
    }

    #[test]
    fn taking_more_than_there_is_empties_the_queue() {
        let mut queue = Queue::new();
        queue.push(&[1, 2, 3], Priority::Event);
        queue.sent(10);
        assert!(queue.pending().is_empty());
    }

    proptest! {
        /// Whatever the host takes and when, it sees the accepted frames, in order and unbroken.
        #[test]
        fn the_host_sees_exactly_the_frames_that_were_taken(
            steps in prop::collection::vec((1_usize..120, 0_usize..300, any::<bool>()), 1..400)
        ) {
            let mut queue = Queue::new();
            let (mut accepted, mut seen) = (std::vec::Vec::new(), std::vec::Vec::new());
            for (index, (len, take, event)) in steps.into_iter().enumerate() {
                let frame = std::vec![index as u8; len];
                let priority = if event { Priority::Event } else { Priority::Stream };
                if queue.push(&frame, priority) {
                    accepted.extend_from_slice(&frame);
                }
                let take = take.min(queue.pending().len());
                seen.extend_from_slice(&queue.pending()[..take]);
                queue.sent(take);
            }
            seen.extend_from_slice(queue.pending());
            prop_assert_eq!(seen, accepted);
        }
    }
}
