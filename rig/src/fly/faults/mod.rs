//! The campaign of faults: everything that a sensor and its cable do wrong, at random instants of a
//! flight.
//!
//! One flight is flown without a fault, with snapshots of the whole rig every 40 ms. Every run
//! continues from a copy of one of them to its own instant, switches its fault on for 5 to 500 ms
//! (a glitch for 4 to 40 ms), and watches for 0.7 s more. A run is judged by what can be seen from
//! outside: the pulses on the servos' wires, the drone's true tilt, and the state that the firmware
//! reports. How a run ends:
//!
//! | ending | means |
//! |---|---|
//! | recovered | control is still active at the end, and the drone's true tilt is within 0.1 rad of where the flight without the fault had it, over the last 100 ms |
//! | neutral | the firmware is in failsafe, and no pulse after it said so was off neutral |
//! | unsafe | anything else; and either of the above with a pulse missing, a pulse outside the travel, a reset of the chip, or a rudder that was off neutral without valid data for more than 150 ms |
//!
//! A rudder is *without valid data* from the last control step that worked on a valid burst, or
//! from the fault's beginning where there has been none since. A burst is valid if it brought,
//! complete, the words that a faultless sensor and cable would have given at that moment, to within
//! 2 m/s^2, 5 uT and 4 deg/s: a sample as wrong as that moves the rudder by less than 2 degrees,
//! once. The time ends with the rising edge of the first neutral pulse, or with the next such step;
//! for a fault that stays it is the time from the fault to the neutral pulse. It counts whether or
//! not the firmware noticed that its data were wrong.

mod judge;

pub use judge::{Ending, Outcome, Unsafe, neutral_us};

use crate::bno055::{Fault, FaultKind};
use crate::fly::flight::{FlightError, Ready};
use crate::observe::ground_truth::Motion;
use crate::random::{Stream, generator};
use client::StateKind;
use judge::{Rudder, Run, judge};
use rand::Rng;
use samd21::board::Ticks;
use std::ops::RangeInclusive;
use tvc_nano::{Axis, Params};

/// Longest time for which a rudder may be off neutral without valid data.
pub const DEADLINE: Ticks = Ticks::from_ms(150);
/// Pitch from which the flight begins, and roll where that is steered, rad, and the rate at
/// release, rad/s.
const START_RAD: [f64; Axis::COUNT] = [0.4, 0.3];
const START_RATE_RAD_S: f64 = 0.2;
/// Rest after the tilt, so that the estimator has settled.
const REST: Ticks = Ticks::from_ms(3000);
/// Faults begin in this time after release: from the first answer of the rudder until long after
/// the drone is upright.
const EARLIEST: Ticks = Ticks::from_ms(60);
const LATEST: Ticks = Ticks::from_ms(1600);
/// Time between two snapshots.
const SNAPSHOTS: Ticks = Ticks::from_ms(40);
/// How long a fault lasts at most, ms.
const LONGEST_MS: f64 = 500.0;
/// How long faults last that are no glitches, ms: as likely between 5 and 50 as between 50 and 500.
const LASTING_MS: RangeInclusive<f64> = 5.0..=LONGEST_MS;
/// Glitches of the cable, ms: short enough to be ridden out.
const GLITCH_MS: RangeInclusive<f64> = 4.0..=40.0;
/// What a glitch of the cable may be: nobody acknowledges, a line is held, nobody drives the data
/// line, the sensor stretches the clock.
pub const GLITCHES: [FaultKind; 5] = [
    FaultKind::Naks,
    FaultKind::SdaStuck,
    FaultKind::SclStuck,
    FaultKind::AllOnes,
    FaultKind::LongStretch,
];
/// Time for which a run is watched after its fault.
const WATCHED: Ticks = Ticks::from_ms(700);

/// A flight without a fault, with snapshots to fork from.
pub struct Campaign {
    seed: u64,
    glitches: bool,
    frame: Ticks,
    /// Widths of the neutral pulse of every axis that is steered, us.
    neutral_us: Vec<(Axis, RangeInclusive<f64>)>,
    released: Ticks,
    snapshots: Vec<Ready>,
    /// The true motion of the whole flight.
    motion: Vec<Motion>,
}

/// A run of the campaign; kind and number decide its fault, instant and length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// What fails.
    pub kind: FaultKind,
    /// Number of the run among those of this kind.
    pub number: u32,
}

impl Campaign {
    /// Flies the flight that is to be disturbed, from a rig in standby whose servo frame has
    /// `frame_hz`.
    ///
    /// # Errors
    /// The rig stopped, or the image refuses.
    pub fn new(ready: &Ready, frame_hz: f64, seed: u64) -> Result<Self, FlightError> {
        let params = reported_parameters(ready)?;
        let axes = params.axes().iter();
        let neutral_us = axes.map(|axis| (*axis, neutral_us(&params, *axis)));
        let neutral_us: Vec<_> = neutral_us.collect();
        let [pitch_rad, roll_rad] = START_RAD;
        let tilt_rad = [pitch_rad, if neutral_us.len() > 1 { roll_rad } else { 0.0 }];
        let mut base = ready.clone();
        let Ready { rig, station, .. } = &mut base;
        rig.environment_mut().tilt_clamp_to(tilt_rad);
        while !rig.environment().clamp_rests() {
            station.run(rig, Ticks::from_ms(20))?;
        }
        station.run(rig, REST)?;
        station.arm(rig)?;
        rig.environment_mut().truth_mut().clear();
        station.release(rig, START_RATE_RAD_S)?;
        station.begin_measurement();
        let released = rig.now();
        let mut snapshots = Vec::new();
        station.run(rig, EARLIEST)?;
        while base.rig.now() < released + LATEST {
            snapshots.push(base.clone());
            base.station.run(&mut base.rig, SNAPSHOTS)?;
        }
        let rest = Ticks::from_secs_f64(LONGEST_MS / 1e3) + WATCHED + SNAPSHOTS;
        base.station.run(&mut base.rig, rest)?;
        // It must still be in control: this does not wait.
        let Ready { rig, station, .. } = &mut base;
        station.wait_for_state(rig, Ticks::ZERO, StateKind::Active)?;
        Ok(Self {
            seed,
            glitches: false,
            frame: Ticks::from_secs_f64(1.0 / frame_hz),
            neutral_us,
            released,
            snapshots,
            motion: base.rig.truth().motion.clone(),
        })
    }

    /// The campaign with glitches: faults that last for 4 to 40 ms, and in which no byte at all is
    /// acknowledged.
    #[must_use]
    pub fn of_glitches(self) -> Self {
        Self {
            glitches: true,
            ..self
        }
    }

    /// Carries out a run. The same case of the same campaign always ends in the same way.
    ///
    /// # Errors
    /// The rig stopped: the chip did something that its model does not cover.
    pub fn run(&self, case: Case) -> Result<Outcome, FlightError> {
        let mut dice = generator(
            self.seed ^ (case.kind as u64) << 48 ^ u64::from(case.number) << 16,
            Stream::Campaign,
        );
        let at = self.released + Ticks(dice.random_range(EARLIEST.0..LATEST.0));
        let lasting_ms = if self.glitches { GLITCH_MS } else { LASTING_MS };
        let (shortest_ms, longest_ms) = (lasting_ms.start(), lasting_ms.end());
        let octaves = (longest_ms / shortest_ms).ln() * dice.random_range(0.0..1.0);
        let lasted = Ticks::from_secs_f64(shortest_ms / 1e3 * f64::exp(octaves));
        let mut fault = case.kind.draw(&mut dice);
        if self.glitches
            && let Fault::Naks { probability } = &mut fault
        {
            *probability = 1.0;
        }

        let after = self.snapshots.partition_point(|s| s.rig.now() <= at);
        let mut fork = self.snapshots[after.saturating_sub(1)].clone();
        let Ready { rig, station, .. } = &mut fork;
        station.run(rig, at.saturating_sub(rig.now()))?;
        let before = Axis::ALL.map(|axis| rig.truth().pulses_of(axis).last().copied());
        let resets = rig.resets().len();
        rig.environment_mut().truth_mut().clear();
        let injected = rig.now();
        rig.inject(fault);
        station.run(rig, lasted)?;
        rig.clear(fault);
        station.run(rig, WATCHED)?;

        let truth = rig.truth();
        let (ending, unguarded) = judge(&Run {
            injected,
            frame: self.frame,
            rudders: self
                .neutral_us
                .iter()
                .map(|(axis, neutral_us)| Rudder {
                    neutral_us: neutral_us.clone(),
                    before: before[axis.index()],
                    pulses: truth.pulses_of(*axis),
                })
                .collect(),
            truth,
            reference: &self.motion,
            heartbeats: &station.received().heartbeats,
            reset: rig.resets().len() > resets,
        });
        Ok(Outcome {
            case,
            at_s: (injected - self.released).as_secs_f64(),
            lasted_s: lasted.as_secs_f64(),
            fault,
            ending,
            unguarded_ms: unguarded.as_us_f64() / 1e3,
            said: station.last_text().unwrap_or_default().to_owned(),
        })
    }
}

/// The parameters that the image reports. A fork is asked, so that `ready` itself stays as it is.
fn reported_parameters(ready: &Ready) -> Result<Params, FlightError> {
    let mut fork = ready.clone();
    fork.station.list_parameters(&mut fork.rig)?;
    let mut params = Params::default();
    for (name, value) in &fork.station.received().parameters {
        let known = params.set(name, *value);
        debug_assert!(known.is_ok(), "{known:?}");
    }
    Ok(params)
}
