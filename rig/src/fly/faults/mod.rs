//! The campaign of faults: everything that a sensor and its cable do wrong, and what chip, program
//! and host do beyond that ([`SystemKind`]), at random instants of a flight.
//!
//! One flight is flown without a fault, with snapshots of the whole rig every 40 ms. Every run
//! continues from a copy of one of them to its own instant and switches its fault on for 5 to 500
//! ms, a glitch for 4 to 40 ms. It watches for 0.7 s more, twice as long if the drone is still on
//! its way back. Beyond the sensor it watches for 1.7 s: a reset takes half a second in the
//! bootloader.
//!
//! A run is judged by what can be seen from outside: the pulses on the servos' wires, the drone's
//! true tilt, and the state that the firmware reports. Faults beyond the sensor may begin in
//! another [`Phase`] of the vehicle than in flight, too. How a run ends:
//!
//! | ending | means |
//! |---|---|
//! | recovered | control is still active at the end, and the drone's true tilt is within 0.1 rad of where the flight without the fault had it, over the last 100 ms |
//! | neutral | the firmware is in failsafe, and no pulse after it said so was off neutral |
//! | unsafe | anything else; and either of the above with a pulse missing, a pulse outside the travel, a reset of the chip, or a rudder that was off neutral without valid data for more than 100 ms |
//!
//! A rudder is *without valid data* from the last control step that worked on a valid burst, or
//! from the fault's beginning where there has been none since. A burst is valid if it brought,
//! complete, the words that a faultless sensor and cable would have given at that moment, to within
//! 2 m/s^2, 5 uT and 4 deg/s. A sample as wrong as that moves the rudder by less than 2 degrees,
//! once.
//!
//! The time ends with the rising edge of the first neutral pulse, or with the next such step; for a
//! fault that stays it is the time from the fault to the neutral pulse. It counts whether or not
//! the firmware noticed that its data were wrong.
//!
//! # Stray pulses
//! A pulse that is neither neutral nor as wide as the program had asked for when it rose is a
//! *stray* one: a reset has cut it, or a wrong register has made it. A servo goes where the last
//! pulse says, so a stray one is unsafe by itself, and so is a pin that stays high.
//!
//! Two things excuse it. Where the fault is a wrong register or clock, which makes wrong pulses
//! until it is noticed, only the last one before a silence is unsafe; the others count as driven
//! wrongly (below). And where the pulses end with the fault and no instruction runs that could
//! prevent it (a reset from outside, a clock that stands still, interrupts held off for ever, a
//! core in lock-up), stray pulses are counted alone.
//!
//! # Beyond the sensor
//! There the data are good and what becomes of them may be wrong. A rudder is *driven wrongly* by a
//! pulse that is neither neutral nor near that of the flight without the fault (100 us, some 10
//! degrees of crank), while the drone is on that flight's course. A drone that is off it by more
//! than 0.05 rad is driven wrongly by a pulse that pushes it farther away. More than 200 ms of that
//! without a break are unsafe.
//!
//! A servo without pulses is not driven, but keeps the angle that it had: a run without a pulse for
//! longer than watchdog and bootloader take together is unsafe too, unless the last one was
//! neutral. In every other phase than the flight each pulse off neutral is a wrong one. How a run
//! ends:
//!
//! | ending | means |
//! |---|---|
//! | recovered | the vehicle goes on with what it did |
//! | neutral | it does not, and the last pulses are neutral |
//! | restarted | the same behind a reset of the chip |
//! | unmodelled | the program, as the fault has left it, does what the emulated chip does not model |
//! | unsafe | driven wrongly for too long; or no pulses at the end, or some that are not neutral in a state without control; armed or in control without an order; or with other parameters in flash than were stored there |
//!
//! A run is *noticed* if the firmware said so: by its state, a text, or a reset with a reason. It
//! is *harmless* if it was not, and all pulses were those of the flight without the fault, to
//! within 2 us.

mod frames;
mod judge;
mod outcome;
mod phase;
mod plan;
mod sound;
mod system;

pub use judge::neutral_us;
pub use outcome::{Ending, Outcome, Unsafe, Verdict, Watched};
pub use phase::Phase;
pub use plan::Plan;
pub use sound::{Alarms, Sound, SoundKind};
pub use system::SystemKind;

use crate::bno055::{Fault, FaultKind};
use crate::fly::flight::{FlightError, Ready};
use crate::lsm6ds3;
use crate::observe::ground_truth::Pulse;
use crate::random::{Stream, generator};
use crate::rig::Rig;
use judge::{Blame, Record, Rudder, SystemRun, judge_sensor, judge_system};
use phase::Undisturbed;
use rand::Rng;
use samd21::board::Ticks;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use system::SystemFault;
use tvc_nano::{Axis, Params};

/// Longest time for which a rudder may be off neutral without valid data.
pub const DEADLINE: Ticks = Ticks::from_ms(100);
/// Pitch from which the flight begins, and roll where that is steered, rad.
const START_RAD: [f64; Axis::COUNT] = [0.4, 0.3];
/// How long a fault lasts at most, ms.
const LONGEST_MS: f64 = 500.0;
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
/// The same for a fault beyond the sensor.
const SYSTEM_WATCHED: Ticks = Ticks::from_ms(1700);
/// What the bootloader takes, and the start of the image behind it.
const RESTART: Ticks = Ticks::from_ms(700);
/// Longest time for which a rudder may be driven wrongly.
pub const WRONG_LIMIT: Ticks = Ticks::from_ms(200);
/// Longest time without a pulse behind one that was not neutral: the watchdog's time-out, the
/// bootloader's half second and the start.
pub const SILENCE_LIMIT: Ticks = Ticks::from_ms(800);
/// Longest time from the start of the image behind a reset to the first burst: its self-test and
/// the set-up of the sensor take 133 ms, a second attempt to free the bus 22 ms.
pub const SENSOR_LIMIT: Ticks = Ticks::from_ms(190);

/// A flight without a fault, or another phase, from which runs fork.
pub struct Campaign {
    seed: u64,
    phase: Phase,
    /// [`Plan::Faults`] unless another is set.
    pub plan: Plan,
    frame: Ticks,
    /// Widths of the neutral pulse of every axis that is steered, us.
    neutral_us: Vec<(Axis, RangeInclusive<f64>)>,
    undisturbed: Undisturbed,
}

/// What fails in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The sensor or its cable.
    Sensor(FaultKind),
    /// The chip, its program or its host.
    System(SystemKind),
    /// Nothing: this happens to a sound vehicle.
    Sound(SoundKind),
    /// The sensor on the Nano's board.
    Onboard(lsm6ds3::Fault),
}

impl Kind {
    /// All of them, those of the sensor first.
    pub fn all() -> Vec<Self> {
        let sensor = FaultKind::ALL.into_iter().map(Self::Sensor);
        let system = SystemKind::ALL.into_iter().map(Self::System);
        let sound = SoundKind::ALL.into_iter().map(Self::Sound);
        let onboard = lsm6ds3::Fault::ALL.into_iter().map(Self::Onboard);
        sensor.chain(system).chain(sound).chain(onboard).collect()
    }

    /// Its name on the command line, in files and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sensor(kind) => kind.name(),
            Self::System(kind) => kind.name(),
            Self::Sound(kind) => kind.name(),
            Self::Onboard(fault) => fault.name(),
        }
    }

    /// Its place among all.
    fn index(self) -> u64 {
        Self::all().into_iter().take_while(|kind| *kind != self).count() as u64
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = Self::all();
        all.iter().find(|kind| kind.name() == text).copied().ok_or_else(|| {
            let names: Vec<_> = all.iter().map(|kind| kind.name()).collect();
            format!("there is no fault {text}; there are {}", names.join(", "))
        })
    }
}

/// A run of the campaign; kind and number decide its fault, instant and length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// What fails.
    pub kind: Kind,
    /// Number of the run among those of this kind.
    pub number: u32,
}

impl Campaign {
    /// Flies the flight that is to be disturbed, or has the vehicle in another phase, from a rig in
    /// standby whose servo frame has `frame_hz`.
    ///
    /// # Errors
    /// The rig stopped, or the image refuses.
    pub fn new(ready: &Ready, frame_hz: f64, phase: Phase, seed: u64) -> Result<Self, FlightError> {
        let params = reported_parameters(ready)?;
        let widths = |axis: &Axis| (*axis, neutral_us(&params, *axis));
        let neutral_us: Vec<_> = params.axes().iter().map(widths).collect();
        let [pitch_rad, roll_rad] = START_RAD;
        let tilt_rad = [pitch_rad, if neutral_us.len() > 1 { roll_rad } else { 0.0 }];
        let watched = Ticks::from_secs_f64(LONGEST_MS / 1e3) + SYSTEM_WATCHED + RESTART;
        Ok(Self {
            seed,
            phase,
            plan: Plan::Faults,
            frame: Ticks::from_secs_f64(1.0 / frame_hz),
            neutral_us,
            undisturbed: Undisturbed::new(phase, ready, tilt_rad, watched)?,
        })
    }

    /// The bits of the servo timer, in words: with [`Plan::TimerBits`] the run of number n flips
    /// the one at n modulo their number.
    pub fn timer_bits(&self) -> Vec<String> {
        let bits = self.undisturbed.timer_bits.iter();
        bits.map(|(address, bit)| system::bit(*address, *bit)).collect()
    }

    /// Carries out a run. The same case of the same campaign always ends in the same way.
    ///
    /// # Errors
    /// The rig stopped: the chip did something that its model does not cover.
    ///
    /// # Panics
    /// Nothing fails in a case of this kind: [`Sound`] has those.
    pub fn run(&self, case: Case) -> Result<Outcome, FlightError> {
        let mut dice = generator(
            self.seed ^ case.kind.index() << 48 ^ u64::from(case.number) << 16,
            Stream::Campaign,
        );
        let Undisturbed { begin, instants, .. } = &self.undisturbed;
        let at = *begin + Ticks(dice.random_range(instants.start.0..instants.end.0));
        let lasting_ms = self.plan.lasting_ms();
        let (shortest_ms, longest_ms) = (lasting_ms.start(), lasting_ms.end());
        let octaves = (longest_ms / shortest_ms).ln() * dice.random_range(0.0..1.0);
        let lasted = Ticks::from_secs_f64(shortest_ms / 1e3 * f64::exp(octaves));

        let mut fork = self.undisturbed.fork(at)?;
        let Ready { rig, .. } = &mut fork;
        let begun = Begun {
            before: Axis::ALL.map(|axis| rig.truth().pulses_of(axis).last().copied()),
            resets: rig.resets().len(),
            halts: rig.halts(),
            at: rig.now(),
            lasted,
        };
        rig.environment.truth.clear();
        match case.kind {
            Kind::Sensor(kind) => {
                let mut fault = kind.draw(&mut dice);
                if self.plan == Plan::Glitches
                    && let Fault::Naks { probability } = &mut fault
                {
                    *probability = 1.0;
                }
                self.run_sensor(case, fork, &begun, format!("{fault:?}"), |rig, is_on| {
                    if is_on { rig.inject(fault) } else { rig.clear(fault) }
                })
            }
            Kind::Onboard(fault) => {
                self.run_sensor(case, fork, &begun, format!("{fault:?}"), |rig, is_on| {
                    let (now, chip) = (rig.now(), &mut rig.environment.onboard);
                    if is_on { chip.inject(now, fault) } else { chip.clear(now, fault) }
                })
            }
            Kind::System(kind) => {
                let mut what = String::new();
                match self.run_system(case, kind, &mut fork, &begun, &mut dice, &mut what) {
                    Err(FlightError::Rig(stopped)) => {
                        let verdict = Verdict::new(Ending::Unmodelled(stopped.to_string()));
                        Ok(self.outcome(case, &begun, what, verdict, &fork))
                    }
                    other => other,
                }
            }
            Kind::Sound(kind) => panic!("{kind}: runs of sound vehicles are those of Sound"),
        }
    }

    fn run_sensor(
        &self,
        case: Case,
        mut fork: Ready,
        begun: &Begun,
        fault: String,
        set: impl Fn(&mut Rig, bool),
    ) -> Result<Outcome, FlightError> {
        let Ready { rig, station, .. } = &mut fork;
        set(rig, true);
        station.run(rig, begun.lasted)?;
        set(rig, false);
        station.run(rig, WATCHED)?;
        let mut verdict = judge_sensor(&self.record(begun, &fork, 0.0));
        if matches!(verdict.ending, Ending::Unsafe(Unsafe::OffCourse(_))) {
            // It may be on its way back.
            let Ready { rig, station, .. } = &mut fork;
            station.run(rig, WATCHED)?;
            verdict = judge_sensor(&self.record(begun, &fork, 0.0));
        }
        Ok(self.outcome(case, begun, fault, verdict, &fork))
    }

    fn run_system(
        &self,
        case: Case,
        kind: SystemKind,
        fork: &mut Ready,
        begun: &Begun,
        dice: &mut impl Rng,
        what: &mut String,
    ) -> Result<Outcome, FlightError> {
        let told = fork.station.received().texts.len();
        fork.rig.drift_slow_clock(dice.random_range(self.plan.slow_clock()));
        let fault = match self.plan {
            Plan::TimerBits => {
                let bits = &self.undisturbed.timer_bits;
                let (address, bit) = bits[case.number as usize % bits.len()];
                SystemFault::flip(kind, &mut fork.rig, address, bit)
            }
            _ => {
                let mut fault = SystemFault::of(Blame::Each);
                fault.add(kind, fork, dice)?;
                fault
            }
        };
        what.clone_from(&fault.what);
        let Ready { rig, station, .. } = fork;
        let (end, mut millisecond) = (rig.now() + begun.lasted, 0);
        while rig.now() < end {
            fault.act(millisecond, rig, dice);
            station.run(rig, system::HOST_PERIOD)?;
            millisecond += 1;
        }
        fault.end(rig);
        station.run(rig, SYSTEM_WATCHED)?;
        // A reset may have come late.
        let last = rig.resets().last().map_or(Ticks::ZERO, |(at, _)| *at);
        station.run(rig, (last + RESTART).saturating_sub(rig.now()))?;

        let pulses = |(axis, _): &(Axis, _)| self.undisturbed.pulses[axis.index()].as_slice();
        let Ready { rig, station, .. } = &*fork;
        let mut verdict = judge_system(&SystemRun {
            record: self.record(begun, fork, fault.shifted_ppm),
            phase: self.phase,
            reference_pulses: self.neutral_us.iter().map(pulses).collect(),
            given_up: rig.in_bootloader(),
            blind: blind_since_start(rig).unwrap_or_default(),
            commanded: kind.commands(),
            stored_others: !self.undisturbed.has_stored(rig, kind.spoils_store()),
            blame: match rig.halts() > begun.halts {
                true => Blame::None,
                false => fault.blame,
            },
        });
        let mut texts = station.received().texts.iter().skip(told);
        let told = texts.any(|text| !self.undisturbed.texts.contains(text));
        verdict.noticed |= told;
        verdict.harmless &= !told;
        Ok(self.outcome(case, begun, fault.what, verdict, fork))
    }

    /// What was recorded since the fault, which shifted the main clock by so much.
    fn record<'a>(&'a self, begun: &Begun, fork: &'a Ready, shifted_ppm: f64) -> Record<'a> {
        let Ready { rig, station, .. } = fork;
        let truth = rig.truth();
        let clock_error = (shifted_ppm * 1e-6).abs() + rig.clock_error();
        let rudder = |(axis, neutral_us): &(Axis, RangeInclusive<f64>)| Rudder {
            axis: *axis,
            neutral_us: neutral_us.clone(),
            before: begun.before[axis.index()],
            pulses: truth.pulses_of(*axis),
            high: truth.high[axis.index()],
            clock_error,
        };
        Record {
            injected: begun.at,
            frame: self.frame,
            rudders: self.neutral_us.iter().map(rudder).collect(),
            truth,
            reference: &self.undisturbed.motion,
            heartbeats: &station.received().heartbeats,
            resets: &rig.resets()[begun.resets..],
        }
    }

    fn outcome(
        &self,
        case: Case,
        begun: &Begun,
        fault: String,
        verdict: Verdict,
        fork: &Ready,
    ) -> Outcome {
        Outcome {
            case,
            at_s: (begun.at - self.undisturbed.begin).as_secs_f64(),
            lasted_s: begun.lasted.as_secs_f64(),
            fault,
            verdict,
            said: fork.station.last_text().unwrap_or_default().to_owned(),
            watched: Watched::default(),
        }
    }
}

/// How long the image has run, since its last start, without a burst. One that is damaged in flash
/// need not get as far as its sensor.
fn blind_since_start(rig: &Rig) -> Option<Ticks> {
    let started = rig.started().filter(|_| rig.image_is_whole())?;
    let mut bursts = rig.truth().bursts.iter().map(|burst| burst.start);
    let first = bursts.find(|start| *start >= started);
    Some(first.unwrap_or(rig.now()).saturating_sub(started))
}

/// A run at the instant of its fault.
struct Begun {
    /// The last pulse of each axis.
    before: [Option<Pulse>; Axis::COUNT],
    /// Resets so far.
    resets: usize,
    /// Halts of the core so far.
    halts: usize,
    at: Ticks,
    /// How long the fault lasts.
    lasted: Ticks,
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
