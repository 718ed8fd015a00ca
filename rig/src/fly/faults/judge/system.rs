//! Faults beyond the sensor: whether a rudder was driven wrongly.

use client::StateKind;
use samd21::board::Ticks;
use tvc_nano::Axis;

use super::{Record, Rudder, Stray, TRAVEL_US};
use crate::fly::faults::{
    Ending, Phase, SENSOR_LIMIT, SILENCE_LIMIT, Unsafe, Verdict, WRONG_LIMIT,
};
use crate::observe::ground_truth::{Motion, Pulse};

/// What was seen of a run with a fault beyond the sensor.
pub(crate) struct SystemRun<'a> {
    pub(crate) record: Record<'a>,
    pub(crate) phase: Phase,
    /// The pulses of the flight without the fault, of the axes that are steered.
    pub(crate) reference_pulses: Vec<&'a [Pulse]>,
    /// The bootloader has the chip, and keeps it: it was asked to by an image that is not to be
    /// run.
    pub(crate) given_up: bool,
    /// How long the image ran, behind the last reset, without a burst of the sensor.
    pub(crate) blind: Ticks,
    /// The host gave orders, which the vehicle obeys by its rules: its course is its own.
    pub(crate) commanded: bool,
    /// The flash has a set of parameters at the end that nobody had stored.
    pub(crate) stored_others: bool,
    /// Which stray pulses count.
    pub(crate) blame: Blame,
}

/// Which stray pulses of a run are unsafe by themselves. Others count as driven wrongly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Blame {
    /// Each.
    Each,
    /// The last one before a silence: the fault itself makes wrong pulses until it is noticed.
    Last,
    /// None: the fault ends the pulses by itself, and no instruction runs that could prevent it.
    None,
}

/// A pulse this near to that of the flight without the fault is no wrong one, us.
const NEAR_US: f64 = 100.0;
/// Pulses that differ by no more are the same, us.
const SAME_US: f64 = 2.0;
/// Farther from the flight without the fault, a rudder has to bring the drone back, rad.
const ASTRAY_RAD: f64 = 0.05;
/// The frame behind a reset, where the rate that was set is not stored: the longest that there is.
const RESTARTED_FRAME: Ticks = Ticks::from_ms(20);
/// Pulses at the end that are looked at.
const LAST: usize = 3;

/// The verdict on a run with a fault beyond the sensor.
pub(crate) fn judge_system(run: &SystemRun<'_>) -> Verdict {
    let rudders = || run.record.rudders.iter().zip(&run.reference_pulses);
    let wrong = if run.commanded {
        Ticks::ZERO
    } else {
        let each = rudders().map(|(rudder, reference)| run.longest_wrong(rudder, reference));
        each.max().unwrap_or_default()
    };
    let silences = run.record.rudders.iter().map(|rudder| run.longest_silence(rudder));
    let silent = silences.max().unwrap_or_default();
    let beats = run.record.heartbeats.iter().filter(|beat| beat.at >= run.record.injected);
    let state = beats.clone().next_back().and_then(|beat| beat.state);
    let is_as_before =
        state.is_none_or(|state| run.phase.has(state)) && run.record.resets.is_empty();
    let is_other = |state: &StateKind| !run.phase.has(*state);
    let mut others = beats.filter_map(|beat| beat.state).filter(is_other);
    let noticed = !run.record.resets.is_empty() || others.clone().next().is_some();
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
    let strays = run.strays();
    let blamed = strays.iter().find(|stray| match run.blame {
        Blame::Each => true,
        Blame::Last => stray.is_last,
        Blame::None => false,
    });
    let stray = blamed.map(|stray| stray.what);
    let unordered = unordered.map(Unsafe::Unordered);
    let stored = (run.stored_others && !run.commanded).then_some(Unsafe::StoredOthers);
    let is_controlled = is_as_before && run.phase == Phase::Flight;
    let wrong_end = || run.wrong_end(is_controlled);
    let ending = match stray.or_else(wrong_end).or(unordered).or(stored) {
        Some(wrong) => Ending::Unsafe(wrong),
        None if wrong > WRONG_LIMIT => Ending::Unsafe(Unsafe::Driven(wrong)),
        None if silent > SILENCE_LIMIT && !run.given_up => Ending::Unsafe(Unsafe::NoPulse(silent)),
        None if run.blind > SENSOR_LIMIT && !run.record.resets.is_empty() => {
            Ending::Unsafe(Unsafe::NoSensor(run.blind))
        }
        None if is_as_before => Ending::Recovered,
        None if run.record.resets.is_empty() => Ending::Neutral,
        None => Ending::Restarted,
    };
    Verdict {
        wrong,
        silent,
        strays: strays.len(),
        for_ever: rudders().any(|(rudder, reference)| run.is_for_ever(rudder, reference)),
        noticed,
        harmless,
        ..Verdict::new(ending)
    }
}

/// The pulse that rose next to a time.
fn nearest(pulses: &[Pulse], time: Ticks) -> Option<&Pulse> {
    let after = pulses.partition_point(|pulse| pulse.rise < time);
    let around = [after.checked_sub(1).and_then(|at| pulses.get(at)), pulses.get(after)];
    let distance = |pulse: &&Pulse| pulse.rise.0.abs_diff(time.0);
    around.into_iter().flatten().min_by_key(distance)
}

impl SystemRun<'_> {
    fn longest_frame(&self) -> Ticks {
        match self.record.resets {
            [] => self.record.frame,
            _ => self.record.frame.max(RESTARTED_FRAME),
        }
    }

    fn strays(&self) -> Vec<Stray> {
        let end = self.record.truth.motion.last();
        let end = end.map_or(self.record.injected, |motion| motion.time);
        let rudders = self.record.rudders.iter();
        rudders.flat_map(|rudder| rudder.strays(self.longest_frame(), end)).collect()
    }

    /// What is wrong at the end of the run.
    fn wrong_end(&self, is_controlled: bool) -> Option<Unsafe> {
        let end = self.record.truth.motion.last()?.time;
        self.record.rudders.iter().find_map(|rudder| {
            let last = rudder.pulses.last().map_or(self.record.injected, |pulse| pulse.rise);
            let gap = end.saturating_sub(last);
            // Behind a reset the bootloader may be at work; what was before it counts then.
            if gap > self.record.frame + self.record.frame && self.record.resets.is_empty() {
                return Some(Unsafe::NoPulse(gap));
            }
            let mut ends = rudder.pulses.iter().rev().take(LAST);
            let off = ends.find(|pulse| !rudder.is_about_neutral(pulse));
            match off {
                Some(pulse) if !is_controlled && !self.commanded => {
                    Some(Unsafe::NotNeutral(pulse.width_us()))
                }
                _ => None,
            }
        })
    }

    /// Whether a rudder is driven wrongly at the end of the run, or has no pulses, though nobody
    /// has ordered that.
    fn is_for_ever(&self, rudder: &Rudder<'_>, reference: &[Pulse]) -> bool {
        let Some(end) = self.record.truth.motion.last().map(|motion| motion.time) else {
            return false;
        };
        let last = rudder.pulses.last().map(|pulse| pulse.rise);
        let high = rudder.high.map(|high| high.rise);
        let gap = end.saturating_sub(last.max(high).unwrap_or(self.record.injected));
        let restoring = restoring(rudder, reference);
        let mut ends = rudder.pulses.iter().rev().take(LAST);
        let is_driven = ends.all(|pulse| self.is_wrong(rudder, pulse, reference, restoring));
        let is_silent = gap > self.longest_frame() * 2;
        !self.commanded && (is_silent && !self.given_up || is_driven)
    }

    /// The longest time for which a rudder was driven wrongly without a break: from the first wrong
    /// pulse to the next right pulse, or to the end of the last one's frame.
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
            let driven = pulse.rise + self.record.frame + self.record.frame / 2;
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
        let end =
            self.record.truth.motion.last().map_or(self.record.injected, |motion| motion.time);
        let all = rudder.before.iter().chain(rudder.pulses);
        let nexts = rudder.pulses.iter().map(|pulse| pulse.rise).chain([end]);
        all.zip(nexts)
            .filter(|(pulse, _)| !rudder.is_about_neutral(pulse))
            .map(|(pulse, next)| next.saturating_sub(pulse.rise))
            .filter(|gap| *gap > self.record.frame + self.record.frame / 2)
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
        if rudder.is_about_neutral(pulse) {
            return false;
        }
        if self.phase != Phase::Flight || !TRAVEL_US.contains(&width) {
            return true;
        }
        let wanted_us = nearest(reference, pulse.rise).map(Pulse::width_us);
        let is_near = |us: f64| rudder.is_between(pulse, us - NEAR_US, us + NEAR_US);
        if wanted_us.is_some_and(is_near) {
            return false;
        }
        let astray = self.astray(rudder.axis, pulse.rise);
        let middle = (rudder.neutral_us.start() + rudder.neutral_us.end()) / 2.0;
        astray.abs() <= ASTRAY_RAD || (width - middle) * restoring * astray < 0.0
    }

    /// How far the drone is from the flight without the fault, rad.
    fn astray(&self, axis: Axis, time: Ticks) -> f64 {
        let at = |motions: &[Motion]| {
            let index = motions.partition_point(|motion| motion.time < time);
            motions.get(index).or(motions.last()).map(|motion| motion.tilt_rad[axis.index()])
        };
        at(&self.record.truth.motion).unwrap_or(f64::NAN)
            - at(self.record.reference).unwrap_or(f64::NAN)
    }
}

/// The side of neutral on which a pulse turns the drone back from a positive angle: that of the
/// first pulses behind the release, from a positive angle.
fn restoring(rudder: &Rudder<'_>, reference: &[Pulse]) -> f64 {
    let off = reference.iter().find(|pulse| !rudder.is_neutral(pulse));
    off.map_or(1.0, |pulse| (pulse.width_us() - rudder.neutral_us.start()).signum())
}

#[cfg(test)]
mod tests {
    use super::super::neutral_us;
    use super::super::tests::{ACTIVE, FRAME, NEUTRAL, beat, cut, motion, ms, pulse};
    use super::*;
    use crate::ground_station::Heartbeat;
    use crate::observe::ground_truth::{GroundTruth, High};
    use samd21::peripherals::ResetCause;
    use tvc_nano::Params;

    /// A second behind a fault at 0, with what is to be judged in it.
    struct Seen {
        phase: Phase,
        truth: GroundTruth,
        beats: Vec<Heartbeat>,
        resets: Vec<(Ticks, ResetCause)>,
        given_up: bool,
        blind: Ticks,
        commanded: bool,
        stored_others: bool,
        clock_error: f64,
        blame: Blame,
    }

    impl Seen {
        /// Pulses of the widths that their times ask for, 0 for none, in a phase whose state goes
        /// on.
        fn new(phase: Phase, state: StateKind, width_us: impl Fn(u64) -> f64) -> Self {
            let times = (0..1000).step_by(20);
            let pulses = times
                .filter(|time| width_us(*time) > 0.0)
                .map(|time| pulse(ms(time), width_us(time)));
            Self {
                phase,
                truth: GroundTruth {
                    pulses: [pulses.collect(), Vec::new()],
                    motion: motion(0.0),
                    ..GroundTruth::default()
                },
                beats: vec![beat(0, state)],
                resets: Vec::new(),
                given_up: false,
                blind: Ticks::ZERO,
                commanded: false,
                stored_others: false,
                clock_error: 0.0,
                blame: Blame::Each,
            }
        }

        fn flight(width_us: impl Fn(u64) -> f64) -> Self {
            Self::new(Phase::Flight, StateKind::Active, width_us)
        }

        /// Against a flight whose pulses are all [`ACTIVE`], or all [`NEUTRAL`] elsewhere.
        fn judged(&self) -> Verdict {
            let width = match self.phase {
                Phase::Flight => ACTIVE,
                _ => NEUTRAL,
            };
            let times = (0..1000).step_by(20);
            let reference: Vec<Pulse> = times.map(|time| pulse(ms(time), width)).collect();
            let rudder = Rudder {
                axis: Axis::Pitch,
                neutral_us: neutral_us(&Params::default(), Axis::Pitch),
                before: Some(pulse(Ticks::ZERO, width)),
                pulses: &self.truth.pulses[0],
                high: self.truth.high[0],
                clock_error: self.clock_error,
            };
            judge_system(&SystemRun {
                record: Record {
                    injected: Ticks::ZERO,
                    frame: FRAME,
                    rudders: vec![rudder],
                    truth: &self.truth,
                    reference: &motion(0.0),
                    heartbeats: &self.beats,
                    resets: &self.resets,
                },
                phase: self.phase,
                reference_pulses: vec![&reference],
                given_up: self.given_up,
                blind: self.blind,
                commanded: self.commanded,
                stored_others: self.stored_others,
                blame: self.blame,
            })
        }

        fn is_unsafe(&self) -> bool {
            matches!(self.judged().ending, Ending::Unsafe(_))
        }
    }

    #[test]
    fn what_changes_nothing_is_harmless_and_recovered_from() {
        for (phase, state, width) in [
            (Phase::Flight, StateKind::Active, ACTIVE),
            (Phase::Standby, StateKind::Standby, NEUTRAL),
            (Phase::Armed, StateKind::Armed, NEUTRAL),
        ] {
            let verdict = Seen::new(phase, state, |_| width).judged();
            assert_eq!(verdict.ending, Ending::Recovered, "{phase}");
            assert!(verdict.harmless && !verdict.noticed);
        }
    }

    #[test]
    fn a_rudder_may_be_driven_wrongly_for_no_longer_than_the_limit() {
        let wrong = |from: u64, until: u64| {
            Seen::flight(move |at| match at {
                at if (from..until).contains(&at) => ACTIVE + 150.0,
                _ => ACTIVE,
            })
        };
        let short = wrong(100, 300).judged();
        assert_eq!((short.ending, short.wrong), (Ending::Recovered, ms(200)));
        assert!(!short.harmless);
        assert_eq!(wrong(100, 320).judged().ending, Ending::Unsafe(Unsafe::Driven(ms(220))));
        // A clock that is off by as much makes every pulse so.
        let mut slow = wrong(100, 900);
        slow.clock_error = -0.1;
        assert!(!slow.is_unsafe());
    }

    #[test]
    fn far_from_its_course_a_rudder_has_to_bring_the_drone_back() {
        for (pitch_rad, unsafe_) in [(0.2, false), (-0.2, true)] {
            let mut seen = Seen::flight(|_| ACTIVE + 150.0);
            seen.truth.motion = motion(pitch_rad);
            assert_eq!(seen.is_unsafe(), unsafe_, "{pitch_rad}");
        }
    }

    #[test]
    fn behind_a_reset_the_rudder_is_at_neutral_and_not_silent_for_too_long() {
        let restarted = |back: u64, width: f64| {
            let mut seen = Seen::flight(move |at| match at {
                0..100 => ACTIVE,
                at if at < back => 0.0,
                _ => width,
            });
            seen.resets = vec![(ms(100), ResetCause::Watchdog)];
            seen.beats.push(beat(950, StateKind::Latched));
            seen
        };
        let verdict = restarted(700, NEUTRAL).judged();
        assert_eq!(verdict.ending, Ending::Restarted);
        assert_eq!((verdict.silent, verdict.noticed), (ms(620), true));
        assert!(restarted(900, NEUTRAL).is_unsafe(), "silent for 0.82 s");
        assert!(restarted(700, ACTIVE).is_unsafe(), "not at neutral");
        let mut blind = restarted(700, NEUTRAL);
        for (waited_ms, unsafe_) in [(155, false), (250, true)] {
            blind.blind = ms(waited_ms);
            assert_eq!(blind.is_unsafe(), unsafe_, "{waited_ms} ms without the sensor");
        }
        // The bootloader keeps it: there may be no pulses any more, but the last are neutral.
        let mut kept = Seen::flight(|at| if at < 100 { NEUTRAL } else { 0.0 });
        kept.resets = vec![(ms(100), ResetCause::System)];
        kept.given_up = true;
        assert!(!kept.is_unsafe());
        kept.truth.pulses[0][4] = pulse(ms(80), ACTIVE);
        assert!(kept.is_unsafe());
    }

    /// The watchdog bites in the midst of a pulse.
    #[test]
    fn a_pulse_that_a_reset_cuts_is_unsafe_whatever_its_width() {
        let mut seen = Seen::flight(|at| match at {
            0..100 => ACTIVE,
            100..620 => 0.0,
            _ => NEUTRAL,
        });
        seen.resets = vec![(ms(81), ResetCause::Watchdog)];
        assert_eq!(seen.judged().ending, Ending::Restarted);
        let last = &mut seen.truth.pulses[0][4];
        *last = cut(*last, 1312.0);
        let verdict = seen.judged();
        assert_eq!(verdict.ending, Ending::Unsafe(Unsafe::CutPulse(1312.0)));
        assert_eq!(verdict.strays, 1);
        seen.blame = Blame::Last;
        assert!(seen.is_unsafe());
        // Nothing could prevent it.
        seen.blame = Blame::None;
        assert_eq!(seen.judged().strays, 1);
        assert!(!seen.is_unsafe());
        // Where it is neutral by chance, it does no harm.
        seen.blame = Blame::Each;
        seen.truth.pulses[0][4] = cut(seen.truth.pulses[0][4], NEUTRAL);
        assert!(!seen.is_unsafe());
    }

    /// A wrong register makes pulses that nobody asked for, until that is noticed.
    #[test]
    fn a_stray_pulse_with_others_behind_it_counts_as_driven_wrongly() {
        let mut seen = Seen::flight(|_| ACTIVE);
        seen.truth.pulses[0][7] = cut(seen.truth.pulses[0][7], 18_400.0);
        let unsafe_ = Ending::Unsafe(Unsafe::StrayPulse(18_400.0));
        assert_eq!(seen.judged().ending, unsafe_);
        seen.blame = Blame::Last;
        let verdict = seen.judged();
        assert_eq!(verdict.ending, Ending::Recovered);
        assert_eq!((verdict.wrong, verdict.strays), (ms(20), 1));
        let rise = ms(990);
        seen.truth.high[0] =
            Some(High { rise: rise - ms(400), asked: seen.truth.pulses[0][0].asked });
        seen.truth.pulses[0].truncate(29);
        let high = Ending::Unsafe(Unsafe::High(ms(409)));
        let verdict = seen.judged();
        assert_eq!((verdict.ending, verdict.for_ever), (high, true));
    }

    #[test]
    fn pulses_must_go_on() {
        assert!(matches!(
            Seen::flight(|at| if at < 900 { ACTIVE } else { 0.0 }).judged().ending,
            Ending::Unsafe(Unsafe::NoPulse(_))
        ));
    }

    #[test]
    fn in_other_phases_every_pulse_off_neutral_is_wrong_and_nothing_is_armed_by_itself() {
        let off = |us: f64| {
            Seen::new(Phase::Armed, StateKind::Armed, move |at| match at {
                200..440 => NEUTRAL + us,
                _ => NEUTRAL,
            })
        };
        assert!(!off(0.3).is_unsafe() && off(3.0).is_unsafe());
        let mut armed = Seen::new(Phase::Standby, StateKind::Standby, |_| NEUTRAL);
        armed.beats.push(beat(500, StateKind::Armed));
        assert_eq!(armed.judged().ending, Ending::Unsafe(Unsafe::Unordered(StateKind::Armed)));
        armed.commanded = true;
        assert!(!armed.is_unsafe(), "the host has ordered it");
        let mut other = Seen::new(Phase::Saving, StateKind::Standby, |_| NEUTRAL);
        other.stored_others = true;
        assert_eq!(other.judged().ending, Ending::Unsafe(Unsafe::StoredOthers));
    }
}
