//! Timing of the control loop, measured from outside the chip: on the bus, at the servo's pin and
//! at the probe pin.

use crate::observe::ground_truth::{Burst, GroundTruth, Pulse};
use samd21::board::Ticks;
use std::ops::Range;
use tvc_nano::Axis;
use tvc_nano::sensor::Kind;

/// Mean and maximum of a set of values; zero for an empty set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Maximum.
    pub max: f64,
    /// Number of values.
    pub count: usize,
}

impl FromIterator<f64> for Spread {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let (mut sum, mut max, mut count) = (0.0, f64::NEG_INFINITY, 0usize);
        for value in values {
            sum += value;
            max = max.max(value);
            count += 1;
        }
        if count == 0 {
            return Self::default();
        }
        Self { mean: sum / count as f64, max, count }
    }
}

/// Timing of the control loop over a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopTiming {
    /// Bursts a second.
    pub rate_hz: f64,
    /// Largest deviation of the time between two bursts from its mean, us; where one of several
    /// reads the rates alone and begins later for it, between two at the same place of the frame.
    pub jitter_us_max: f64,
    /// Length of a control step in CPU cycles at 48 MHz, interrupts included.
    pub cycles_per_step: Spread,
    /// From the START of a burst to the rising edge of the pulse that carries its sample, us.
    pub latency_us: Spread,
    /// From the refresh of the sensor's registers to the START of the burst that read it, us.
    pub sample_age_us: Spread,
    /// Control steps.
    pub steps: usize,
    /// Bursts.
    pub bursts: usize,
    /// Pulses that were not as wide as the image had asked for, of both servos.
    pub strays: usize,
}

impl LoopTiming {
    /// Measures over `window`; pulses that rise after it do not count.
    pub fn over(truth: &GroundTruth, window: Range<Ticks>) -> Self {
        let within = |time: Ticks| window.contains(&time);
        let mut bursts: Vec<&Burst> =
            truth.bursts.iter().filter(|burst| within(burst.start)).collect();
        // Of two sensors the one that flies is read at every tick.
        let onboard = bursts.iter().filter(|burst| burst.sensor == Kind::Lsm6ds3).count();
        let onboard_flies = 2 * onboard > bursts.len();
        bursts.retain(|burst| onboard_flies == (burst.sensor == Kind::Lsm6ds3));
        let cycle = cycle(&bursts);
        let periods: Spread = periods_us(&bursts, cycle).collect();
        let period = periods.mean / cycle as f64;
        let steps = truth.steps.iter().filter(|step| within(step.start));
        let pulses = Axis::ALL.iter().flat_map(|axis| truth.pulses_of(*axis));
        let strays = pulses.filter(|pulse| within(pulse.rise) && !pulse.is_as_asked(0.0));
        Self {
            rate_hz: if period > 0.0 { 1e6 / period } else { 0.0 },
            jitter_us_max: periods_us(&bursts, cycle)
                .map(|period| (period - periods.mean).abs())
                .fold(0.0, f64::max),
            cycles_per_step: steps.clone().map(|step| (step.end - step.start).0 as f64).collect(),
            latency_us: carried(truth)
                .filter(|(burst, pulse)| within(burst.start) && within(pulse.rise))
                .map(|(burst, pulse)| (pulse.rise - burst.start).as_us_f64())
                .collect(),
            sample_age_us: bursts
                .iter()
                .map(|b| b.start.as_us_f64() - b.refresh.at.as_us_f64())
                .collect(),
            steps: steps.count(),
            bursts: bursts.len(),
            strays: strays.count(),
        }
    }
}

/// Bursts from one to the next that comes at the same place of its servo frame, as far as that
/// matters: where one of several reads the rates alone, and begins later for it.
fn cycle(bursts: &[&Burst]) -> usize {
    match bursts.iter().filter(|burst| burst.alone).count() {
        0 => 1,
        alone => (bursts.len() as f64 / alone as f64).round() as usize,
    }
}

/// Times between bursts and those `apart` from them, us.
fn periods_us(bursts: &[&Burst], apart: usize) -> impl Iterator<Item = f64> {
    let pairs = bursts.iter().zip(bursts.iter().skip(apart));
    pairs.map(|(one, other)| (other.acknowledged - one.acknowledged).as_us_f64())
}

/// Every pulse that carries a new sample, with the burst that brought it.
///
/// A pulse carries the newest step that had ended when it rose; a step works on the newest burst
/// that had ended when it began. Of several pulses from one step only the first counts, and a step
/// that is followed by another before any pulse rises has no pulse.
pub fn carried(truth: &GroundTruth) -> impl Iterator<Item = (&Burst, &Pulse)> {
    let mut last = None;
    truth.pulses_of(Axis::Pitch).iter().filter_map(move |pulse| {
        let step = truth.steps.partition_point(|s| s.end <= pulse.rise);
        let step = truth.steps.get(step.checked_sub(1)?)?;
        let index = truth.bursts.partition_point(|b| b.end <= step.start).checked_sub(1)?;
        if last.replace(index) == Some(index) {
            return None;
        }
        Some((truth.bursts.get(index)?, pulse))
    })
}

/// Largest difference of a message's time from its event's, us: well under a control period.
const MATCH_US: f64 = 3000.0;

/// Number of `events` that have no message of their own; both are times in us, rising.
pub(crate) fn events_without(events: &[f64], messages: impl Iterator<Item = f64>) -> usize {
    let mut messages = messages.peekable();
    events
        .iter()
        .filter(|event| {
            while messages.next_if(|m| *m < **event - MATCH_US).is_some() {}
            messages.next_if(|m| *m <= **event + MATCH_US).is_none()
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inertial::Refresh;
    use crate::observe::ground_truth::{Asked, Step};

    /// Two steps in a frame of 20 ms; only the second reaches a pulse.
    fn frames(count: u64) -> GroundTruth {
        let mut truth = GroundTruth::default();
        let us = Ticks::from_us;
        for frame in 0..count {
            let overflow = 20_000 * (frame + 1);
            for begin in [overflow - 17_000, overflow - 7_000] {
                truth.bursts.push(Burst {
                    start: us(begin),
                    acknowledged: us(begin + 23),
                    end: us(begin + 4300),
                    refresh: Refresh { at: us(begin - 2000), recorded: None },
                    valid: true,
                    ..Burst::default()
                });
                truth.steps.push(Step { start: us(begin + 4310), end: us(begin + 5310) });
            }
            truth.pulses[0].push(Pulse {
                asked: Asked([us(1523); 2]),
                rise: us(overflow),
                fall: us(overflow + 1523),
            });
        }
        truth
    }

    #[test]
    fn the_pulse_carries_the_last_step_before_it() {
        let timing = LoopTiming::over(&frames(50), Ticks::ZERO..Ticks::from_ms(2000));
        assert_eq!(timing.latency_us.mean, 7000.0);
        assert_eq!(timing.latency_us.count, 50);
        assert!((timing.rate_hz - 100.0).abs() < 1e-9);
        assert_eq!(timing.jitter_us_max, 0.0);
        assert_eq!(timing.cycles_per_step.mean, 48_000.0);
        assert_eq!(timing.sample_age_us.max, 2000.0);
        assert_eq!((timing.steps, timing.bursts, timing.strays), (100, 100, 0));
    }

    #[test]
    fn a_cut_pulse_is_a_stray_one() {
        let mut truth = frames(50);
        truth.pulses[0][20].fall = truth.pulses[0][20].rise + Ticks::from_us(900);
        let timing = LoopTiming::over(&truth, Ticks::ZERO..Ticks::from_ms(2000));
        assert_eq!(timing.strays, 1);
    }

    #[test]
    fn a_late_burst_is_jitter() {
        let mut truth = frames(50);
        truth.bursts[20].acknowledged += Ticks::from_us(60);
        let timing = LoopTiming::over(&truth, Ticks::ZERO..Ticks::from_ms(2000));
        assert!((timing.jitter_us_max - 60.0).abs() < 1e-6);
    }

    #[test]
    fn a_step_that_misses_its_frame_goes_out_with_the_next() {
        let mut truth = frames(3);
        // The last step of frame 1 ends after that frame's pulse rose.
        truth.steps[3].end = Ticks::from_us(40_100);
        let timing = LoopTiming::over(&truth, Ticks::ZERO..Ticks::from_ms(2000));
        // Its frame's pulse carries the step before it, 17 ms old.
        assert_eq!(timing.latency_us.max, 17_000.0);
    }

    #[test]
    fn every_event_needs_a_message_of_its_own() {
        let events = [10_000.0, 20_000.0, 30_000.0, 40_000.0];
        let count = |messages: &[f64]| events_without(&events, messages.iter().copied());
        assert_eq!(count(&[500.0, 10_400.0, 20_000.0, 29_600.0, 40_100.0]), 0);
        assert_eq!(count(&[10_000.0, 30_000.0]), 2);
        assert_eq!(count(&[10_000.0, 10_001.0, 25_000.0, 40_000.0]), 2);
        assert_eq!(count(&[]), 4);
    }

    #[test]
    fn nothing_measured_is_zero() {
        let timing = LoopTiming::over(&GroundTruth::default(), Ticks::ZERO..Ticks::from_ms(1));
        assert_eq!(timing, LoopTiming::default());
    }
}
