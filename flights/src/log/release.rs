//! The releases of a log.

use anyhow::Result;
use client::StateKind;
use client::state::state_of;
use tvc_nano::{Axis, Params};

use super::{Event, Flight, Step};
use report::exit::BadInput;

/// A release until control ended.
pub struct Release<'a> {
    /// The parameters that it began with.
    pub params: Params,
    /// Its steps.
    pub steps: Vec<&'a Step>,
    /// The set points of each axis at each step, rad.
    sets_rad: [Vec<f64>; Axis::COUNT],
    /// Control was on until the log or the operator ended it.
    pub stayed: bool,
}

impl Flight {
    /// Every stretch in which control was active.
    pub fn releases(&self) -> Vec<Release<'_>> {
        let mut params = self.parameters();
        let mut releases: Vec<Release> = Vec::new();
        let mut active = false;
        for event in &self.events {
            match event {
                Event::State(code) => {
                    let state = state_of(*code);
                    match (active, state == Some(StateKind::Active)) {
                        (false, true) => releases.push(Release {
                            params: params.clone(),
                            steps: Vec::new(),
                            sets_rad: Default::default(),
                            stayed: true,
                        }),
                        (true, false) => {
                            if let Some(release) = releases.last_mut() {
                                // Only the operator leads from control to standby.
                                release.stayed = state == Some(StateKind::Standby);
                            }
                        }
                        _ => {}
                    }
                    active = state == Some(StateKind::Active);
                }
                Event::Parameter(name, value) => {
                    // One that this version does not know changes nothing here.
                    let _ = params.set(name, *value);
                }
                Event::Step(step) if active => {
                    if let Some(release) = releases.last_mut() {
                        release.steps.push(step);
                        for (axis, set_rad) in Axis::ALL.into_iter().zip(&mut release.sets_rad) {
                            set_rad.push(f64::from(params.setpoint_deg(axis)).to_radians());
                        }
                    }
                }
                _ => {}
            }
        }
        releases.retain(|release| release.steps.len() > 1);
        releases
    }

    /// The release of this number, from 1; the only one where none is named.
    ///
    /// # Errors
    /// [`BadInput`] if there is none, or more than one to choose from.
    pub fn release(&self, number: Option<usize>) -> Result<Release<'_>, BadInput> {
        let mut releases = self.releases();
        let count = releases.len();
        let there_are = match count {
            0 => "there is no release".to_owned(),
            1 => "there is one release".to_owned(),
            _ => format!("there are {count} releases"),
        };
        Err(BadInput::new(match number.or((count == 1).then_some(1)) {
            Some(number) if (1..=count).contains(&number) => {
                return Ok(releases.swap_remove(number - 1));
            }
            _ if count == 0 => there_are,
            Some(number) => format!("{there_are}, none of number {number}"),
            None => format!("{there_are}: choose one with --release"),
        }))
    }
}

impl Release<'_> {
    /// The axes that were steered.
    pub fn axes(&self) -> &'static [Axis] {
        self.params.axes()
    }

    /// The set point of an axis at each step, rad.
    pub fn set_rad(&self, axis: Axis) -> &[f64] {
        &self.sets_rad[axis.index()]
    }

    /// What was controlled of an axis, rad, over the time since the release, s: the pitch angle of
    /// a vehicle with one axis, the tilt's part of one with two.
    pub fn motion(&self, axis: Axis) -> Vec<(f64, f64)> {
        match self.axes() {
            [_] => self.trace(Step::pitch_rad),
            _ => self.trace(|step| step.tilt_rad(axis)),
        }
    }

    /// Time since the release and a value, at every step.
    pub fn trace(&self, of: impl Fn(&Step) -> f64) -> Vec<(f64, f64)> {
        let begin = self.steps[0].time_s();
        self.steps.iter().map(|step| (step.time_s() - begin, of(step))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Log;
    use crate::log::tests::flight;

    #[test]
    fn a_release_is_named_by_its_number_or_is_the_only_one() {
        let two = flight();
        assert_eq!(two.releases().len(), 2);
        let first = two.release(Some(1)).unwrap();
        assert_eq!(first.steps[0].now_us, two.releases()[0].steps[0].now_us);
        let refused = |flight: &Flight, number| match flight.release(number) {
            Ok(_) => String::new(),
            Err(refused) => refused.to_string(),
        };
        assert_eq!(refused(&two, Some(3)), "there are 2 releases, none of number 3");
        assert_eq!(refused(&two, Some(0)), "there are 2 releases, none of number 0");
        assert_eq!(refused(&two, None), "there are 2 releases: choose one with --release");
        let none = Flight::of(&Log::default());
        assert_eq!(refused(&none, None), "there is no release");
    }
}
