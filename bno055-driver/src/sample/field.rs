//! Whether the magnetic field changes more often than the magnetometer measures.
//!
//! A magnetometer that is refreshed 20 or 30 times a second gives the same three words in several
//! bursts between two refreshes. A bit that flips on the wire changes a word and, in the next
//! burst, changes it back: twice between two refreshes, which tells even a flip of the last bit,
//! whatever the body does. The words of the other sensors change with every refresh, which comes
//! about as often as a burst: they cannot tell.
//!
//! How often the chip refreshes the field in the modes without fusion is not documented. So the
//! rule holds only once the changes have come slowly enough for some seconds.

use crate::transfer::Micros;

/// Two changes of a word that are certainly closer than this are not both refreshes, once those
/// are known to be slow.
const SOONEST_US: u64 = 28_000;
/// Changes that may be farther apart than this let a slow refresh be learnt, and closer ones begin
/// anew: at 30 Hz, the fastest that the chip can be set to, 33 ms lie between two.
const SLOW_US: u64 = 32_500;
/// After so many of them in a row the refresh is known to be slow: three in each of 32 refreshes.
const KNOWN: u8 = 96;
/// Bursts farther apart than this teach nothing: any refresh looks slow in them.
const DENSE_US: u64 = 11_000;

/// What is remembered of the field in earlier bursts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FieldChanges {
    /// The last burst that was judged.
    last: Option<(Micros, [i16; 3])>,
    /// Start of the last burst before each word's last change: the earliest moment of the change.
    before_change: [Option<Micros>; 3],
    /// Slow changes in a row, up to [`KNOWN`].
    slow: u8,
}

impl FieldChanges {
    /// Takes the field of a burst of `time` that is not believed for the sake of another word. If
    /// it is the last one, it has not changed up to here.
    pub(super) fn is_seen(&mut self, time: Micros, field: [i16; 3]) {
        if let Some((last_time, last)) = &mut self.last
            && *last == field
        {
            *last_time = time;
        }
    }

    /// Takes the field of a burst of `time`; whether a word has changed so soon after its change
    /// before that one of the two is an error of the wire.
    ///
    /// Each word is judged by itself, for a refresh may come between two words of a burst: the
    /// later ones are then new in this burst, the earlier ones in the next.
    pub(super) fn come_too_soon(&mut self, time: Micros, field: [i16; 3]) -> bool {
        let Some((before, last)) = self.last.replace((time, field)) else {
            return false;
        };
        if last == field {
            return false;
        }
        let was_known = self.slow >= KNOWN;
        let mut too_soon = false;
        let words = last.iter().zip(&field).zip(&mut self.before_change);
        for ((last, now), before_change) in words {
            if last == now {
                continue;
            }
            let Some(earliest) = before_change.replace(before) else {
                continue;
            };
            let at_most_us = time.since(earliest);
            too_soon |= at_most_us < SOONEST_US;
            if !was_known && time.since(before) <= DENSE_US {
                self.slow = if at_most_us < SLOW_US {
                    0
                } else {
                    self.slow.saturating_add(1)
                };
            }
        }
        was_known && too_soon
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BURST_US: u64 = 6_667;

    /// Feeds bursts from the first to the last microsecond of a field that is refreshed every
    /// `period_us`, with a bit flipped where `flips` says so; how many bursts were refused.
    fn refused(
        changes: &mut FieldChanges,
        (from_us, to_us): (u64, u64),
        period_us: u64,
        burst_us: u64,
        flips: impl Fn(u64) -> u16,
    ) -> usize {
        (from_us..to_us)
            .step_by(burst_us as usize)
            .enumerate()
            .filter(|&(number, time)| {
                let refreshes = (time / period_us) as i16;
                let mut field = [320 + 3 * refreshes, -90 + refreshes, 640 - 2 * refreshes];
                field[1] ^= flips(number as u64) as i16;
                changes.come_too_soon(Micros(time), field)
            })
            .count()
    }

    /// A judge that has seen three seconds of a field of 20 Hz.
    fn learnt() -> FieldChanges {
        let mut changes = FieldChanges::default();
        let seen = (0, 3_000_000);
        assert_eq!(refused(&mut changes, seen, 50_000, BURST_US, |_| 0), 0);
        changes
    }

    #[test]
    fn no_refresh_is_refused_at_any_rate_of_field_and_loop() {
        for burst_us in [5_000, 6_667, 8_000, 10_000, 14_000, 20_000, 40_000] {
            for hz in 1..=100 {
                let mut changes = FieldChanges::default();
                let seen = (0, 5_000_000);
                let refused = refused(&mut changes, seen, 1_000_000 / hz, burst_us, |_| 0);
                assert_eq!(refused, 0, "{hz} Hz read every {burst_us} us");
            }
        }
    }

    #[test]
    fn a_refresh_between_two_words_is_none() {
        let mut changes = learnt();
        let torn = [0, 1, 2].map(|tick: u64| {
            let mut field = [320 + 3 * 60, -90 + 60, 640 - 2 * 60];
            if tick == 0 {
                field[..2].copy_from_slice(&[320 + 3 * 59, -90 + 59]);
            }
            changes.come_too_soon(Micros(3_040_000 + tick * BURST_US), field)
        });
        assert_eq!(torn, [false; 3]);
    }

    #[test]
    fn the_smallest_flip_is_noticed_when_it_goes() {
        let mut changes = learnt();
        // 33 ms behind a refresh; the burst behind it changes back.
        let end = (3_000_000, 3_045_000);
        let flip = |number| u16::from(number == 5);
        assert_eq!(refused(&mut changes, end, 50_000, BURST_US, flip), 1);
        // A bus that flips a bit in every other burst is refused in nearly all of them.
        let mut changes = learnt();
        let end = (3_000_000, 3_200_000);
        let flip = |number| u16::from(number % 2 == 0) << 7;
        assert!(refused(&mut changes, end, 50_000, BURST_US, flip) >= 28);
    }

    #[test]
    fn nothing_is_refused_before_the_refresh_is_known_to_be_slow() {
        let mut changes = FieldChanges::default();
        let begin = (0, 300_000);
        let flip = |number| u16::from(number % 2 == 0) << 7;
        assert_eq!(refused(&mut changes, begin, 50_000, BURST_US, flip), 0);
    }

    #[test]
    fn a_change_that_came_in_a_gap_is_counted_from_its_earliest_moment() {
        let mut changes = learnt();
        // The refreshes of 3.00 and 3.05 s are seen 5 ms before and after a gap of 46 ms.
        let times = [(3_005_000, 60), (3_051_000, 61), (3_101_000, 62)];
        let refused = times.map(|(time, refreshes)| {
            let field = [320 + 3 * refreshes, -90 + refreshes, 640 - 2 * refreshes];
            changes.come_too_soon(Micros(time), field)
        });
        assert_eq!(refused, [false; 3]);
    }
}
