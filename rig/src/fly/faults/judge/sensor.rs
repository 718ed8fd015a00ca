//! Faults of the sensor and its cable: whether the rudder was off neutral without valid data.

use client::StateKind;
use samd21::board::Ticks;

use super::{Record, Rudder, TRAVEL_US};
use crate::fly::faults::{DEADLINE, Ending, Unsafe, Verdict};

/// A drone farther than this from its undisturbed flight has not recovered, rad.
const OFF_COURSE_RAD: f64 = 0.1;
/// The last part of a run, in which that is judged.
const END: Ticks = Ticks::from_ms(100);

/// The verdict on a run with a fault of the sensor or its cable.
pub(crate) fn judge_sensor(run: &Record<'_>) -> Verdict {
    let unguarded = run.rudders.iter().map(|rudder| run.longest_unguarded(rudder));
    let unguarded = unguarded.max().unwrap_or_default();
    let state = run.heartbeats.last().and_then(|beat| beat.state);
    let reset = (!run.resets.is_empty()).then_some(Unsafe::Reset);
    let wrong = reset
        .or_else(|| run.rudders.iter().find_map(|rudder| run.wrong_pulses(rudder)))
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
    Verdict { unguarded, noticed: ending == Ending::Neutral, ..Verdict::new(ending) }
}

impl Record<'_> {
    /// The longest time off neutral without valid data: from the fault or the last step on a valid
    /// burst to the next such step or neutral pulse.
    fn longest_unguarded(&self, rudder: &Rudder<'_>) -> Ticks {
        let mut longest = Ticks::ZERO;
        let mut valid = self.valid_steps().peekable();
        let mut last_valid = self.injected;
        let mut off_neutral = rudder.before.is_some_and(|pulse| !rudder.is_neutral(&pulse));
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
        let steps = self.truth.steps.iter();
        let valid = steps.filter(|step| self.truth.burst_of(step).is_some_and(|burst| burst.valid));
        valid.map(|step| step.end)
    }

    fn wrong_pulses(&self, rudder: &Rudder<'_>) -> Option<Unsafe> {
        let end = self.truth.motion.last()?.time;
        if let Some(stray) = rudder.strays(self.frame, end).first() {
            return Some(stray.what);
        }
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
                    let [pitch, roll] = [0, 1].map(|axis| m.tilt_rad[axis] - motion.tilt_rad[axis]);
                    pitch.hypot(roll)
                })
            })
            .fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::super::neutral_us;
    use super::super::tests::{ACTIVE, FRAME, NEUTRAL, beat, cut, motion, ms, pulse};
    use super::*;
    use crate::ground_station::Heartbeat;
    use crate::observe::ground_truth::{Burst, GroundTruth, Step};
    use tvc_nano::{Axis, Params};

    /// A second of flight after a fault at 0: a step every 10 ms on a burst that is valid or not, a
    /// pulse every 20 ms.
    fn truth(valid: impl Fn(u64) -> bool, width_us: impl Fn(u64) -> f64) -> GroundTruth {
        let mut truth = GroundTruth::default();
        for time in (10..1000).step_by(10) {
            truth.bursts.push(Burst {
                start: ms(time - 5),
                acknowledged: ms(time - 5),
                end: ms(time),
                valid: valid(time),
                ..Burst::default()
            });
            truth.steps.push(Step { start: ms(time) + Ticks::from_us(10), end: ms(time + 1) });
            if time % 20 == 10 {
                truth.pulses[0].push(pulse(ms(time + 2), width_us(time)));
            }
        }
        truth.motion = motion(0.0);
        truth
    }

    fn judged(truth: &GroundTruth, heartbeats: &[Heartbeat]) -> (Ending, u64) {
        let verdict = judge_sensor(&Record {
            injected: Ticks::ZERO,
            frame: FRAME,
            rudders: vec![Rudder {
                axis: Axis::Pitch,
                neutral_us: neutral_us(&Params::default(), Axis::Pitch),
                before: Some(pulse(Ticks::ZERO, ACTIVE)),
                pulses: &truth.pulses[0],
                high: truth.high[0],
                clock_error: 0.0,
            }],
            truth,
            reference: &motion(0.0),
            heartbeats,
            resets: &[],
        });
        (verdict.ending, verdict.unguarded.as_us() / 1000)
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
        assert_eq!(judged(&neutral_from(190), &beats), (Ending::Unsafe(Unsafe::Unguarded), 192));
    }

    #[test]
    fn a_valid_step_ends_the_time_and_wrong_data_do_not() {
        let gap = |until: u64| truth(move |t| t < 100 || t >= until, |_| ACTIVE);
        let beats = [beat(0, StateKind::Active)];
        assert_eq!(judged(&gap(180), &beats), (Ending::Recovered, 90));
        assert_eq!(judged(&gap(250), &beats).0, Ending::Unsafe(Unsafe::Unguarded));
        // With the rudder at neutral nothing is steered by wrong data.
        let resting = truth(|_| false, |_| NEUTRAL);
        assert_eq!(judged(&resting, &beats).0, Ending::Recovered);
    }

    #[test]
    fn pulses_must_go_on_stay_in_the_travel_and_be_neutral_in_failsafe() {
        let active = [beat(0, StateKind::Active)];
        let mut gap = truth(|_| true, |_| ACTIVE);
        gap.pulses[0].remove(20);
        assert_eq!(judged(&gap, &active).0, Ending::Unsafe(Unsafe::NoPulse(ms(40))));
        let mut ends = truth(|_| true, |_| ACTIVE);
        ends.pulses[0].truncate(40);
        assert!(matches!(judged(&ends, &active).0, Ending::Unsafe(Unsafe::NoPulse(_))));
        let wild = truth(|_| true, |t| if t == 510 { 300.0 } else { ACTIVE });
        assert!(matches!(judged(&wild, &active).0, Ending::Unsafe(Unsafe::WildPulse(_))));
        let mut cut_one = truth(|_| true, |_| ACTIVE);
        cut_one.pulses[0][20] = cut(cut_one.pulses[0][20], 900.0);
        assert_eq!(judged(&cut_one, &active).0, Ending::Unsafe(Unsafe::CutPulse(900.0)));
        let kick = truth(|_| true, |t| if t < 100 || t == 510 { ACTIVE } else { NEUTRAL });
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
