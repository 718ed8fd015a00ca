//! How a run ended, judged by what can be seen from outside.

use super::{Case, DEADLINE, SILENCE_LIMIT, WRONG_LIMIT};
use crate::ground_station::Heartbeat;
use crate::observe::ground_truth::{GroundTruth, Motion, Pulse};
use client::StateKind;
use samd21::board::Ticks;
use samd21::peripherals::ResetCause;
use std::fmt;
use std::ops::RangeInclusive;
use tvc_nano::{Axis, Params, servo};

/// Widths that count as the neutral pulse of an axis of a vehicle with these parameters, us: the
/// firmware commands whole microseconds.
pub fn neutral_us(params: &Params, axis: Axis) -> RangeInclusive<f64> {
    let pulse = f64::from(servo::neutral(params)[axis.index()].0);
    pulse - 1.0..=pulse + 0.5
}

/// Widths within the servo's travel, us; any other is a runt or a glitch.
const TRAVEL_US: RangeInclusive<f64> = 853.0..=2193.5;
/// Longest time from the end of a burst to the step that works on it.
const HAND_OVER: Ticks = Ticks::from_us(1000);
/// A drone farther than this from its undisturbed flight has not recovered, rad.
const OFF_COURSE_RAD: f64 = 0.1;
/// The last part of a run, in which that is judged.
const END: Ticks = Ticks::from_ms(100);

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ending {
    /// In control, and on course.
    Recovered,
    /// Without control (in failsafe, as a rule), with the rudder at neutral.
    Neutral,
    /// The same behind a reset of the chip.
    Restarted,
    /// Neither, or too late.
    Unsafe(Unsafe),
    /// The program, as the fault had left it, did what the emulated chip does not model: this.
    Unmodelled(String),
}

/// What was unsafe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unsafe {
    /// The rudder was off neutral without valid data for too long.
    Unguarded,
    /// No pulse for this time.
    NoPulse(Ticks),
    /// A pulse of a width, us, that the servo must never see.
    WildPulse(f64),
    /// A pulse off neutral, of this width, us, after the firmware had reported its failsafe.
    PulseInFailsafe(f64),
    /// The chip was reset.
    Reset,
    /// In control, but the drone is this far from the flight without the fault, rad.
    OffCourse(f64),
    /// The firmware ended in a state that is neither control nor failsafe.
    State(Option<StateKind>),
    /// A rudder was driven wrongly for this time.
    Driven(Ticks),
    /// At the end, in no control, a pulse of this width, us, which is not neutral.
    NotNeutral(f64),
}

impl fmt::Display for Unsafe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unguarded => write!(
                f,
                "rudder off neutral without valid data for more than {} ms",
                DEADLINE.as_us() / 1000
            ),
            Self::NoPulse(gap) => write!(f, "no pulse for {:.1} ms", gap.as_us_f64() / 1e3),
            Self::WildPulse(width) => write!(f, "a pulse of {width:.1} us"),
            Self::PulseInFailsafe(width) => write!(f, "a pulse of {width:.1} us in failsafe"),
            Self::Reset => f.write_str("the chip was reset"),
            Self::OffCourse(rad) => write!(f, "in control, but {rad:.2} rad off course"),
            Self::State(Some(state)) => write!(f, "ended in state {state:?}"),
            Self::State(None) => f.write_str("no word from the firmware"),
            Self::Driven(time) => {
                write!(
                    f,
                    "a rudder driven wrongly for {:.0} ms",
                    time.as_us_f64() / 1e3
                )
            }
            Self::NotNeutral(width) => write!(f, "at the end a pulse of {width:.1} us"),
        }
    }
}

/// A run and how it ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The run's kind and number.
    pub case: Case,
    /// When the fault began, s after release.
    pub at_s: f64,
    /// How long it lasted, s.
    pub lasted_s: f64,
    /// What was switched on, in words.
    pub fault: String,
    /// How it ended.
    pub ending: Ending,
    /// Longest time for which the rudder was off neutral without valid data, ms.
    pub unguarded_ms: f64,
    /// Longest time for which a rudder was driven wrongly, ms.
    pub wrong_ms: f64,
    /// Longest time without a pulse behind one that was not neutral, ms.
    pub silent_ms: f64,
    /// The firmware has told, or restarted with a reason.
    pub noticed: bool,
    /// Nothing was noticed, and no pulse was another than without the fault.
    pub harmless: bool,
    /// The firmware's last text.
    pub said: String,
}

/// What was seen of a run.
pub(super) struct Run<'a> {
    pub(super) injected: Ticks,
    pub(super) frame: Ticks,
    /// Of every axis that is steered.
    pub(super) rudders: Vec<Rudder<'a>>,
    /// From the fault on.
    pub(super) truth: &'a GroundTruth,
    /// The flight without the fault.
    pub(super) reference: &'a [Motion],
    pub(super) heartbeats: &'a [Heartbeat],
    /// The chip was reset in the run.
    pub(super) reset: bool,
}

/// What was seen of a rudder's servo.
pub(super) struct Rudder<'a> {
    pub(super) axis: Axis,
    /// Widths of the neutral pulse, us.
    pub(super) neutral_us: RangeInclusive<f64>,
    /// The last pulse before the fault.
    pub(super) before: Option<Pulse>,
    /// From the fault on.
    pub(super) pulses: &'a [Pulse],
}

/// The ending, and the longest time for which a rudder was without valid data.
pub(super) fn judge(run: &Run<'_>) -> (Ending, Ticks) {
    let unguarded = run
        .rudders
        .iter()
        .map(|rudder| run.longest_unguarded(rudder));
    let unguarded = unguarded.max().unwrap_or_default();
    let state = run.heartbeats.last().and_then(|beat| beat.state);
    let reset = run.reset.then_some(Unsafe::Reset);
    let wrong = reset
        .or_else(|| {
            run.rudders
                .iter()
                .find_map(|rudder| run.wrong_pulses(rudder))
        })
        .or_else(|| (unguarded > DEADLINE).then_some(Unsafe::Unguarded));
    let ending = match (wrong, state) {
        (Some(wrong), _) => Ending::Unsafe(wrong),
        (None, Some(StateKind::Active)) => match run.off_course() {
            far if far <= OFF_COURSE_RAD => Ending::Recovered,
            far => Ending::Unsafe(Unsafe::OffCourse(far)),
        },
        (None, Some(StateKind::Failsafe)) => Ending::Neutral,
        (None, state) => Ending::Unsafe(Unsafe::State(state)),
    };
    (ending, unguarded)
}

impl Run<'_> {
    /// The longest time off neutral without valid data: from the fault or the last step on a valid
    /// burst to the next such step or neutral pulse.
    fn longest_unguarded(&self, rudder: &Rudder<'_>) -> Ticks {
        let mut longest = Ticks::ZERO;
        let mut valid = self.valid_steps().peekable();
        let mut last_valid = self.injected;
        let mut off_neutral = rudder
            .before
            .is_some_and(|pulse| !rudder.is_neutral(&pulse));
        for pulse in rudder.pulses {
            while let Some(step) = valid.next_if(|step| *step <= pulse.rise) {
                if off_neutral {
                    longest = longest.max(step.saturating_sub(last_valid));
                }
                last_valid = step;
            }
            if off_neutral {
                longest = longest.max(pulse.rise.saturating_sub(last_valid));
            }
            off_neutral = !rudder.is_neutral(pulse);
        }
        longest
    }

    /// Ends of the steps that worked on a valid burst.
    fn valid_steps(&self) -> impl Iterator<Item = Ticks> {
        self.truth.steps.iter().filter_map(|step| {
            let ended = self.truth.bursts.partition_point(|b| b.end <= step.start);
            let burst = self.truth.bursts.get(ended.checked_sub(1)?)?;
            let used = burst.valid && step.start - burst.end <= HAND_OVER;
            used.then_some(step.end)
        })
    }

    fn wrong_pulses(&self, rudder: &Rudder<'_>) -> Option<Unsafe> {
        let end = self.truth.motion.last()?.time;
        let mut last = rudder.before.map_or(self.injected, |pulse| pulse.rise);
        let failsafe = self
            .heartbeats
            .iter()
            .find(|beat| beat.at >= self.injected && beat.state == Some(StateKind::Failsafe));
        let latest = self.frame + self.frame / 2;
        for pulse in rudder.pulses {
            if pulse.rise.saturating_sub(last) > latest {
                return Some(Unsafe::NoPulse(pulse.rise - last));
            }
            last = pulse.rise;
            let width = pulse.width_us();
            if !TRAVEL_US.contains(&width) {
                return Some(Unsafe::WildPulse(width));
            }
            // The heartbeat may come before the frame that its step belongs to.
            let reported = failsafe.is_some_and(|beat| pulse.rise > beat.at + self.frame);
            if reported && !rudder.is_neutral(pulse) {
                return Some(Unsafe::PulseInFailsafe(width));
            }
        }
        let gap = end.saturating_sub(last);
        (gap > latest + self.frame / 2).then_some(Unsafe::NoPulse(gap))
    }

    /// Largest distance from the flight without the fault at the end of the run, rad.
    fn off_course(&self) -> f64 {
        let Some(end) = self.truth.motion.last().map(|m| m.time) else {
            return f64::INFINITY;
        };
        let last = self.truth.motion_since(end.saturating_sub(END));
        last.iter()
            .map(|motion| {
                let at = self.reference.partition_point(|m| m.time < motion.time);
                self.reference.get(at).map_or(f64::INFINITY, |m| {
                    let roll = m.roll.roll_rad - motion.roll.roll_rad;
                    (m.pitch_rad - motion.pitch_rad).hypot(roll)
                })
            })
            .fold(0.0, f64::max)
    }
}

impl Rudder<'_> {
    fn is_neutral(&self, pulse: &Pulse) -> bool {
        self.neutral_us.contains(&pulse.width_us())
    }
}

/// What was seen of a run with a fault beyond the sensor.
pub(super) struct SystemRun<'a> {
    pub(super) injected: Ticks,
    pub(super) frame: Ticks,
    /// Of every axis that is steered.
    pub(super) rudders: Vec<Rudder<'a>>,
    /// The pulses of the flight without the fault, of the same axes.
    pub(super) reference_pulses: Vec<&'a [Pulse]>,
    /// From the fault on.
    pub(super) truth: &'a GroundTruth,
    /// The flight without the fault.
    pub(super) reference: &'a [Motion],
    pub(super) heartbeats: &'a [Heartbeat],
    /// Resets of the chip since the fault.
    pub(super) resets: &'a [(Ticks, ResetCause)],
    /// The bootloader has the chip, and keeps it: it was asked to by an image that is not to be
    /// run.
    pub(super) given_up: bool,
    /// The host gave orders, which the vehicle obeys by its rules: its course is its own.
    pub(super) commanded: bool,
}

/// What became of such a run.
pub(super) struct Verdict {
    pub(super) ending: Ending,
    /// Longest time for which a rudder was driven wrongly.
    pub(super) wrong: Ticks,
    /// Longest time without a pulse behind one that was not neutral.
    pub(super) silent: Ticks,
    pub(super) noticed: bool,
    pub(super) harmless: bool,
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
pub(super) fn judge_system(run: &SystemRun<'_>) -> Verdict {
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
    let is_active = state.is_none_or(|state| state == StateKind::Active) && run.resets.is_empty();
    let noticed = !run.resets.is_empty()
        || beats
            .clone()
            .any(|beat| beat.state != Some(StateKind::Active));
    let harmless = !noticed
        && rudders().all(|(rudder, reference)| {
            rudder.pulses.iter().all(|pulse| {
                let other = nearest(reference, pulse.rise);
                other.is_some_and(|other| (other.width_us() - pulse.width_us()).abs() <= SAME_US)
            })
        });
    let ending = match run.wrong_end(is_active) {
        Some(wrong) => Ending::Unsafe(wrong),
        None if wrong > WRONG_LIMIT => Ending::Unsafe(Unsafe::Driven(wrong)),
        None if silent > SILENCE_LIMIT && !run.given_up => Ending::Unsafe(Unsafe::NoPulse(silent)),
        None if is_active => Ending::Recovered,
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
    fn wrong_end(&self, is_active: bool) -> Option<Unsafe> {
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
                Some(pulse) if !is_active && !self.commanded => {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bno055::Refresh;
    use crate::observe::ground_truth::{Burst, Roll, Step};

    const ACTIVE: f64 = 1600.0;
    const NEUTRAL: f64 = 1523.6;

    fn ms(ms: u64) -> Ticks {
        Ticks::from_ms(ms)
    }

    /// A second of flight after a fault at 0: a step every 10 ms on a burst that is valid or not, a
    /// pulse every 20 ms.
    fn truth(valid: impl Fn(u64) -> bool, width_us: impl Fn(u64) -> f64) -> GroundTruth {
        let mut truth = GroundTruth::default();
        for time in (10..1000).step_by(10) {
            truth.bursts.push(Burst {
                start: ms(time - 5),
                acknowledged: ms(time - 5),
                end: ms(time),
                refresh: Refresh::default(),
                words: [0; 9],
                valid: valid(time),
                alone: false,
            });
            truth.steps.push(Step {
                start: ms(time) + Ticks::from_us(10),
                end: ms(time + 1),
            });
            if time % 20 == 10 {
                let rise = ms(time + 2);
                truth.pulses.push(Pulse {
                    rise,
                    fall: rise + Ticks::from_secs_f64(width_us(time) * 1e-6),
                });
            }
        }
        truth.motion = motion(0.0);
        truth
    }

    fn motion(pitch_rad: f64) -> Vec<Motion> {
        (0..1000)
            .map(|time| Motion {
                time: ms(time),
                pitch_rad,
                rate_rad_s: 0.0,
                rudder_rad: 0.0,
                crank_rad: 0.0,
                target_rad: 0.0,
                roll: Roll::default(),
            })
            .collect()
    }

    fn beat(at: u64, state: StateKind) -> Heartbeat {
        Heartbeat {
            at: ms(at),
            state: Some(state),
            reason: 0,
            armed: false,
        }
    }

    fn judged(truth: &GroundTruth, heartbeats: &[Heartbeat]) -> (Ending, u64) {
        let rise = Ticks::ZERO;
        let (ending, unguarded) = judge(&Run {
            injected: Ticks::ZERO,
            frame: ms(20),
            rudders: vec![Rudder {
                axis: Axis::Pitch,
                neutral_us: neutral_us(&Params::default(), Axis::Pitch),
                before: Some(Pulse {
                    rise,
                    fall: rise + Ticks::from_us(1600),
                }),
                pulses: &truth.pulses,
            }],
            truth,
            reference: &motion(0.0),
            heartbeats,
            reset: false,
        });
        (ending, unguarded.as_us() / 1000)
    }

    #[test]
    fn a_fault_that_changes_nothing_is_recovered_from() {
        let truth = truth(|_| true, |_| ACTIVE);
        let judged = judged(&truth, &[beat(0, StateKind::Active)]);
        assert_eq!(judged, (Ending::Recovered, 11));
    }

    #[test]
    fn time_counts_from_the_fault_to_the_first_neutral_pulse() {
        let neutral_from =
            |from: u64| truth(|_| false, move |t| if t < from { ACTIVE } else { NEUTRAL });
        let beats = [beat(0, StateKind::Active), beat(80, StateKind::Failsafe)];
        assert_eq!(judged(&neutral_from(90), &beats), (Ending::Neutral, 92));
        let beats = [beat(0, StateKind::Active), beat(180, StateKind::Failsafe)];
        assert_eq!(
            judged(&neutral_from(190), &beats),
            (Ending::Unsafe(Unsafe::Unguarded), 192)
        );
    }

    #[test]
    fn a_valid_step_ends_the_time_and_wrong_data_do_not() {
        let gap = |until: u64| truth(move |t| t < 100 || t >= until, |_| ACTIVE);
        let beats = [beat(0, StateKind::Active)];
        assert_eq!(judged(&gap(200), &beats), (Ending::Recovered, 110));
        assert_eq!(
            judged(&gap(250), &beats).0,
            Ending::Unsafe(Unsafe::Unguarded)
        );
        // With the rudder at neutral nothing is steered by wrong data.
        let resting = truth(|_| false, |_| NEUTRAL);
        assert_eq!(judged(&resting, &beats).0, Ending::Recovered);
    }

    #[test]
    fn pulses_must_go_on_stay_in_the_travel_and_be_neutral_in_failsafe() {
        let active = [beat(0, StateKind::Active)];
        let mut gap = truth(|_| true, |_| ACTIVE);
        gap.pulses.remove(20);
        assert_eq!(
            judged(&gap, &active).0,
            Ending::Unsafe(Unsafe::NoPulse(ms(40)))
        );
        let mut ends = truth(|_| true, |_| ACTIVE);
        ends.pulses.truncate(40);
        assert!(matches!(
            judged(&ends, &active).0,
            Ending::Unsafe(Unsafe::NoPulse(_))
        ));
        let wild = truth(|_| true, |t| if t == 510 { 300.0 } else { ACTIVE });
        assert!(matches!(
            judged(&wild, &active).0,
            Ending::Unsafe(Unsafe::WildPulse(_))
        ));
        let kick = truth(
            |_| true,
            |t| if t < 100 || t == 510 { ACTIVE } else { NEUTRAL },
        );
        assert!(matches!(
            judged(&kick, &[beat(80, StateKind::Failsafe)]).0,
            Ending::Unsafe(Unsafe::PulseInFailsafe(_))
        ));
    }

    #[test]
    fn control_off_course_and_other_states_are_unsafe() {
        let mut lost = truth(|_| true, |_| ACTIVE);
        lost.motion = motion(0.3);
        assert_eq!(
            judged(&lost, &[beat(0, StateKind::Active)]).0,
            Ending::Unsafe(Unsafe::OffCourse(0.3))
        );
        let fine = truth(|_| true, |_| NEUTRAL);
        assert_eq!(
            judged(&fine, &[beat(0, StateKind::Standby)]).0,
            Ending::Unsafe(Unsafe::State(Some(StateKind::Standby)))
        );
        assert_eq!(judged(&fine, &[]).0, Ending::Unsafe(Unsafe::State(None)));
    }
}
