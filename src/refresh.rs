//! How old the sensor's rates are: when it has refreshed its registers last.
//!
//! The BNO055 refreshes them by a clock of its own, and a reading says only whether they are new.
//! That is enough: new ones were refreshed since the reading before, and a whole number of periods
//! after the ones before them. What all readings allow is an interval, some 3 ms wide where the
//! loop reads three times in two periods; its middle is the estimate.

/// Period of the refresh, us (data sheet 3.6.2: 100 Hz without fusion).
const PERIOD_US: u32 = 10_000;

/// The sensor's clock is this much faster or slower at most: 1/128.
const TOLERANCE: u32 = 7;

/// What the readings so far allow of the age, us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refresh {
    least_us: u32,
    most_us: u32,
    /// Time since the newest new reading, and the mean time between two of them.
    since_new_us: u32,
    mean_us: u32,
}

impl Default for Refresh {
    /// Nothing read yet.
    fn default() -> Self {
        Self {
            least_us: 0,
            most_us: PERIOD_US,
            since_new_us: 0,
            mean_us: PERIOD_US,
        }
    }
}

impl Refresh {
    /// A reading `dt_us` after the one before: how old it is, us, if it is new. A new one with the
    /// counts of the one before passes for a repeated one, which does no harm.
    pub fn read(&mut self, dt_us: u32, is_new: bool) -> Option<u32> {
        if dt_us > 2 * PERIOD_US || self.least_us > 4 * PERIOD_US {
            *self = Self::default();
            return is_new.then_some(PERIOD_US / 2);
        }
        self.since_new_us += dt_us;
        if is_new {
            let mean_us = self.mean_us as i32;
            self.mean_us = (mean_us + ((self.since_new_us as i32 - mean_us) >> 4)) as u32;
            self.since_new_us = 0;
        }
        let slack_us = dt_us >> TOLERANCE;
        self.least_us += dt_us - slack_us;
        self.most_us += dt_us + slack_us;
        if !is_new {
            return None;
        }
        let oldest_us = dt_us.min(PERIOD_US);
        loop {
            self.least_us = self.least_us.saturating_sub(PERIOD_US);
            self.most_us = self.most_us.saturating_sub(PERIOD_US);
            if self.least_us <= oldest_us {
                break;
            }
        }
        self.most_us = self.most_us.min(oldest_us);
        if self.least_us >= self.most_us {
            // The sensor's clock is not what it is taken for: all that this reading allows.
            (self.least_us, self.most_us) = (0, oldest_us);
        }
        Some((self.least_us + self.most_us) / 2)
    }

    /// Mean time between two new readings, us: the sensor's period, which may be longer than the
    /// data sheet's.
    pub fn mean_us(&self) -> u32 {
        self.mean_us
    }

    /// See [`Flight::memory`](crate::Flight::memory).
    pub(crate) fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        for us in [
            &mut self.least_us,
            &mut self.most_us,
            &mut self.since_new_us,
            &mut self.mean_us,
        ] {
            *us = (each(*us as i32) as u32).min(8 * PERIOD_US);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// By hand: read every 6 ms. New at 6: refreshed within 0 to 6 ago. Repeated at 12. New at 18:
    /// what was 0 to 6 ms old is, 12 ms and a period later, 2 to 8, and at most 6.
    #[test]
    fn new_readings_narrow_the_age() {
        let mut refresh = Refresh::default();
        assert_eq!(refresh.read(6_000, true), Some(3_000));
        assert_eq!(refresh.read(6_000, false), None);
        assert_eq!(
            refresh.read(6_000, true),
            Some((2_000 - 2 * 46 + 6_000) / 2)
        );
    }

    #[test]
    fn a_gap_starts_it_over() {
        let mut refresh = Refresh::default();
        refresh.read(6_000, true);
        assert_eq!(refresh.read(500_000, true), Some(5_000));
        for _ in 0..100 {
            assert_eq!(refresh.read(6_666, false), None);
        }
        assert!(refresh.read(6_666, true).unwrap() <= 6_666);
    }

    /// The loop at 150 Hz and a sensor whose clock is `drift` us a period off: estimate and age,
    /// us. Every `equal`th reading has the counts of the one before.
    fn read(phase_us: i64, drift: i64, equal: i64) -> impl Iterator<Item = (i64, i64)> {
        let mut refresh = Refresh::default();
        let period_us = 10_000 + drift;
        let refreshes = move |at_us: i64| (at_us + phase_us) / period_us;
        (1..300)
            .map(move |step| {
                let (before, at_us) = ((step - 1) * 20_000 / 3, step * 20_000 / 3);
                let is_new = refreshes(at_us) != refreshes(before) && step % equal != 0;
                let estimate_us = refresh.read((at_us - before) as u32, is_new);
                (estimate_us.map(i64::from), (at_us + phase_us) % period_us)
            })
            .filter_map(|(estimate_us, age_us)| Some((estimate_us?, age_us)))
    }

    proptest! {
        /// After a tenth of a second the estimate is within half of the 3.3 ms by which the two
        /// clocks miss each other, and of what the sensor's clock may differ by.
        #[test]
        fn finds_the_age(phase_us in 0_i64..10_000, drift in -50_i64..50) {
            for (estimate_us, age_us) in read(phase_us, drift, 1_000).skip(10) {
                prop_assert!((estimate_us - age_us).abs() < 2_200, "{estimate_us} for {age_us}");
            }
        }

        /// Knowing nothing is 1.7 ms off in the mean.
        #[test]
        fn new_readings_with_equal_counts_do_no_harm(
            phase_us in 0_i64..10_000, drift in -50_i64..50, equal in 5_i64..50,
        ) {
            let off_us = read(phase_us, drift, equal).skip(10);
            let off_us: Vec<i64> = off_us.map(|(estimate_us, age_us)| (estimate_us - age_us).abs()).collect();
            let mean_us = off_us.iter().sum::<i64>() / off_us.len() as i64;
            prop_assert!(mean_us < 1_700, "{mean_us}");
        }
    }
}
