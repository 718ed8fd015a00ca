//! Faults beyond the sensor: whether a rudder was driven wrongly.

use client::StateKind;
use samd21::board::Ticks;
use samd21::peripherals::ResetCause;
use tvc_nano::Axis;

use super::{Rudder, TRAVEL_US};
use crate::fly::faults::{Ending, Phase, SILENCE_LIMIT, Unsafe, WRONG_LIMIT};
use crate::ground_station::Heartbeat;
use crate::observe::ground_truth::{GroundTruth, Motion, Pulse};

/// What was seen of a run with a fault beyond the sensor.
pub(crate) struct SystemRun<'a> {
    pub(crate) injected: Ticks,
    pub(crate) phase: Phase,
    pub(crate) frame: Ticks,
    /// Of every axis that is steered.
    pub(crate) rudders: Vec<Rudder<'a>>,
    /// The pulses of the flight without the fault, of the same axes.
    pub(crate) reference_pulses: Vec<&'a [Pulse]>,
    /// From the fault on.
    pub(crate) truth: &'a GroundTruth,
    /// The flight without the fault.
    pub(crate) reference: &'a [Motion],
    pub(crate) heartbeats: &'a [Heartbeat],
    /// Resets of the chip since the fault.
    pub(crate) resets: &'a [(Ticks, ResetCause)],
    /// The bootloader has the chip, and keeps it: it was asked to by an image that is not to be
    /// run.
    pub(crate) given_up: bool,
    /// The host gave orders, which the vehicle obeys by its rules: its course is its own.
    pub(crate) commanded: bool,
    /// The flash has a set of parameters at the end that nobody had stored.
    pub(crate) stored_others: bool,
    /// Relative error of the main clock while the fault lasts. The timer's pulses have it, too, and
    /// until start-of-frame has locked the clock again they are off to either side: nothing on the
    /// chip can tell.
    pub(crate) clock_error: f64,
}

/// What became of such a run.
pub(crate) struct Verdict {
    pub(crate) ending: Ending,
    /// Longest time for which a rudder was driven wrongly.
    pub(crate) wrong: Ticks,
    /// Longest time without a pulse behind one that was not neutral.
    pub(crate) silent: Ticks,
    pub(crate) noticed: bool,
    pub(crate) harmless: bool,
}

/// A pulse this near to that of the flight without the fault is no wrong one, us.
const NEAR_US: f64 = 100.0;
/// Pulses that differ by no more are the same, us.
const SAME_US: f64 = 2.0;
/// Farther from the flight without the fault, a rudder has to bring the drone back, rad.
const ASTRAY_RAD: f64 = 0.05;
/// Pulses at the end that are looked at.
const LAST: usize = 3;

/// The verdict on a run with a fault beyond the sensor.
pub(crate) fn judge_system(run: &SystemRun<'_>) -> Verdict {
    let rudders = || run.rudders.iter().zip(&run.reference_pulses);
    let wrong = if run.commanded {
        Ticks::ZERO
    } else {
        let each = rudders().map(|(rudder, reference)| run.longest_wrong(rudder, reference));
        each.max().unwrap_or_default()
    };
    let silences = run.rudders.iter().map(|rudder| run.longest_silence(rudder));
    let silent = silences.max().unwrap_or_default();
    let beats = run.heartbeats.iter().filter(|beat| beat.at >= run.injected);
    let state = beats.clone().next_back().and_then(|beat| beat.state);
    let is_as_before = state.is_none_or(|state| run.phase.has(state)) && run.resets.is_empty();
    let is_other = |state: &StateKind| !run.phase.has(*state);
    let mut others = beats.filter_map(|beat| beat.state).filter(is_other);
    let noticed = !run.resets.is_empty() || others.clone().next().is_some();
    let unordered = others
        .find(|state| matches!(state, StateKind::Armed | StateKind::Active))
        .filter(|_| !run.commanded);
    let harmless = !noticed
        && rudders().all(|(rudder, reference)| {
            rudder.pulses.iter().all(|pulse| {
                let other = nearest(reference, pulse.rise);
                other.is_some_and(|other| (other.width_us() - pulse.width_us()).abs() <= SAME_US)
            })
        });
    let unordered = unordered.map(Unsafe::Unordered);
    let stored = (run.stored_others && !run.commanded).then_some(Unsafe::StoredOthers);
    let is_controlled = is_as_before && run.phase == Phase::Flight;
    let ending = match run.wrong_end(is_controlled).or(unordered).or(stored) {
        Some(wrong) => Ending::Unsafe(wrong),
        None if wrong > WRONG_LIMIT => Ending::Unsafe(Unsafe::Driven(wrong)),
        None if silent > SILENCE_LIMIT && !run.given_up => Ending::Unsafe(Unsafe::NoPulse(silent)),
        None if is_as_before => Ending::Recovered,
        None if run.resets.is_empty() => Ending::Neutral,
        None => Ending::Restarted,
    };
    Verdict {
        ending,
        wrong,
        silent,
        noticed,
        harmless,
    }
}

/// The pulse that rose next to a time.
fn nearest(pulses: &[Pulse], time: Ticks) -> Option<&Pulse> {
    let after = pulses.partition_point(|pulse| pulse.rise < time);
    let around = [
        after.checked_sub(1).and_then(|at| pulses.get(at)),
        pulses.get(after),
    ];
    let distance = |pulse: &&Pulse| pulse.rise.0.abs_diff(time.0);
    around.into_iter().flatten().min_by_key(distance)
}

impl SystemRun<'_> {
    /// What is wrong at the end of the run.
    fn wrong_end(&self, is_controlled: bool) -> Option<Unsafe> {
        let end = self.truth.motion.last()?.time;
        self.rudders.iter().find_map(|rudder| {
            let last = rudder
                .pulses
                .last()
                .map_or(self.injected, |pulse| pulse.rise);
            let gap = end.saturating_sub(last);
            // Behind a reset the bootloader may be at work; what was before it counts then.
            if gap > self.frame + self.frame && self.resets.is_empty() {
                return Some(Unsafe::NoPulse(gap));
            }
            let mut ends = rudder.pulses.iter().rev().take(LAST);
            let off = ends.find(|pulse| !rudder.is_neutral(pulse));
            match off {
                Some(pulse) if !is_controlled && !self.commanded => {
                    Some(Unsafe::NotNeutral(pulse.width_us()))
                }
                _ => None,
            }
        })
    }

    /// The longest time for which a rudder was driven wrongly without a break: from the first of
    /// such pulses to the next that is none, or to the end of the last one's frame.
    fn longest_wrong(&self, rudder: &Rudder<'_>, reference: &[Pulse]) -> Ticks {
        let restoring = restoring(rudder, reference);
        let mut longest = Ticks::ZERO;
        let mut since: Option<Ticks> = None;
        for (index, pulse) in rudder.pulses.iter().enumerate() {
            if !self.is_wrong(rudder, pulse, reference, restoring) {
                since = None;
                continue;
            }
            let begun = *since.get_or_insert(pulse.rise);
            // Without a next pulse it is not driven any more.
            let driven = pulse.rise + self.frame + self.frame / 2;
            let next = rudder.pulses.get(index + 1).map(|next| next.rise);
            longest = longest.max(next.map_or(driven, |next| next.min(driven)) - begun);
            if next.is_some_and(|next| next > driven) {
                since = None;
            }
        }
        longest
    }

    /// The longest time without a pulse behind one that was not neutral.
    fn longest_silence(&self, rudder: &Rudder<'_>) -> Ticks {
        let end = self
            .truth
            .motion
            .last()
            .map_or(self.injected, |motion| motion.time);
        let all = rudder.before.iter().chain(rudder.pulses);
        let nexts = rudder.pulses.iter().map(|pulse| pulse.rise).chain([end]);
        all.zip(nexts)
            .filter(|(pulse, _)| !rudder.is_neutral(pulse))
            .map(|(pulse, next)| next.saturating_sub(pulse.rise))
            .filter(|gap| *gap > self.frame + self.frame / 2)
            .max()
            .unwrap_or_default()
    }

    fn is_wrong(
        &self,
        rudder: &Rudder<'_>,
        pulse: &Pulse,
        reference: &[Pulse],
        restoring: f64,
    ) -> bool {
        let width = pulse.width_us();
        if rudder.is_neutral(pulse) {
            return false;
        }
        if self.phase != Phase::Flight {
            let slack = 1.0 / (1.0 - self.clock_error.abs());
            let (least, most) = (rudder.neutral_us.start(), rudder.neutral_us.end());
            return !(least / slack..=most * slack).contains(&width);
        }
        if !TRAVEL_US.contains(&width) {
            return true;
        }
        let other = nearest(reference, pulse.rise);
        if other.is_some_and(|other| (other.width_us() - width).abs() <= NEAR_US) {
            return false;
        }
        let astray = self.astray(rudder.axis, pulse.rise);
        let middle = (rudder.neutral_us.start() + rudder.neutral_us.end()) / 2.0;
        astray.abs() <= ASTRAY_RAD || (width - middle) * restoring * astray < 0.0
    }

    /// How far the drone is from the flight without the fault, rad.
    fn astray(&self, axis: Axis, time: Ticks) -> f64 {
        let angle = |motion: &Motion| match axis {
            Axis::Pitch => motion.pitch_rad,
            Axis::Roll => motion.roll.roll_rad,
        };
        let at = |motions: &[Motion]| {
            let index = motions.partition_point(|motion| motion.time < time);
            motions.get(index).or(motions.last()).map(angle)
        };
        at(&self.truth.motion).unwrap_or(f64::NAN) - at(self.reference).unwrap_or(f64::NAN)
    }
}

/// The side of neutral on which a pulse turns the drone back from a positive angle: that of the
/// first pulses behind the release, from a positive angle.
fn restoring(rudder: &Rudder<'_>, reference: &[Pulse]) -> f64 {
    let off = reference.iter().find(|pulse| !rudder.is_neutral(pulse));
    off.map_or(1.0, |pulse| {
        (pulse.width_us() - rudder.neutral_us.start()).signum()
    })
}
