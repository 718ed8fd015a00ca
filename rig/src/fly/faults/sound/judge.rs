//! What of a sound vehicle's run was an alarm.

use std::fmt;
use std::ops::RangeInclusive;

use client::StateKind;
use samd21::board::Ticks;
use samd21::peripherals::ResetCause;
use tvc_nano::Axis;
use tvc_nano::failsafe::ReasonKind;

use super::super::Phase;
use super::super::judge::Rudder;
use crate::ground_station::Heartbeat;
use crate::observe::ground_truth::{GroundTruth, Step};
use crate::observe::measure::LoopTiming;

/// Largest deviation of a control period, us.
pub(super) const JITTER_US: f64 = 100.0;
/// Longest time from step to step: two and a half of the slowest ticks.
const STEP_GAP: Ticks = Ticks::from_us(25_000);

/// The alarms of a run. A sound vehicle has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Alarms {
    /// Resets of the chip.
    pub resets: usize,
    /// Failsafes that no order and no tilt explains.
    pub failsafes: usize,
    /// Latched faults.
    pub latches: usize,
    /// The state at the end is another than that of the phase, without either.
    pub states: usize,
    /// Orders that a sound vehicle obeys, refused: to arm, to release, to save.
    pub refusals: usize,
    /// Bursts that were refused.
    pub refused: usize,
    /// Steps that were taken without a burst, or not at all.
    pub lost: usize,
    /// The loop did not keep its time.
    pub late: usize,
    /// Parameters that are missing, or are others than were set or stored.
    pub parameters: usize,
    /// Pulses that nobody asked for, and those off neutral without control.
    pub pulses: usize,
    /// More about them, in words.
    pub details: Vec<String>,
}

impl Alarms {
    /// The counts, each with what it counts.
    pub fn counts(&self) -> [(&'static str, usize); 10] {
        [
            ("resets", self.resets),
            ("failsafes", self.failsafes),
            ("latched faults", self.latches),
            ("other states", self.states),
            ("orders refused", self.refusals),
            ("bursts refused", self.refused),
            ("steps lost", self.lost),
            ("loops late", self.late),
            ("parameters lost", self.parameters),
            ("pulses", self.pulses),
        ]
    }

    /// Whether there is any.
    pub fn is_any(&self) -> bool {
        self.counts().iter().any(|(_, count)| *count > 0)
    }
}

impl fmt::Display for Alarms {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = self.counts().into_iter().filter(|(_, count)| *count > 0);
        let counts: Vec<_> = counts.map(|(what, count)| format!("{what} {count}")).collect();
        f.write_str(&counts.join(", "))?;
        if !self.details.is_empty() {
            write!(f, " ({})", self.details.join("; "))?;
        }
        Ok(())
    }
}

/// What was seen of a run.
pub(super) struct Seen<'a> {
    pub(super) phase: Phase,
    /// The host's orders were obeyed: state, tilt and timing are its own.
    pub(super) commanded: bool,
    /// The host changed parameters: neutral is not what it was.
    pub(super) sets: bool,
    /// Parameters were stored, for which the processor stands still: steps go without their bursts.
    pub(super) saves: bool,
    /// The sensor fell to CONFIG mode: a failsafe by that is right.
    pub(super) resets_sensor: bool,
    pub(super) begin: Ticks,
    pub(super) end: Ticks,
    pub(super) frame: Ticks,
    /// Relative error of the main clock.
    pub(super) clock_error: f64,
    pub(super) truth: &'a GroundTruth,
    /// Of every axis that is steered, the widths of the neutral pulse at the begin.
    pub(super) neutral_us: &'a [(Axis, RangeInclusive<f64>)],
    /// From the begin on, the one before it first.
    pub(super) heartbeats: &'a [Heartbeat],
    pub(super) texts: Vec<&'a str>,
    pub(super) resets: &'a [(Ticks, ResetCause)],
    /// What the vehicle has told of its steps without a usable sample, and when: the last before
    /// the begin, and the last of all.
    pub(super) missed: Option<[(Ticks, u16); 2]>,
}

impl Seen<'_> {
    /// The alarms, but for those of orders and parameters.
    pub(super) fn alarms(&self) -> Alarms {
        let mut alarms = Alarms { resets: self.resets.len(), ..Alarms::default() };
        alarms.details.extend(self.resets.iter().take(2).map(|(at, cause)| {
            let since = at.saturating_sub(self.begin).as_secs_f64();
            format!("{cause:?} reset at {since:.3} s")
        }));
        self.judge_states(&mut alarms);
        self.judge_steps(&mut alarms);
        self.judge_pulses(&mut alarms);
        let bad = alarms.resets + alarms.failsafes + alarms.latches + alarms.states;
        if bad > 0 {
            let states = ["failsafe", "latched", "self-test"];
            let mut said = self.texts.clone();
            said.retain(|text| states.iter().any(|state| text.starts_with(state)));
            said.dedup();
            // What has a reason first.
            said.sort_by_key(|text| text.starts_with("self-test"));
            alarms.details.extend(said.iter().map(|text| format!("\"{text}\"")).take(4));
        }
        alarms
    }

    fn judge_states(&self, alarms: &mut Alarms) {
        let states = self.heartbeats.windows(2).filter_map(|pair| {
            let [before, after] = pair else { return None };
            (before.state != after.state || before.reason != after.reason).then_some(after)
        });
        for beat in states {
            match beat.state {
                Some(StateKind::Failsafe) if !self.excuses(beat.reason) => alarms.failsafes += 1,
                Some(StateKind::Latched) => alarms.latches += 1,
                _ => {}
            }
        }
        let last = self.heartbeats.last().and_then(|beat| beat.state);
        let is_right = match last {
            Some(StateKind::Failsafe) if self.resets_sensor => true,
            Some(state) => self.ends_in(state),
            None => false,
        };
        let explained = alarms.failsafes + alarms.latches + alarms.resets > 0;
        if !is_right && !self.commanded && !explained {
            alarms.states += 1;
            alarms.details.push(format!("ended in {last:?}"));
        }
    }

    fn ends_in(&self, state: StateKind) -> bool {
        match self.phase {
            // It has had time enough.
            Phase::Start => state == StateKind::Standby,
            phase => phase.has(state),
        }
    }

    /// Whether a failsafe with this reason is no false alarm.
    fn excuses(&self, reason: u8) -> bool {
        let is = |kind: ReasonKind| reason == kind as u8;
        let ordered = self.commanded && (is(ReasonKind::Tilt) || is(ReasonKind::HostSilent));
        self.resets_sensor || ordered
    }

    /// Steps without a sample: of those the vehicle counts, which had a burst and refused it. Where
    /// somebody resets the chip, it counts anew.
    fn judge_steps(&self, alarms: &mut Alarms) {
        if self.resets_sensor || self.saves || !self.resets.is_empty() {
            return;
        }
        let mut lost = self.gaps();
        if let Some([(from, before), (to, after)]) = self.missed {
            let missed = usize::from(after.wrapping_sub(before));
            let without = self.without_burst(from, to);
            alarms.refused = missed.saturating_sub(without);
            lost += missed.min(without);
        }
        if alarms.refused > 0 {
            alarms.details.push(self.largest_changes());
        }
        if self.commanded {
            return;
        }
        alarms.lost = lost;
        if matches!(self.phase, Phase::Armed | Phase::Flight) {
            let timing = LoopTiming::over(self.truth, self.begin..self.end);
            if timing.jitter_us_max > JITTER_US {
                alarms.late += 1;
                let jitter_us = timing.jitter_us_max;
                alarms.details.push(format!("a period {jitter_us:.0} us off"));
            }
        }
    }

    fn within(&self, from: Ticks, to: Ticks) -> &[Step] {
        let steps = &self.truth.steps;
        let at = |time| steps.partition_point(|step| step.start < time);
        &steps[at(from)..at(to)]
    }

    /// Steps that worked on no burst.
    fn without_burst(&self, from: Ticks, to: Ticks) -> usize {
        self.within(from, to).iter().filter(|step| self.truth.burst_of(step).is_none()).count()
    }

    /// Steps that did not come at all.
    fn gaps(&self) -> usize {
        let steps = self.within(self.begin, self.end).windows(2);
        steps.filter(|pair| pair[1].start - pair[0].start > STEP_GAP).count()
    }

    /// The largest changes from burst to burst: what a rule may have refused.
    fn largest_changes(&self) -> String {
        let mut most = [0; 3];
        for pair in self.truth.bursts.windows(2) {
            for (word, (from, to)) in pair[0].words.iter().zip(pair[1].words).enumerate() {
                most[word / 3] = from.abs_diff(to).max(most[word / 3]);
            }
        }
        let [acc, mag, gyr] = most;
        format!("words changed by up to {acc}, {mag}, {gyr} counts")
    }

    /// Pulses that nobody asked for; those off neutral where there is no control; and rests between
    /// two that are too long.
    fn judge_pulses(&self, alarms: &mut Alarms) {
        let rudders = self.neutral_us.iter().map(|(axis, neutral_us)| {
            Rudder {
                axis: *axis,
                neutral_us: neutral_us.clone(),
                before: None,
                // Where the power was cut before the begin, it has cut a pulse.
                pulses: self.truth.pulses_since(*axis, self.begin),
                high: self.truth.high[axis.index()],
                clock_error: self.clock_error,
            }
        });
        let is_at_rest = self.phase != Phase::Flight && !self.sets;
        let latest = self.frame + self.frame / 2;
        for rudder in rudders {
            let strays = rudder.strays(self.frame, self.end);
            let mut wrong: Vec<_> = strays.iter().map(|stray| stray.what.to_string()).collect();
            if !self.commanded && is_at_rest {
                let off = rudder.pulses.iter();
                let off = off.filter(|pulse| !rudder.is_about_neutral(pulse));
                wrong.extend(off.map(|pulse| format!("a pulse of {:.1} us", pulse.width_us())));
            }
            if !self.commanded && self.phase != Phase::Start {
                let rests = rudder.pulses.windows(2).map(|pair| pair[1].rise - pair[0].rise);
                let rests = rests.filter(|rest| *rest > latest);
                wrong.extend(
                    rests.map(|rest| format!("no pulse for {:.1} ms", rest.as_us_f64() / 1e3)),
                );
            }
            alarms.pulses += wrong.len();
            alarms.details.extend(wrong.into_iter().take(2));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::judge::tests::{FRAME, NEUTRAL, beat, cut, motion, ms, pulse};
    use super::*;
    use crate::observe::ground_truth::Burst;

    /// A second of a sound vehicle, with what is to be wrong in it.
    struct Sound {
        phase: Phase,
        commanded: bool,
        sets: bool,
        saves: bool,
        resets_sensor: bool,
        truth: GroundTruth,
        beats: Vec<Heartbeat>,
        resets: Vec<(Ticks, ResetCause)>,
        missed: u16,
    }

    impl Sound {
        fn new(phase: Phase, state: StateKind) -> Self {
            let mut truth = GroundTruth::default();
            for time in (10..1000).step_by(10) {
                truth.bursts.push(Burst {
                    start: ms(time - 5),
                    acknowledged: ms(time - 5),
                    end: ms(time),
                    valid: true,
                    ..Burst::default()
                });
                truth.steps.push(Step { start: ms(time) + Ticks::from_us(20), end: ms(time + 1) });
            }
            truth.pulses[0] = (0..50).map(|frame| pulse(ms(20 * frame), NEUTRAL)).collect();
            truth.motion = motion(0.0);
            Self {
                phase,
                commanded: false,
                sets: false,
                saves: false,
                resets_sensor: false,
                truth,
                beats: vec![beat(0, state), beat(900, state)],
                resets: Vec::new(),
                missed: 0,
            }
        }

        fn in_flight() -> Self {
            Self::new(Phase::Flight, StateKind::Active)
        }

        fn alarms(&self) -> Alarms {
            let neutral =
                super::super::super::neutral_us(&tvc_nano::Params::default(), Axis::Pitch);
            Seen {
                phase: self.phase,
                commanded: self.commanded,
                sets: self.sets,
                saves: self.saves,
                resets_sensor: self.resets_sensor,
                begin: ms(0),
                end: ms(1000),
                frame: FRAME,
                clock_error: 0.0,
                truth: &self.truth,
                neutral_us: &[(Axis::Pitch, neutral)],
                heartbeats: &self.beats,
                texts: vec!["hello", "failsafe: why"],
                resets: &self.resets,
                missed: Some([(ms(0), 65_535), (ms(1000), 65_535_u16.wrapping_add(self.missed))]),
            }
            .alarms()
        }

        /// Alarms by what they count.
        fn counts(&self) -> Vec<(&'static str, usize)> {
            let counts = self.alarms().counts().into_iter();
            counts.filter(|(_, count)| *count > 0).collect()
        }
    }

    #[test]
    fn a_sound_second_has_no_alarm_in_any_phase() {
        for (phase, state) in [
            (Phase::Start, StateKind::Standby),
            (Phase::Standby, StateKind::Standby),
            (Phase::Armed, StateKind::Armed),
            (Phase::Flight, StateKind::Active),
            (Phase::Failsafe, StateKind::Failsafe),
        ] {
            let alarms = Sound::new(phase, state).alarms();
            assert!(!alarms.is_any(), "{phase}: {alarms}");
        }
    }

    #[test]
    fn resets_failsafes_and_latched_faults_are_alarms() {
        let mut run = Sound::in_flight();
        run.resets.push((ms(500), ResetCause::Watchdog));
        run.beats.push(beat(950, StateKind::Latched));
        assert_eq!(run.counts(), [("resets", 1), ("latched faults", 1)]);
        let said = run.alarms().to_string();
        assert!(said.contains("Watchdog reset at 0.500 s; \"failsafe: why\""), "{said}");
        let mut run = Sound::in_flight();
        run.beats
            .push(Heartbeat { reason: ReasonKind::Sensor as u8, ..beat(950, StateKind::Failsafe) });
        assert_eq!(run.counts(), [("failsafes", 1)]);
        run.resets_sensor = true;
        assert_eq!(run.counts(), []);
        // Orders explain a tilt, and nothing of the sensor.
        (run.resets_sensor, run.commanded) = (false, true);
        assert_eq!(run.counts(), [("failsafes", 1)]);
        run.beats[2].reason = ReasonKind::Tilt as u8;
        assert_eq!(run.counts(), []);
        run.commanded = false;
        assert_eq!(run.counts(), [("failsafes", 1)]);
        // A start that does not come to standby.
        assert_eq!(Sound::new(Phase::Start, StateKind::SelfTest).counts(), [("other states", 1)]);
    }

    #[test]
    fn a_step_with_a_burst_and_without_a_sample_has_refused_it() {
        let mut run = Sound::in_flight();
        run.missed = 2;
        assert_eq!(run.counts(), [("bursts refused", 2)]);
        // One of the two had none.
        run.truth.bursts.remove(50);
        assert_eq!(run.counts(), [("bursts refused", 1), ("steps lost", 1), ("loops late", 1)]);
        // While the processor stands still for a save, both may be.
        run.saves = true;
        assert_eq!(run.counts(), []);
    }

    #[test]
    fn the_loop_goes_on_in_time() {
        let mut run = Sound::in_flight();
        run.truth.bursts[50].acknowledged += Ticks::from_us(150);
        assert_eq!(run.counts(), [("loops late", 1)]);
        let mut run = Sound::in_flight();
        run.truth.steps.drain(50..52);
        assert_eq!(run.counts(), [("steps lost", 1)]);
    }

    #[test]
    fn pulses_are_those_that_were_asked_for_and_neutral_without_control() {
        let mut run = Sound::new(Phase::Armed, StateKind::Armed);
        run.truth.pulses[0][7] = pulse(run.truth.pulses[0][7].rise, NEUTRAL + 5.0);
        assert_eq!(run.counts(), [("pulses", 1)]);
        run.sets = true;
        assert_eq!(run.counts(), []);
        let mut run = Sound::in_flight();
        run.truth.pulses[0][7] = pulse(run.truth.pulses[0][7].rise, NEUTRAL + 5.0);
        assert_eq!(run.counts(), []);
        run.truth.pulses[0][8] = cut(run.truth.pulses[0][8], 900.0);
        run.truth.pulses[0].remove(20);
        assert_eq!(run.counts(), [("pulses", 2)]);
    }
}
