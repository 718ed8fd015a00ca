//! The sensor's clock, by which it refreshes its rates, from which readings were new.

use std::f64::consts::TAU;

use rayon::prelude::*;

/// Periods that are tried, within 2 % of the likely one.
const PERIODS: u32 = 1000;
/// Share of the readings with new rates that the sensor's clock must explain: the counts of a rate
/// change while it is read, or stay the same.
const LEAST_TICKED: f64 = 0.9;

/// A clock that runs evenly.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    period_us: f64,
    /// The time of one of its ticks.
    tick_us: f64,
}

impl Clock {
    /// The clock with about this period, us, that ticked in nearly all of the spans, us; of several
    /// the middle one.
    pub(super) fn of(spans: &[(u64, u64)], about_us: f64) -> Option<Self> {
        let middle_us = spans.get(spans.len() / 2)?.1 as f64;
        let steps = |from: f64, to: f64, count: u32| {
            (0..count).map(move |i| from + (to - from) * f64::from(i) / f64::from(count))
        };
        let ticked = |clock: &Self| {
            let holds = |(after, until): &&(u64, u64)| clock.before(*until) > *after as f64;
            spans.iter().filter(holds).count()
        };
        let best = |clocks: Vec<Self>| {
            let counts: Vec<usize> = clocks.par_iter().map(ticked).collect();
            let most = counts.iter().max().copied().unwrap_or_default();
            let best = clocks.into_iter().zip(counts).filter(move |(_, count)| *count == most);
            (most, best.map(|(clock, _)| clock).collect::<Vec<_>>())
        };
        let ticks = |period_us: f64, count| {
            steps(0.0, period_us, count)
                .map(move |phase_us| Self { period_us, tick_us: middle_us + phase_us })
        };
        let periods = steps(0.98 * about_us, 1.02 * about_us, PERIODS);
        let (most, likely) = best(periods.flat_map(|period_us| ticks(period_us, 50)).collect());
        if (most as f64) < LEAST_TICKED * spans.len() as f64 {
            return None;
        }
        let period_us =
            likely.iter().map(|clock| clock.period_us).sum::<f64>() / likely.len() as f64;
        let (_, likely) = best(ticks(period_us, 500).collect());
        // The mean of phases, which go round.
        let angles = likely.iter().map(|clock| TAU * (clock.tick_us - middle_us) / period_us);
        let [x, y] = [f64::cos, f64::sin].map(|part| angles.clone().map(part).sum::<f64>());
        Some(Self { period_us, tick_us: middle_us + y.atan2(x) * period_us / TAU })
    }

    /// Its newest tick at a time, us.
    pub(super) fn before(&self, at_us: u64) -> f64 {
        let at_us = at_us as f64;
        at_us - (at_us - self.tick_us).rem_euclid(self.period_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings every 6,667 us of a sensor that refreshes every 10,043 us, 2,100 us after each full
    /// period; one reading in thirty passes for new though it is not.
    #[test]
    fn the_clock_is_found_from_which_readings_are_new() {
        let tick = |at_us: u64| ((at_us as f64 - 2_100.0) / 10_043.0).floor();
        let times = (1..400).map(|i| i * 6_667);
        let is_new = |at_us: u64| tick(at_us) != tick(at_us - 6_667) || at_us.is_multiple_of(30);
        let spans: Vec<_> =
            times.filter(|at_us| is_new(*at_us)).map(|at_us| (at_us - 6_667, at_us)).collect();
        let clock = Clock::of(&spans, 10_000.0).unwrap();
        assert!((clock.period_us - 10_043.0).abs() < 1.0, "{clock:?}");
        for (_, at_us) in spans {
            let refreshed_us = 2_100.0 + 10_043.0 * tick(at_us);
            // Close to a tick, the one before or the one behind may be found.
            let off_us = (clock.before(at_us) - refreshed_us) % 10_043.0;
            let off_us = off_us.abs().min(10_043.0 - off_us.abs());
            assert!(off_us < 100.0, "{off_us}");
        }
    }

    #[test]
    fn readings_that_no_clock_explains_have_none() {
        // Each span is short, and no clock of 10 ms ticks in all of them.
        let spans: Vec<_> =
            (0..200).map(|i| (i * 7_130, i * 7_130 + 1_000 + 500 * (i % 5))).collect();
        assert!(Clock::of(&spans, 10_000.0).is_none());
        assert!(Clock::of(&[], 10_000.0).is_none());
    }
}
