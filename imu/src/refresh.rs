//! New parts of a reading, and the sensor's refresh rate.
//!
//! Sensors such as the BNO055 refresh their registers by a clock of their own. A reading shows only
//! whether its counts are new. From that follow the age of the rates and the period:
//!
//! - New rates were refreshed since the reading before, a whole number of periods after the last
//!   new rates. All readings together leave an interval for the age, and its middle is the
//!   estimate. If the loop reads three times in two periods, the interval is some 3 ms wide, and
//!   much less when the two clocks have shifted.
//! - The period is the time of many new readings over their number. Each rate counts for one
//!   period, however often it was read. With the time between two readings instead, a turn from 0.8
//!   rad would end up to 8 mrad off.
//!
//! A burst takes longer than a millisecond for the three rates, and a refresh may come between two
//! of them. Then the last rates are new in this burst and the first rates in the next. The second
//! rate decides. A first rate that is a refresh older is replaced by what the two refreshes before
//! let expect: taken for new, it makes a vehicle brake 10 ms late.
//!
//! A sensor that refreshes faster than it is read needs none of this: its rates are half a period
//! old on average, and cover the time since the last new reading.
//!
//! A magnetometer is slower than the loop, and its words repeat until it has measured again.

use bytemuck::{Pod, Zeroable};

use crate::sample::{NewRates, RawSample, Sample};

/// Period of the refresh until it is known, us.
const PERIOD_US: u32 = 10_000;

/// Shortest and longest time between two new readings, us: the fastest loop's samples; and, with a
/// reserve, two refreshes of the slowest sensor (28.6 ms), of which the first repeats its counts.
const SHORTEST_US: u32 = 5_000;
const LONGEST_US: u32 = 61_000;

/// log2 of the periods of the first mean, and of the periods after which the count begins anew. A
/// mean of n is exact to 1/n.
const FIRST: u32 = 6;
const LAST: u32 = 12;

/// Error of the first mean, as a power of a half: one reading in 23 of a quiet gyroscope repeats
/// its counts.
const ROUGH: u32 = 4;

/// Change of a rate from one refresh to the next that is more than noise, counts.
const LEAST_CHANGE: i32 = 6;

/// An unchanged field counts as measured again after this time, us: the period of a magnetometer at
/// 10 Hz.
const FIELD_REPEAT_US: u32 = 100_000;

/// Longest counted time between two readings, us.
const GAP_US: u64 = 500_000;

/// Finds the new parts in the readings of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refresh {
    last: Option<RawSample>,
    state: State,
}

/// State of the refresh: plain words, and flags as 0 or 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct State {
    /// Bounds of the age by the readings so far, us.
    least_us: u32,
    most_us: u32,
    /// Time since the newest new reading, us; more than [`LONGEST_US`] while counts stay the same.
    since_new_us: u32,
    period_us: u32,
    /// Relative error of the period, as a power of a half; 0 while the period is unknown.
    share: u32,
    /// Periods that have been counted for the next mean, and their time, us.
    counted: u32,
    counted_us: u32,
    /// The reading before was new.
    was_new: u32,
    /// Time since the field was new, us, up to [`FIELD_REPEAT_US`].
    field_age_us: u32,
    /// The sensor refreshes faster than it is read.
    is_faster: u32,
    /// The first rate of the newest refresh and of the one before, counts.
    first: [i32; 2],
}

impl Default for State {
    /// Nothing read yet.
    fn default() -> Self {
        Self { most_us: PERIOD_US, period_us: PERIOD_US, ..Self::zeroed() }
    }
}

impl Refresh {
    /// Words of [`Refresh::words`].
    pub const WORDS: usize = size_of::<State>() / 4;

    /// For a sensor with this period, us. One below the fastest loop's is never looked for.
    #[must_use]
    pub fn with_period(period_us: u32) -> Self {
        let is_faster = u32::from(period_us < SHORTEST_US);
        let period_us = period_us.clamp(1, LONGEST_US);
        Self { last: None, state: State { period_us, is_faster, ..State::default() } }
    }

    /// Takes the next reading.
    pub fn read(&mut self, raw: RawSample) -> Sample {
        let (dt_us, differ, is_other) = match self.last.replace(raw) {
            None => (self.state.period_us, [true; 3], true),
            Some(last) => {
                let ([x, y, z], [new_x, new_y, new_z]) = (last.gyr, raw.gyr);
                let dt_us = raw.time.since(last.time).min(GAP_US) as u32;
                let differ = [x != new_x, y != new_y, z != new_z];
                (dt_us, differ, last.mag != raw.mag)
            }
        };
        let rates = self.state.look(dt_us, differ);
        let [x, y, z] = raw.gyr;
        Sample {
            raw,
            gyr: [self.state.first(x, differ, rates.is_some()), y, z],
            rates,
            refresh_us: self.state.period_us,
            is_field_new: self.state.has_new_field(dt_us, is_other) && raw.mag != [0; 3],
        }
    }

    /// The state for judging the next readings, without the newest reading.
    #[must_use]
    pub fn words(&self) -> &[u32] {
        bytemuck::cast_slice(core::slice::from_ref(&self.state))
    }

    /// Goes on from this reading and the [words](Self::words) of another `Refresh`; `None` if no
    /// `Refresh` has such words.
    #[must_use]
    pub fn resumed(raw: RawSample, words: &[u32]) -> Option<Self> {
        let state: State = *bytemuck::try_from_bytes(bytemuck::cast_slice(words)).ok()?;
        state.is_possible().then_some(Self { last: Some(raw), state })
    }
}

impl State {
    fn is_possible(&self) -> bool {
        self.least_us <= 4 * LONGEST_US
            && self.most_us <= 4 * LONGEST_US
            && self.since_new_us <= LONGEST_US + 1
            && match self.is_faster {
                0 => (SHORTEST_US..=LONGEST_US).contains(&self.period_us),
                1 => (1..SHORTEST_US).contains(&self.period_us),
                _ => false,
            }
            && self.share <= LAST
            && self.counted <= 1 << LAST
            && self.counted_us <= LONGEST_US << LAST
            && self.field_age_us <= FIELD_REPEAT_US
            && self.first.iter().all(|rate| i16::try_from(*rate).is_ok())
    }

    /// Whether a field `dt_us` after the field before is new. A field that stays the same for long
    /// counts as new.
    fn has_new_field(&mut self, dt_us: u32, differs: bool) -> bool {
        self.field_age_us = (self.field_age_us + dt_us).min(FIELD_REPEAT_US);
        let is_new = differs || self.field_age_us == FIELD_REPEAT_US;
        if is_new {
            self.field_age_us = 0;
        }
        is_new
    }

    /// A reading `dt_us` after the reading before. `differ` tells which rates have other counts, in
    /// the order of reading. A new rate with equal counts passes for a repeated rate; the next rate
    /// corrects that. If counts stay the same for long, as of a sensor without noise, every reading
    /// is new.
    fn look(&mut self, dt_us: u32, differ: [bool; 3]) -> Option<NewRates> {
        let [first, second, third] = differ;
        // After a new reading, a change of the first rate alone belongs to that reading's refresh.
        let differs = second || first && (third || self.was_new == 0);
        self.was_new = differs.into();
        let was_still = self.since_new_us > LONGEST_US;
        let since_new_us = self.since_new_us + dt_us;
        if self.is_faster != 0 {
            self.since_new_us = if differs { 0 } else { since_new_us.min(LONGEST_US + 1) };
            let is_new = differs || was_still || since_new_us > LONGEST_US;
            return is_new.then_some(NewRates {
                age_us: self.period_us / 2,
                elapsed_us: if was_still { dt_us } else { since_new_us },
            });
        }
        // With one reading a refresh, as on a slow bus or after a missed reading, one period looks
        // like two.
        let is_seldom = dt_us > self.period_us * 3 / 4;
        if is_seldom && !was_still && since_new_us <= LONGEST_US {
            *self = Self {
                period_us: self.period_us,
                share: self.share,
                was_new: 1,
                field_age_us: self.field_age_us,
                ..Self::default()
            };
            return Some(NewRates {
                age_us: dt_us.min(self.period_us) / 2,
                elapsed_us: since_new_us,
            });
        }
        if was_still || since_new_us > LONGEST_US {
            // The number of periods since then is unknown.
            *self = Self {
                since_new_us: if differs { 0 } else { LONGEST_US + 1 },
                period_us: self.period_us,
                share: self.share,
                was_new: differs.into(),
                field_age_us: self.field_age_us,
                ..Self::default()
            };
            return Some(NewRates {
                age_us: dt_us.min(self.period_us) / 2,
                elapsed_us: if was_still { dt_us } else { since_new_us },
            });
        }
        self.since_new_us = since_new_us;
        let slack_us = dt_us >> self.share.max(ROUGH);
        self.least_us += dt_us - slack_us;
        self.most_us += dt_us + slack_us;
        if !differs {
            return None;
        }
        let (periods, elapsed_us) = self.passed(dt_us);
        self.narrow(periods * self.period_us, dt_us);
        self.learn(periods);
        self.since_new_us = 0;
        Some(NewRates { age_us: (self.least_us + self.most_us) / 2, elapsed_us })
    }

    /// The first rate at the refresh of the second. It is a refresh older where it repeats, the
    /// second does not, and it changed faster than by noise before.
    fn first(&mut self, read: i16, differ: [bool; 3], is_new: bool) -> i16 {
        let [newest, before] = self.first;
        let change = newest - before;
        let [first_differs, second_differs, _] = differ;
        let is_older = is_new && second_differs && !first_differs && change.abs() > LEAST_CHANGE;
        let first = i32::from(read) + if is_older { change } else { 0 };
        let first = first.clamp(i16::MIN.into(), i16::MAX.into());
        // A repeated reading may show the first rate that the reading before lacked.
        self.first = [first, if is_new { newest } else { before }];
        first as i16
    }

    /// Number of periods between the newest new reading and this one, `dt_us` after the reading
    /// before, and their time, us. Each new reading may be up to `dt_us` old. The fewest possible
    /// periods count, because new counts are seldom equal.
    fn passed(&self, dt_us: u32) -> (u32, u32) {
        if self.share == 0 {
            return (1, self.since_new_us);
        }
        let (mut periods, mut elapsed_us) = (1, self.period_us);
        while elapsed_us + dt_us + self.period_us / 32 < self.since_new_us {
            (periods, elapsed_us) = (periods + 1, elapsed_us + self.period_us);
        }
        (periods, elapsed_us)
    }

    /// The refresh comes `later_us` after the last one, and this reading at most `dt_us` after the
    /// refresh.
    fn narrow(&mut self, later_us: u32, dt_us: u32) {
        let oldest_us = dt_us.min(self.period_us);
        self.least_us = self.least_us.saturating_sub(later_us);
        self.most_us = self.most_us.saturating_sub(later_us).min(oldest_us);
        if self.least_us >= self.most_us {
            // The estimate of the sensor's clock is wrong: takes the bounds of this reading alone.
            (self.least_us, self.most_us) = (0, oldest_us);
        }
    }

    /// The mean of more and more periods.
    fn learn(&mut self, periods: u32) {
        self.counted += periods;
        self.counted_us += self.since_new_us;
        let counted = self.counted.max(1);
        let bits = counted.ilog2();
        let is_next = bits > (self.counted - periods).max(1).ilog2();
        if is_next && bits >= self.share.max(FIRST) {
            let mean_us = (self.counted_us + counted / 2) / counted;
            self.period_us = mean_us.clamp(SHORTEST_US, LONGEST_US);
            if self.share == 0 {
                // Each new reading has counted as one period, though some are two.
                self.share = ROUGH;
                (self.counted, self.counted_us) = (0, 0);
            } else {
                self.share = bits;
            }
        }
        if self.counted >= 1 << LAST {
            (self.counted, self.counted_us) = (0, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Micros;
    use proptest::prelude::*;
    use proptest::test_runner::{RngAlgorithm, TestRng};
    use std::vec::Vec;

    const NEW: [bool; 3] = [true; 3];
    const SAME: [bool; 3] = [false; 3];

    #[test]
    fn a_sensor_faster_than_the_loop_has_rates_of_half_a_period() {
        let mut refresh = Refresh::with_period(1_200);
        let mut read = |us: u64, gyr: i16| {
            let raw = RawSample { time: Micros(us), gyr: [gyr; 3], ..RawSample::default() };
            refresh.read(raw).rates.map(|rates| (rates.age_us, rates.elapsed_us))
        };
        assert_eq!(read(0, 1), Some((600, 1_200)));
        assert_eq!(read(6_667, 2), Some((600, 6_667)));
        assert_eq!(read(13_333, 2), None);
        assert_eq!(read(20_000, 3), Some((600, 13_333)));
        let words: Vec<u32> = refresh.words().to_vec();
        let same = Refresh::resumed(refresh.last.unwrap(), &words).unwrap();
        assert_eq!(same, refresh);
        assert_eq!(Refresh::with_period(9_615).state.period_us, 9_615);
    }

    fn age_us(refreshed: Option<NewRates>) -> Option<u32> {
        refreshed.map(|refreshed| refreshed.age_us)
    }

    /// By hand, read every 6 ms. New at 6: the age is 0 to 6 ms. Repeated at 12. New at 18: the age
    /// is 2 to 8 ms, 12 ms and a period later, and at most 6.
    #[test]
    fn new_readings_narrow_the_age() {
        let mut refresh = State::default();
        assert_eq!(age_us(refresh.look(6_000, NEW)), Some(3_000));
        assert_eq!(refresh.look(6_000, SAME), None);
        let slack_us = 2 * (6_000 >> ROUGH);
        assert_eq!(age_us(refresh.look(6_000, NEW)), Some((2_000 - slack_us + 6_000) / 2));
    }

    #[test]
    fn a_gap_counts_as_long_as_it_is() {
        let mut refresh = State::default();
        refresh.look(6_000, NEW);
        refresh.look(6_000, SAME);
        let expected = NewRates { age_us: 5_000, elapsed_us: 506_000 };
        assert_eq!(refresh.look(500_000, NEW), Some(expected));
    }

    /// A sensor without noise repeats its counts until it turns.
    #[test]
    fn counts_that_stay_are_new_after_60_ms() {
        let mut refresh = State::default();
        let elapsed: Vec<_> = (0..14)
            .map(|reading| refresh.look(6_667, [reading > 11; 3]))
            .map(|refreshed| refreshed.map_or(0, |refreshed| refreshed.elapsed_us))
            .collect();
        let each = 6_667;
        assert_eq!(elapsed[..9], [0; 9]);
        assert_eq!(elapsed[9..], [10 * each, each, each, each, each]);
    }

    /// By hand: if the third rate alone changes, the second is still old; if the first alone
    /// changes, the second was new in the reading before.
    #[test]
    fn a_refresh_in_the_midst_of_a_burst_counts_once() {
        let is_new = |refresh: &mut State, differ| refresh.look(6_667, differ).is_some();
        let mut refresh = State::default();
        assert!(is_new(&mut refresh, NEW));
        assert!(!is_new(&mut refresh, [false, false, true]));
        assert!(is_new(&mut refresh, [true, true, false]));
        assert!(!is_new(&mut refresh, SAME));
        assert!(is_new(&mut refresh, [false, true, true]));
        assert!(!is_new(&mut refresh, [true, false, false]));
        // After a repeated reading, a change of the first rate means that the second is equal by
        // chance.
        assert!(is_new(&mut refresh, [true, false, false]));
    }

    /// The first rate rises by 40 counts a refresh; the third refresh comes behind its reading. In
    /// rest the change is noise, and in a repeated reading the rate is what was read.
    #[test]
    fn a_first_rate_that_is_a_refresh_older_is_carried_on() {
        let mut refresh = Refresh::with_period(10_000);
        let mut read = |us: u64, gyr: [i16; 3]| {
            let raw = RawSample { time: Micros(us), gyr, ..RawSample::default() };
            refresh.read(raw).gyr
        };
        assert_eq!(read(6_000, [60, 0, 0]), [60, 0, 0]);
        assert_eq!(read(12_000, [100, 1, 1]), [100, 1, 1]);
        assert_eq!(read(18_000, [100, 1, 1]), [100, 1, 1]);
        assert_eq!(read(24_000, [100, 2, 2]), [140, 2, 2]);
        assert_eq!(read(30_000, [138, 2, 2]), [138, 2, 2]);
        assert_eq!(read(36_000, [139, 3, 3]), [139, 3, 3]);
        assert_eq!(read(42_000, [139, 4, 4]), [139, 4, 4]);
    }

    /// No rate leaves its range.
    #[test]
    fn a_first_rate_stays_in_its_range() {
        let mut state = State { first: [32_000, 30_000], ..State::default() };
        assert_eq!(state.first(32_000, [false, true, true], true), i16::MAX);
        let mut state = State { first: [-32_768, 32_767], ..State::default() };
        assert_eq!(state.first(-32_768, [false, true, true], true), i16::MIN);
    }

    /// A loop with a sensor at 150 Hz. Gives estimate and true age of each new reading, us, and the
    /// period, the counted time and the true time since a reading, us.
    struct Watched {
        ages_us: Vec<(i64, i64)>,
        period_us: u32,
        counted_us: i64,
        passed_us: i64,
    }

    /// Between two rates of a burst, us: two bytes at 400 kHz, stretched.
    const RATE_US: i64 = 410;

    /// A sensor whose first refresh comes `phase_us` early. For `rest` readings it is at rest, and
    /// each rate repeats its counts with the probability `equal`. The result counts the readings
    /// after the rest.
    fn watch(
        (phase_us, period_us): (i64, i64),
        equal: f64,
        (rest, readings): (i64, i64),
    ) -> Watched {
        let mut refresh = State::default();
        let mut rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
        let newest = |at_us: i64, rate: i64| (at_us + phase_us + (rate - 1) * RATE_US) / period_us;
        let mut watched =
            Watched { ages_us: Vec::new(), period_us: 0, counted_us: 0, passed_us: 0 };
        let mut begun = None;
        for step in 1..readings {
            let (before, at_us) = ((step - 1) * 20_000 / 3, step * 20_000 / 3);
            let differ = [0, 1, 2].map(|rate| {
                newest(at_us, rate) != newest(before, rate)
                    && (step >= rest || f64::from(rng.next_u32()) >= equal * 4_294_967_296.0)
            });
            let Some(refreshed) = refresh.look((at_us - before) as u32, differ) else {
                continue;
            };
            watched.ages_us.push((refreshed.age_us.into(), (at_us + phase_us) % period_us));
            let last = newest(at_us, 1);
            match begun {
                Some(begun) => {
                    watched.counted_us += i64::from(refreshed.elapsed_us);
                    watched.passed_us = (last - begun) * period_us;
                }
                None if step >= rest => begun = Some(last),
                None => {}
            }
        }
        watched.period_us = refresh.period_us;
        watched
    }

    fn mean_off_us(watched: &Watched) -> i64 {
        let (_, settled) = watched.ages_us.split_at(watched.ages_us.len() / 2);
        let off_us = settled.iter().map(|(estimate_us, age_us)| (estimate_us - age_us).abs());
        off_us.sum::<i64>() / settled.len() as i64
    }

    proptest! {
        /// Six seconds find the period of any sensor's clock, even with refreshes in the midst of
        /// bursts. After that each rate of a turn counts for one period.
        #[test]
        fn finds_the_period(
            phase_us in 0_i64..10_000,
            period_us in prop_oneof![9_700_i64..10_300, 27_700_i64..29_500],
        ) {
            // Six seconds, and fifteen for the slowest.
            let rest = if period_us > 20_000 { 2_300 } else { 900 };
            let watched = watch((phase_us, period_us), 0.0, (rest, rest * 3 / 2));
            let off_us = i64::from(watched.period_us) - period_us;
            prop_assert!(off_us.abs() < 15, "{}", watched.period_us);
            let off = watched.counted_us as f64 / watched.passed_us as f64 - 1.0;
            prop_assert!(off.abs() < 3e-3, "{off}");
        }

        /// At rest one count in seven repeats. Still the age is known within half of the time
        /// between two readings.
        #[test]
        fn equal_counts_do_little_harm(phase_us in 0_i64..10_000, period_us in 9_700_i64..10_300) {
            let watched = watch((phase_us, period_us), 0.15, (900, 1_350));
            let off_us = i64::from(watched.period_us) - period_us;
            prop_assert!(off_us.abs() < 200, "{}", watched.period_us);
            let mean_us = mean_off_us(&watched);
            prop_assert!(mean_us < 3_334, "{mean_us}");
        }
    }
}
