//! How a run ended, judged by what can be seen from outside: of the sensor and its cable
//! ([`judge_sensor`]), and of what fails beyond them ([`judge_system`]).
//!
//! Both look for *stray* pulses: those that are neither neutral nor as wide as the program had
//! asked for when they rose. A reset of the chip or its timer cuts one, a wrong register makes
//! others.

mod sensor;
mod system;
#[cfg(test)]
pub(super) mod tests;

pub(crate) use sensor::judge_sensor;
pub(crate) use system::{Blame, SystemRun, judge_system};

use std::ops::RangeInclusive;

use samd21::board::Ticks;
use samd21::peripherals::ResetCause;
use tvc_nano::{Axis, Params, servo};

use super::Unsafe;
use crate::ground_station::Heartbeat;
use crate::observe::ground_truth::{Asked, GroundTruth, High, Motion, Pulse};

/// Widths that count as the neutral pulse of an axis of a vehicle with these parameters, us: the
/// firmware commands whole microseconds.
pub fn neutral_us(params: &Params, axis: Axis) -> RangeInclusive<f64> {
    let pulse = f64::from(servo::neutral(params)[axis.index()].0);
    pulse - 1.0..=pulse + 0.5
}

/// Widths within the servo's travel, us; any other is a runt or a glitch.
const TRAVEL_US: RangeInclusive<f64> = 853.0..=2193.5;

/// Without pulses for longer, a servo goes where the last one says and stays there: five frames of
/// 20 ms. A timer that is set up anew takes less.
const SILENCE: Ticks = Ticks::from_ms(100);

/// What was recorded of a run.
pub(crate) struct Record<'a> {
    /// When the fault began.
    pub(crate) injected: Ticks,
    pub(crate) frame: Ticks,
    /// Of every axis that is steered.
    pub(crate) rudders: Vec<Rudder<'a>>,
    /// From the fault on.
    pub(crate) truth: &'a GroundTruth,
    /// The flight without the fault.
    pub(crate) reference: &'a [Motion],
    pub(crate) heartbeats: &'a [Heartbeat],
    /// Resets of the chip since the fault.
    pub(crate) resets: &'a [(Ticks, ResetCause)],
}

/// What was seen of a rudder's servo.
pub(crate) struct Rudder<'a> {
    pub(crate) axis: Axis,
    /// Widths of the neutral pulse, us.
    pub(crate) neutral_us: RangeInclusive<f64>,
    /// The last pulse before the fault.
    pub(crate) before: Option<Pulse>,
    /// From the fault on.
    pub(crate) pulses: &'a [Pulse],
    /// The pulse that has begun and not ended.
    pub(crate) high: Option<High>,
    /// Relative error of the main clock, which the timer's pulses have, too. Until start-of-frame
    /// has locked a clock that was off they are off to either side: nothing on the chip can tell.
    pub(crate) clock_error: f64,
}

/// A pulse that is neither neutral nor what the program had asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stray {
    /// No other follows for a while: the servo goes where it says.
    pub(crate) is_last: bool,
    pub(crate) what: Unsafe,
}

impl Rudder<'_> {
    fn is_neutral(&self, pulse: &Pulse) -> bool {
        self.neutral_us.contains(&pulse.width_us())
    }

    /// Whether a pulse is the neutral one, made with the clock that there is.
    pub(crate) fn is_about_neutral(&self, pulse: &Pulse) -> bool {
        self.is_between(pulse, *self.neutral_us.start(), *self.neutral_us.end())
    }

    /// Whether a pulse has a width between these, us, to within the clock's error.
    fn is_between(&self, pulse: &Pulse, least_us: f64, most_us: f64) -> bool {
        let slack = 1.0 / (1.0 - self.clock_error.abs());
        (least_us / slack..=most_us * slack).contains(&pulse.width_us())
    }

    /// The stray pulses until `end`; and the one that has not ended, if it is longer than any.
    pub(crate) fn strays(&self, frame: Ticks, end: Ticks) -> Vec<Stray> {
        let nexts = self.pulses.iter().skip(1).map(|next| next.rise);
        let nexts = nexts.chain([self.high.map_or(end, |high| high.rise)]);
        let strays = self.pulses.iter().zip(nexts).filter_map(|(pulse, next)| {
            let is_stray = !pulse.is_as_asked(self.clock_error) && !self.is_about_neutral(pulse);
            let width_us = pulse.width_us();
            let Asked([asked, _]) = pulse.asked;
            is_stray.then(|| Stray {
                is_last: next.saturating_sub(pulse.fall) > SILENCE,
                what: if width_us < asked.as_us_f64() {
                    Unsafe::CutPulse(width_us)
                } else {
                    Unsafe::StrayPulse(width_us)
                },
            })
        });
        let high = self.high.map(|high| end.saturating_sub(high.rise));
        let stuck = high
            .filter(|high| *high > frame)
            .map(|high| Stray { is_last: true, what: Unsafe::High(high) });
        strays.chain(stuck).collect()
    }
}
