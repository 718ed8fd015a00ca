//! Bytes that wait for the host: whole frames in, any number of bytes out.

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
///
/// Aligned for the port, which copies it by words.
#[derive(Clone, Debug)]
#[repr(align(4))]
pub(super) struct Queue {
    bytes: [u8; QUEUE_BYTES],
    /// Bytes at the front that the host has already taken.
    sent: usize,
    /// Where the next frame goes.
    end: usize,
    dropped: u32,
}

impl Queue {
    pub(super) const fn new() -> Self {
        Self { bytes: [0; QUEUE_BYTES], sent: 0, end: 0, dropped: 0 }
    }

    /// As new, in place.
    pub(super) fn restart(&mut self) {
        (self.sent, self.end, self.dropped) = (0, 0, 0);
    }

    /// The place of the next frame, which is to be written there and may be sent from now on; or
    /// `None`, and the frame is counted as dropped.
    pub(super) fn push(&mut self, len: usize, priority: Priority) -> Option<&mut [u8]> {
        if !self.has_room(len, priority) {
            self.dropped = self.dropped.wrapping_add(1);
            return None;
        }
        if self.end + len > QUEUE_BYTES {
            self.compact();
        }
        let place = self.bytes.get_mut(self.end..self.end + len)?;
        self.end += len;
        Some(place)
    }

    /// Whether a frame of this length would be taken.
    pub(super) fn has_room(&self, len: usize, priority: Priority) -> bool {
        let reserve = match priority {
            Priority::Stream => QUEUE_RESERVE_BYTES,
            Priority::Event => 0,
        };
        self.end - self.sent + len + reserve <= QUEUE_BYTES
    }

    /// Everything that waits, oldest first.
    pub(super) fn pending(&self) -> &[u8] {
        self.bytes.get(self.sent..self.end).unwrap_or_default()
    }

    /// The host has taken the first `count` bytes of [`Queue::pending`], frame boundary or not.
    /// They are cleared: should a flipped bit make them pending again, no old state is told anew.
    pub(super) fn sent(&mut self, count: usize) {
        let first = self.sent;
        self.sent = (first + count).min(self.end);
        if let Some(taken) = self.bytes.get_mut(first..self.sent) {
            taken.fill(0);
        }
        if self.sent == self.end {
            (self.sent, self.end) = (0, 0);
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
        let mut rest = self.bytes.get_mut(..self.end).unwrap_or_default();
        while let Some((free, tail)) = rest.split_at_mut_checked(gap)
            && !(free.is_empty() || tail.is_empty())
        {
            for (to, from) in free.iter_mut().zip(&*tail) {
                *to = *from;
            }
            rest = tail;
        }
        (self.sent, self.end) = (0, self.end - gap);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_full_queue_drops_whole_frames_and_counts_them() {
        let mut queue = Queue::new();
        while queue.push(100, Priority::Stream).is_some() {}
        assert_eq!(queue.pending().len(), 1500);
        assert_eq!(queue.dropped(), 1);
        assert!(queue.push(100, Priority::Event).is_some(), "the reserve is for events");
        while queue.push(100, Priority::Event).is_some() {}
        assert_eq!(queue.pending().len(), 2000);
        assert_eq!(queue.dropped(), 2);
    }

    #[test]
    fn what_the_host_has_taken_is_gone() {
        let mut queue = Queue::new();
        queue.push(6, Priority::Event).unwrap().fill(7);
        queue.sent(4);
        queue.sent = 0;
        assert_eq!(queue.pending(), [0, 0, 0, 0, 7, 7]);
    }

    #[test]
    fn taking_more_than_there_is_empties_the_queue() {
        let mut queue = Queue::new();
        queue.push(3, Priority::Event);
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
                if let Some(place) = queue.push(len, priority) {
                    place.copy_from_slice(&frame);
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
