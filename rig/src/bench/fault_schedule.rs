//! Faults that begin and end at times of the flight, or at times after the power comes on.

use super::disturbance::is_default;
use crate::bno055::{Fault, FaultKind};
use rand::Rng;
use samd21::board::Ticks;
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::ops::RangeInclusive;

/// From what on a fault's times count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Since {
    /// Each release of the drone.
    #[default]
    Release,
    /// Each time that the power comes on.
    PowerOn,
}

/// A fault of the sensor or its cable for a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedFault {
    /// What fails.
    pub fault: Fault,
    /// From what on its times count.
    pub since: Since,
    /// When it begins.
    pub at: Ticks,
    /// When it ends; [`Ticks::NEVER`] if it stays.
    pub until: Ticks,
}

/// A timed fault as it stands in a scenario file and in the figures of a flight.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FaultEntry {
    /// Name of its kind.
    pub kind: String,
    /// From what on its times count.
    #[serde(default, skip_serializing_if = "is_default")]
    pub since: Since,
    /// When it begins, s.
    pub at_s: f64,
    /// How long it lasts, s, above 0 and at most 3600; if left out, until the drone is caught, or
    /// the power is cut.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
    /// Share of words or bytes that it strikes, 0 to 1, for the kinds that strike some only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// How long a byte is stretched, ms, 0 to 1000, for `long-stretch`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stretch_ms: Option<f64>,
    /// Clocks until the line is free, 1 to 9, for `sda-held`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clocks: Option<u8>,
}

impl FaultEntry {
    /// The fault for flights of `length_s`. Parameters that the entry leaves out are drawn from
    /// `dice` and filled in.
    ///
    /// # Errors
    /// There is no such kind, or a value is out of its range or does not belong to the kind.
    pub fn draw(&mut self, length_s: f64, dice: &mut impl Rng) -> Result<TimedFault, String> {
        let kind: FaultKind = self.kind.parse()?;
        self.fit(length_s, kind, kind.draw(dice))
    }

    /// The fault for flights of `length_s`, of this kind. Parameters that the entry leaves out are
    /// those of `fault`, and filled in.
    ///
    /// # Errors
    /// A value is out of its range or does not belong to the kind.
    pub(crate) fn fit(
        &mut self,
        length_s: f64,
        kind: FaultKind,
        mut fault: Fault,
    ) -> Result<TimedFault, String> {
        if !(0.0..length_s).contains(&self.at_s) {
            return Err(format!("at_s must be 0 to below {length_s}"));
        }
        if self.for_s.is_some_and(|for_s| !(for_s > 0.0 && for_s <= 3600.0)) {
            return Err("for_s must be above 0 and at most 3600".into());
        }
        let share = fault.probability_mut();
        reconcile(kind, "probability", &mut self.probability, share, 0.0..=1.0)?;
        let mut stretch_ms = match &fault {
            Fault::LongStretch { stretch, .. } => Some(stretch.as_us_f64() * 1e-3),
            _ => None,
        };
        reconcile(kind, "stretch_ms", &mut self.stretch_ms, stretch_ms.as_mut(), 0.0..=1000.0)?;
        if let (Fault::LongStretch { stretch, .. }, Some(ms)) = (&mut fault, stretch_ms) {
            *stretch = Ticks::from_secs_f64(ms * 1e-3);
        }
        let clocks = match &mut fault {
            Fault::SdaHeld { clocks } => Some(clocks),
            _ => None,
        };
        reconcile(kind, "clocks", &mut self.clocks, clocks, 1..=9)?;
        Ok(TimedFault {
            fault,
            since: self.since,
            at: Ticks::from_secs_f64(self.at_s),
            until: self.for_s.map_or(Ticks::NEVER, |for_s| Ticks::from_secs_f64(self.at_s + for_s)),
        })
    }
}

/// Replaces the drawn value by the `given` one, or fills `given` in with the drawn one. `drawn` is
/// `None` for a kind that has no such value.
fn reconcile<T: Copy + PartialOrd + Display>(
    kind: FaultKind,
    what: &str,
    given: &mut Option<T>,
    drawn: Option<&mut T>,
    range: RangeInclusive<T>,
) -> Result<(), String> {
    match (*given, drawn) {
        (Some(value), Some(drawn)) if range.contains(&value) => *drawn = value,
        (Some(_), Some(_)) => {
            return Err(format!("{what} must be {} to {}", range.start(), range.end()));
        }
        (Some(_), None) => return Err(format!("fault {kind} has no {what}")),
        (None, drawn) => *given = drawn.copied(),
    }
    Ok(())
}
