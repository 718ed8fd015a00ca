//! Sound vehicles: what the firmware's defences do to a vehicle that nothing is wrong with.
//!
//! A defence that refuses sound data or resets a sound board is worse than the fault that it is
//! for. So every run draws a vehicle and a world as sound ones may be ([`parts`]): chip, sensor and
//! host that differ, noise, offsets, iron, temperature. It draws, too, what happens to it
//! ([`acts`]): knocks, a hand, magnets, a propeller's vibration, a host that is away, asks, orders,
//! saves or floods. [`judge`] says what of it is an alarm. A run has none if
//!
//! | what | is | but |
//! |---|---|---|
//! | the chip | not reset | |
//! | the state | no failsafe and no latched fault at any change; that of the phase at the end | as the host orders, where it sends any valid frames; and for a sensor that falls to CONFIG mode failsafe |
//! | an order to arm, at rest, to release or to save | obeyed | |
//! | every step | taken with the sample of its burst, which is not refused | not while parameters are stored, since the processor stands still for each row and page; nor behind a sensor that falls to CONFIG mode |
//! | the loop | keeps its period to within 100 us, while armed | |
//! | the parameters | all there, as they were set, and in flash as they were saved | |
//! | pulses | those that were asked for, in time, and neutral without control | |
//!
//! Refused bursts are found by what the vehicle counts as steps without a usable sample, less the
//! steps that had no burst, as seen on the bus.

mod acts;
mod judge;
mod parts;

use client::{StateKind, request};
use rand::{Rng, RngCore};
use samd21::board::Ticks;
use tvc_nano::Params;
use tvc_nano::params::{Change, Range};
use tvc_nano::store::Loaded;

use super::phase::{is_same, stored};
use super::{
    Case, Ending, Kind, Outcome, Phase, Verdict, Watched, neutral_us, reported_parameters,
};
use crate::bno055::{Fault, Mode};
use crate::fly::flight::{FlightError, Ready, Setup, Stage, prepare};
use crate::ground_station::GroundStationError;
use crate::image::Image;
use crate::named_enum::named_enum;
use crate::random::{Stream, generator};
use crate::rig::RigError;
use acts::Acts;
use judge::Seen;
use parts::Parts;

pub use judge::Alarms;

named_enum! {
    /// What happens to a sound vehicle in a run, beside what is drawn.
    SoundKind, "kind of sound run";
    /// It rests, or hovers.
    Rest = "rest",
    /// The propeller is out of balance.
    Vibration = "vibration",
    /// The sensor's board is struck.
    Knocks = "knocks",
    /// The sensor is moved by hand.
    Hand = "hand",
    /// The same, as fast as a hand can.
    FastHand = "fast-hand",
    /// Magnets pass.
    Magnet = "magnet",
    /// Sensor and offsets warm up or cool down.
    WarmUp = "warm-up",
    /// The host sends frames that leave the vehicle as it is, up to 800 a second.
    Frames = "frames",
    /// The host sends valid frames at random, any order and any parameter, up to 800 a second.
    Orders = "orders",
    /// The same as fast as the vehicle takes them.
    Flood = "flood",
    /// The host sends noise as fast as the vehicle takes it.
    Noise = "noise",
    /// The host changes a parameter and saves all, every 10 to 200 ms.
    Saves = "saves",
    /// The sensor falls to CONFIG mode and is set up anew, whatever the host does.
    SetUp = "set-up",
}

impl SoundKind {
    /// Those that there are in a phase.
    pub(super) fn of(phase: Phase) -> Vec<Self> {
        let mut kinds = Self::ALL.to_vec();
        kinds.retain(|kind| match (phase, kind) {
            (Phase::Saving, _) => false,
            (Phase::Flight, Self::Vibration) => true,
            (_, Self::Vibration) => false,
            (Phase::Start, Self::Knocks) => false,
            (Phase::Flight | Phase::Start, Self::Hand | Self::FastHand) => false,
            (Phase::Flight | Phase::Armed, Self::Saves | Self::SetUp) => false,
            (Phase::Start, Self::SetUp) => false,
            _ => true,
        });
        kinds
    }
}

/// Length of a run: of a hover, of a start, of all others.
const HOVER: Ticks = Ticks::from_ms(20_000);
const START: Ticks = Ticks::from_ms(9_000);
const OTHER: Ticks = Ticks::from_ms(6_000);
/// Time behind a run in which state and counts are told once more.
const TOLD: Ticks = Ticks::from_ms(1_300);
/// Rest after which a sound vehicle can be disarmed and armed again.
const PATIENCE: Ticks = Ticks::from_ms(15_000);
/// How far the main clock is off at most once start-of-frame corrects it, relative.
const LOCKED: f64 = 0.003;
/// A parameter that the host changes stays within this of its value, relative.
const NEAR: f32 = 0.031;

/// The campaign of sound vehicles.
#[derive(Clone)]
pub struct Sound {
    image: Image,
    /// Vehicle, servo and seed.
    setup: Setup,
    phase: Phase,
    /// Parts that are given, as `--hardware` takes them.
    hardware: String,
    /// How long it flies, or stays in another phase, if not as long as that phase takes.
    pub length: Option<Ticks>,
    /// What breaks in the middle: then it is not sound.
    pub fault: Option<Fault>,
}

impl Sound {
    /// With the vehicle and the servo of `setup`, and its seed.
    pub fn new(image: &Image, setup: Setup, phase: Phase) -> Self {
        Self {
            image: image.clone(),
            setup,
            phase,
            hardware: String::new(),
            length: None,
            fault: None,
        }
    }

    /// With these parts, as `--hardware` takes them, in place of drawn ones.
    ///
    /// # Errors
    /// There are no such parts.
    pub fn with_hardware(self, hardware: &str) -> Result<Self, String> {
        hardware.parse::<crate::bench::Hardware>()?;
        Ok(Self { hardware: hardware.to_owned(), ..self })
    }

    /// Carries out a run. The same one of the same campaign always ends in the same way.
    ///
    /// # Errors
    /// Impossible parameters of the drone.
    pub fn run(&self, kind: SoundKind, number: u32) -> Result<Outcome, FlightError> {
        let case = Case { kind: Kind::Sound(kind), number };
        let mut setup = self.setup.clone();
        let frame_hz = u64::from(setup.servo.frame_hz() as u32);
        let of_vehicle = (self.phase as u64) << 8 | frame_hz << 12 | setup.rig.bench.axes() as u64;
        let of_case = case.kind.index() << 48 ^ u64::from(number) << 24;
        let mut dice = generator(setup.rig.seed ^ of_case ^ of_vehicle, Stream::Campaign);
        setup.rig.seed = dice.next_u64();
        let warms_up = kind == SoundKind::WarmUp;
        let parts = parts::draw(&mut setup, self.phase, &self.hardware, warms_up, &mut dice);
        let refresh = setup.rig.hardware.sensor.refresh;
        let refresh_hz =
            refresh.map_or([Mode::Amg.refresh_hz(); 2], |rates| [rates.acc_hz, rates.gyr_hz]);
        let acts = Acts::draw(kind, self.phase, refresh_hz, &mut dice);
        setup.rig.bench.disturbances.vibration = acts.vibration;
        let what = format!("{}; {}", parts.words, acts.words);
        let mut run = Run {
            sound: self,
            parts,
            acts,
            params: Params::default(),
            watched: Watched::default(),
            alarms: Alarms::default(),
            said: String::new(),
        };
        if let Err(error) = run.carry_out(&setup, &mut dice) {
            match error {
                FlightError::Rig(error @ RigError::Parameters(_)) => return Err(error.into()),
                FlightError::Rig(stopped)
                | FlightError::GroundStation(GroundStationError::Rig(stopped)) => {
                    run.alarms.states += 1;
                    run.alarms.details.push(stopped.to_string());
                }
                refused => {
                    run.alarms.refusals += 1;
                    run.alarms.details.push(refused.to_string());
                }
            }
        }
        let noticed = run.alarms.is_any();
        let ending = if noticed { Ending::Alarmed(run.alarms) } else { Ending::Recovered };
        Ok(Outcome {
            case,
            at_s: 0.0,
            lasted_s: self.length().as_secs_f64(),
            fault: what,
            verdict: Verdict { noticed, harmless: !noticed, ..Verdict::new(ending) },
            said: run.said,
            watched: run.watched,
        })
    }

    fn length(&self) -> Ticks {
        self.length.unwrap_or(match self.phase {
            Phase::Flight => HOVER,
            Phase::Start => START,
            _ => OTHER,
        })
    }
}

/// A run under way.
struct Run<'a> {
    sound: &'a Sound,
    parts: Parts,
    acts: Acts,
    /// The parameters at its begin.
    params: Params,
    watched: Watched,
    alarms: Alarms,
    /// The vehicle's last text.
    said: String,
}

impl Run<'_> {
    /// Brings the vehicle to the phase, lets happen what happens, judges, and asks the vehicle.
    ///
    /// # Errors
    /// It refuses what a sound one obeys, or the rig stopped.
    fn carry_out(&mut self, setup: &Setup, dice: &mut impl Rng) -> Result<(), FlightError> {
        let phase = self.sound.phase;
        let mut ready = prepare(&self.sound.image, setup, &mut |_| {})?;
        self.params = reported_parameters(&ready)?;
        phase.enter(&mut ready, self.parts.tilt_rad)?;
        self.fly(&mut ready, dice)?;
        let asked = if self.alarms.is_any() {
            Ok(())
        } else {
            let resets = ready.rig.resets().len();
            let asked = self.ask(&mut ready);
            self.alarms.resets += ready.rig.resets().len() - resets;
            asked
        };
        ready.station.last_text().unwrap_or_default().clone_into(&mut self.said);
        asked
    }

    fn fly(&mut self, ready: &mut Ready, dice: &mut impl Rng) -> Result<(), FlightError> {
        let phase = self.sound.phase;
        let length_ms = self.sound.length().as_us() / 1000;
        ready.rig.environment.truth.clear();
        let begin = ready.rig.now();
        let received = ready.station.received();
        let (beats, texts) = (received.heartbeats.len(), received.texts.len());
        let counted = match phase {
            // It counts from zero, and the steps until the sensor is set up among them.
            Phase::Start => None,
            _ => newest_missed(ready),
        };
        let resets = ready.rig.resets().len();
        let (kept, _) = stored(&ready.rig);
        self.acts.begin(ready);
        for ms in 0..length_ms {
            if let Some(fault) = self.sound.fault.filter(|_| ms == length_ms / 2) {
                ready.rig.inject(fault);
            }
            self.acts.act(ms, phase, &self.params, ready, dice)?;
        }
        self.acts.end(ready)?;
        ready.station.run(&mut ready.rig, TOLD)?;

        let end = ready.rig.now();
        let truth = ready.rig.truth();
        self.watched = Watched {
            flown_s: (end - begin).as_secs_f64(),
            frames: self.acts.frames,
            bursts: truth.bursts.len(),
        };
        let received = ready.station.received();
        let axes = self.params.axes().iter();
        let neutral_us: Vec<_> =
            axes.map(|axis| (*axis, neutral_us(&self.params, *axis))).collect();
        let texts = received.texts[texts..].iter();
        let missed = counted.zip(newest_missed(ready));
        let seen = Seen {
            phase,
            commanded: self.acts.commands(),
            sets: self.acts.sets(),
            saves: self.acts.saves(phase),
            resets_sensor: self.acts.resets_sensor(),
            begin,
            end,
            frame: Ticks::from_secs_f64(1.0 / self.parts.frame_hz),
            clock_error: match phase {
                Phase::Start => ready.rig.clock_error(),
                _ if ready.rig.resets().len() > resets => ready.rig.clock_error(),
                _ => LOCKED,
            },
            truth,
            neutral_us: &neutral_us,
            heartbeats: &received.heartbeats[beats.saturating_sub(1)..],
            texts: texts.map(String::as_str).collect(),
            resets: &ready.rig.resets()[resets..],
            missed: missed.map(|(before, after)| [before, after]),
        };
        self.alarms = seen.alarms();
        let (now, loaded) = stored(&ready.rig);
        let is_lost = matches!(loaded, Loaded::Corrupt | Loaded::Nothing);
        let is_other = !self.acts.saves(phase) && !self.alarms.is_any() && !is_same(&kept, &now);
        if is_lost || is_other {
            self.alarms.parameters += 1;
            self.alarms.details.push(format!("in flash: {loaded}"));
        }
        Ok(())
    }

    /// Whether the vehicle has its parameters, can be disarmed and armed again, and saves.
    ///
    /// # Errors
    /// It refuses, or the rig stopped.
    fn ask(&mut self, ready: &mut Ready) -> Result<(), FlightError> {
        ready.station.list_parameters(&mut ready.rig)?;
        let listed = &ready.station.received().parameters;
        let wrong = self.params.iter().filter(|(info, before)| {
            let now = listed.get(info.name).copied();
            now.is_none_or(|now| !self.may_be(info, *before, now))
        });
        let wrong: Vec<_> = wrong.map(|(info, _)| info.name).collect();
        if !wrong.is_empty() {
            self.alarms.parameters += wrong.len();
            self.alarms.details.push(wrong.join(" "));
        }
        if self.acts.commands() {
            return Ok(());
        }
        if self.sound.phase == Phase::Failsafe || self.acts.resets_sensor() {
            let end = ready.rig.now() + PATIENCE;
            while let Err(refused) = ready.station.disarm(&mut ready.rig) {
                if ready.rig.now() > end {
                    return Err(refused.into());
                }
                ready.station.run(&mut ready.rig, Ticks::from_ms(20))?;
            }
        }
        if ready.station.state().is_none_or(StateKind::is_armed) {
            return Ok(());
        }
        ready.station.order(&mut ready.rig, request::SAVE)?;
        let (saved, loaded) = stored(&ready.rig);
        let now = reported_parameters(ready)?;
        if !loaded.is_as_saved() || !is_same(&saved, &now) {
            self.alarms.parameters += 1;
            self.alarms.details.push(format!("saved: {loaded}"));
        }
        ready.arm(Stage::Tilt, PATIENCE, &mut |_| {})
    }

    /// Whether a parameter may have this value now.
    fn may_be(&self, info: &tvc_nano::params::Info, before: f32, now: f32) -> bool {
        let is_tuned = self.acts.sets()
            && info.change == Change::Live
            && matches!(info.range, Range::Between(..));
        info.range.contains(now)
            && (self.acts.commands()
                || info.change == Change::Measured
                || now == before
                || is_tuned && (now - before).abs() <= NEAR * before.abs())
    }
}

/// The steps without a usable sample that the vehicle has told of last, and when.
fn newest_missed(ready: &Ready) -> Option<(Ticks, u16)> {
    let status = ready.station.received().status.last();
    status.map(|(at, status)| (*at, status.errors_count2))
}
