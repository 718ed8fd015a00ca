//! How a run ended, judged by what can be seen from outside: of the sensor and its cable
//! ([`judge_sensor`]), and of what fails beyond them ([`judge_system`]).

mod sensor;
mod system;
#[cfg(test)]
mod testing;

pub(crate) use sensor::{SensorRun, judge_sensor};
pub(crate) use system::{SystemRun, judge_system};

use std::ops::RangeInclusive;

use tvc_nano::{Axis, Params, servo};

use crate::observe::ground_truth::Pulse;

/// Widths that count as the neutral pulse of an axis of a vehicle with these parameters, us: the
/// firmware commands whole microseconds.
pub fn neutral_us(params: &Params, axis: Axis) -> RangeInclusive<f64> {
    let pulse = f64::from(servo::neutral(params)[axis.index()].0);
    pulse - 1.0..=pulse + 0.5
}

/// Widths within the servo's travel, us; any other is a runt or a glitch.
const TRAVEL_US: RangeInclusive<f64> = 853.0..=2193.5;

/// What was seen of a rudder's servo.
pub(crate) struct Rudder<'a> {
    pub(crate) axis: Axis,
    /// Widths of the neutral pulse, us.
    pub(crate) neutral_us: RangeInclusive<f64>,
    /// The last pulse before the fault.
    pub(crate) before: Option<Pulse>,
    /// From the fault on.
    pub(crate) pulses: &'a [Pulse],
}

impl Rudder<'_> {
    fn is_neutral(&self, pulse: &Pulse) -> bool {
        self.neutral_us.contains(&pulse.width_us())
    }
}
