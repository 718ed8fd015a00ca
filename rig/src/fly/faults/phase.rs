//! What the vehicle does when a fault begins, and how it comes to do that.

use std::collections::BTreeSet;
use std::ops::Range;

use client::{StateKind, request};
use samd21::board::Ticks;
use tvc_nano::store::{self, Loaded};
use tvc_nano::{Axis, Params};

use super::system;
use crate::bno055::Fault;
use crate::fly::flight::{ARM_PATIENCE, FlightError, Ready, Stage};
use crate::named_enum::named_enum;
use crate::observe::ground_truth::{Motion, Pulse};
use crate::rig::Rig;

named_enum! {
    /// What the vehicle does when a fault begins. Whatever it does, it is held at a tilt, so that a
    /// rudder under control would not be at neutral, or flies from there.
    Phase, "phase";
    /// It starts: from power-on until it could be armed, but for the time before its watchdog runs.
    Start = "start",
    /// It could be armed.
    Standby = "standby",
    /// It stores its parameters, in standby.
    Saving = "saving",
    /// It is armed, and not released.
    Armed = "armed",
    /// It is under control, from the first answer of the rudder until long after it is upright.
    Flight = "flight",
    /// The sensor has failed in flight, and is back.
    Failsafe = "failsafe",
}

/// Rest after the tilt, so that the estimator has settled.
const REST: Ticks = Ticks::from_ms(3000);
const START_RATE_RAD_S: f64 = 0.2;
/// Instants in flight, since the release.
const IN_FLIGHT: Range<Ticks> = Ticks::from_ms(60)..Ticks::from_ms(1600);
/// Instants in a phase that goes on for as long as nobody does anything, since its begin.
const AT_REST: Range<Ticks> = Ticks::ZERO..Ticks::from_ms(1000);
/// From here after power-on on, the watchdog runs. Until then RAM is cleared, at 1 MHz, and the
/// oscillators start; nothing ends a program that hangs there, before it has sent a pulse.
const WATCHED_FROM: Ticks = Ticks::from_ms(30);
/// Longest time from power-on to standby.
const START_PATIENCE: Ticks = Ticks::from_ms(8000);
/// Time between two snapshots.
const SNAPSHOTS: Ticks = Ticks::from_ms(40);

impl Phase {
    /// Whether a vehicle that says it is in `state` goes on as if there had been no fault.
    pub(super) fn has(self, state: StateKind) -> bool {
        match self {
            Self::Start => {
                matches!(state, StateKind::Boot | StateKind::SelfTest | StateKind::Standby)
            }
            Self::Standby | Self::Saving => state == StateKind::Standby,
            Self::Armed => state == StateKind::Armed,
            Self::Flight => state == StateKind::Active,
            Self::Failsafe => state == StateKind::Failsafe,
        }
    }

    /// Brings a vehicle in standby to the phase's begin. Gives the instants, counted from there, at
    /// which faults may begin.
    pub(super) fn enter(
        self,
        ready: &mut Ready,
        tilt_rad: [f64; Axis::COUNT],
    ) -> Result<Range<Ticks>, FlightError> {
        ready.rest_at(tilt_rad)?;
        if matches!(self, Self::Armed | Self::Flight | Self::Failsafe) {
            ready.arm(Stage::Tilt, ARM_PATIENCE, &mut |_| {})?;
        }
        let Ready { rig, station, .. } = &mut *ready;
        match self {
            Self::Start => {
                station.order(rig, request::SAVE)?;
                rig.power_cycle();
                station.begin_measurement();
                let mut fork = ready.clone();
                let begun = fork.rig.now();
                let heard = fork.station.received().heartbeats.len();
                let Ready { rig, station, .. } = &mut fork;
                station.wait(rig, START_PATIENCE, "standby", |received| {
                    let mut since = received.heartbeats.iter().skip(heard);
                    since.any(|beat| beat.state == Some(StateKind::Standby))
                })?;
                Ok(WATCHED_FROM..rig.now() - begun)
            }
            Self::Standby | Self::Armed => Ok(AT_REST),
            Self::Saving => {
                station.set_parameter(rig, "PID_KP", 0.25)?;
                let mut fork = ready.clone();
                let begun = fork.rig.now();
                fork.station.order(&mut fork.rig, request::SAVE)?;
                let took = fork.rig.now() - begun;
                ready.station.request_save(&mut ready.rig);
                Ok(Ticks::ZERO..took)
            }
            Self::Flight => {
                station.release(rig, START_RATE_RAD_S)?;
                station.begin_measurement();
                Ok(IN_FLIGHT)
            }
            Self::Failsafe => {
                station.release(rig, START_RATE_RAD_S)?;
                station.run(rig, IN_FLIGHT.start)?;
                rig.inject(Fault::Unplugged);
                station.wait_for_state(rig, AT_REST.end, StateKind::Failsafe)?;
                rig.clear(Fault::Unplugged);
                rig.environment.catch();
                ready.rest_at(tilt_rad)?;
                Ok(AT_REST)
            }
        }
    }
}

impl Ready {
    /// Lets the clamp bring the drone to a tilt, and lets it rest there.
    fn rest_at(&mut self, tilt_rad: [f64; Axis::COUNT]) -> Result<(), FlightError> {
        let Self { rig, station, .. } = self;
        rig.environment.tilt_clamp_to(tilt_rad);
        while !rig.environment.clamp_rests() {
            station.run(rig, Ticks::from_ms(20))?;
        }
        Ok(station.run(rig, REST)?)
    }
}

/// A phase without a fault, with snapshots to fork from.
pub(super) struct Undisturbed {
    /// Its begin; that of a flight is the release.
    pub(super) begin: Ticks,
    /// Faults begin in this time after it.
    pub(super) instants: Range<Ticks>,
    snapshots: Vec<Ready>,
    /// The true motion from the begin on.
    pub(super) motion: Vec<Motion>,
    /// The pulses of each axis.
    pub(super) pulses: [Vec<Pulse>; Axis::COUNT],
    /// What the vehicle has said.
    pub(super) texts: BTreeSet<String>,
    /// Sets of parameters that may be stored at the end of a run.
    stored: Vec<Params>,
    /// Bits of the servo timer's registers that can flip: address and bit.
    pub(super) timer_bits: Vec<(u32, u8)>,
}

impl Undisturbed {
    /// Brings a clone of a rig in standby to a phase, and watches that for `watched` behind the
    /// last instant at which a fault begins.
    ///
    /// # Errors
    /// The rig stopped, the image refuses, or the phase does not last.
    pub(super) fn new(
        phase: Phase,
        ready: &Ready,
        tilt_rad: [f64; Axis::COUNT],
        watched: Ticks,
    ) -> Result<Self, FlightError> {
        let mut base = ready.clone();
        base.rig.environment.truth.clear();
        let (before, _) = stored(&base.rig);
        let instants = phase.enter(&mut base, tilt_rad)?;
        let begin = base.rig.now();
        let texts_before = base.station.received().texts.len();
        let mut snapshots = Vec::new();
        base.station.run(&mut base.rig, instants.start)?;
        while base.rig.now() < begin + instants.end {
            snapshots.push(base.clone());
            base.station.run(&mut base.rig, SNAPSHOTS)?;
        }
        let timer_bits = system::timer_bits(&base.rig);
        let Ready { rig, station, .. } = &mut base;
        station.run(rig, watched + SNAPSHOTS)?;
        // It must still be in the phase: this does not wait.
        let what = format!("state of phase {phase} at its end");
        station.wait(rig, Ticks::ZERO, &what, |received| {
            let state = received.heartbeats.last().and_then(|beat| beat.state);
            state.is_some_and(|state| phase.has(state))
        })?;
        let texts = station.received().texts.iter().skip(texts_before);
        Ok(Self {
            begin,
            instants,
            snapshots,
            motion: rig.truth().motion_since(begin).to_vec(),
            pulses: rig.truth().pulses.clone(),
            texts: texts.cloned().collect(),
            stored: vec![before, stored(rig).0],
            timer_bits,
        })
    }

    /// Whether the next start of a vehicle would find parameters that somebody has stored; or, of
    /// one that `may_lose` them, that they are lost.
    pub(super) fn has_stored(&self, rig: &Rig, may_lose: bool) -> bool {
        match stored(rig) {
            (_, Loaded::Corrupt) => may_lose,
            (params, Loaded::Nothing | Loaded::Set { .. }) => {
                self.stored.iter().any(|stored| is_same(stored, &params))
            }
        }
    }

    /// A copy of the vehicle at an instant.
    ///
    /// # Errors
    /// The rig stopped.
    pub(super) fn fork(&self, at: Ticks) -> Result<Ready, FlightError> {
        let after = self.snapshots.partition_point(|s| s.rig.now() <= at);
        let mut fork = self.snapshots[after.saturating_sub(1)].clone();
        let Ready { rig, station, .. } = &mut fork;
        station.run(rig, at.saturating_sub(rig.now()))?;
        Ok(fork)
    }
}

/// Whether two sets differ in nothing but what a vehicle measures of its own parts.
pub(super) fn is_same(one: &Params, other: &Params) -> bool {
    (0..Params::count())
        .filter(|index| ![Params::STRETCH, Params::CLOCK].contains(index))
        .all(|index| one.by_index(index) == other.by_index(index))
}

/// What the next start would find in flash.
pub(super) fn stored(rig: &Rig) -> (Params, Loaded) {
    store::load_bytes(rig.stored().first_chunk().expect("the store is as long"))
}
