//! Flights: boot once, clone the rig for every start, release the drone, and record what happens.

use crate::bench::BenchConfig;
use crate::ground_station::{GroundStation, GroundStationError, Received};
use crate::image::Image;
use crate::observe::ground_truth::{Motion, Pulse};
use crate::observe::measure::{LoopTiming, events_without};
use crate::observe::waves::Waves;
use crate::random::{Stream, generator};
use crate::rig::{Rig, RigConfig, RigError};
use client::{LinkCounts, StateKind};
use plant::response::{ResponseError, StepResponse};
use rand::Rng;
use samd21::board::Ticks;
use samd21::chip::{Counters, EXCEPTIONS};
use std::ops::Range;
use thiserror::Error;
use tvc_nano::Axis;

pub use super::servo_kind::ServoKind;

/// How long sensor, self-test and estimator may take until standby.
const STANDBY_PATIENCE: Ticks = Ticks::from_ms(8000);
/// Rest in standby, in which the estimator learns the gyroscope's bias.
const LEARN: Ticks = Ticks::from_ms(5000);
/// Rest after the drone was tilted by hand, before it is armed.
const REST: Ticks = Ticks::from_ms(3000);
/// How long a person goes on trying to arm a drone that is at rest: each time that the image has
/// learned another length of its bursts, it measures the gyroscope's offset anew.
pub(super) const ARM_PATIENCE: Ticks = Ticks::from_ms(8000);
/// How often progress is reported.
const PROGRESS: Ticks = Ticks::from_ms(20);

/// The configuration of a flight: rig, servo and parameters.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The rig, with the servo's physics on its bench.
    pub rig: RigConfig,
    /// The servo, for the parameters that the image needs.
    pub servo: ServoKind,
    /// Parameters sent to the image behind the servo's, by name.
    pub parameters: Vec<(String, f32)>,
}

impl Setup {
    /// A default rig with `servo` and everything random from `seed`, and the servo's polarity
    /// stored in the flash, so that it can be armed.
    pub fn with_polarity(servo: ServoKind, seed: u64) -> Self {
        let bench = BenchConfig { servo: servo.model(), ..BenchConfig::default() };
        let stored = Some(RigConfig::polarity_set());
        Self {
            rig: RigConfig { seed, bench, stored, ..RigConfig::default() },
            servo,
            parameters: Vec::new(),
        }
    }
}

/// Why a flight failed.
#[derive(Debug, Error)]
pub enum FlightError {
    /// The rig stopped.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The image did not answer as it should.
    #[error(transparent)]
    GroundStation(#[from] GroundStationError),
}

/// What a flight gives, or why there is none.
pub type Flown<T = ()> = Result<T, FlightError>;

/// Who watches a flight.
pub type Watch<'a> = &'a mut dyn FnMut(&Progress);

/// Stage of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Until standby: start-up, parameters.
    Boot,
    /// The clamp is tilted to the start.
    Tilt,
    /// The drone is free.
    Flight,
}

/// Progress report of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// Time since the stage began, s.
    pub time_s: f64,
    /// True pitch and roll, rad.
    pub tilt_rad: [f64; Axis::COUNT],
    /// True rudder angles, rad.
    pub rudders_rad: [f64; Axis::COUNT],
    /// The state that the firmware reported last.
    pub state: Option<StateKind>,
}

/// A rig in standby with its parameters set; each flight is flown on a clone of it.
#[derive(Clone)]
pub struct Ready {
    /// The rig.
    pub rig: Rig,
    /// The ground station at its port.
    pub station: GroundStation,
    seed: u64,
}

/// Numbers of the messages that should have come with every control step or burst and did not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    /// Bursts without their attitude.
    pub attitudes: usize,
    /// Control steps without their servo output.
    pub servos: usize,
    /// Samples without their raw counts.
    pub samples: usize,
}

/// What happened in a flight.
#[derive(Clone, Debug)]
pub struct FlightRecord {
    /// Pitch and roll at release, rad.
    pub start_rad: [f64; Axis::COUNT],
    /// When the clamp opened.
    pub released: Ticks,
    /// The true motion from release on, once a millisecond.
    pub motion: Vec<Motion>,
    /// The pulses of the first servo.
    pub pulses: Vec<Pulse>,
    /// Those of the second.
    pub roll_pulses: Vec<Pulse>,
    /// Timing of the control loop in the flight.
    pub timing: LoopTiming,
    /// What came over USB in the flight.
    pub received: Received,
    /// Counts of the link in the flight.
    pub link: LinkCounts,
    /// Messages that did not come.
    pub missing: Missing,
    /// Share of the flight for which the core was awake, 0 to 1.
    pub cpu_load: f64,
    /// Deepest stack since power-on, bytes.
    pub stack_high_water: u32,
    /// Priorities of the exceptions at the end, by number.
    pub priorities: [i8; EXCEPTIONS],
    /// The firmware's state at the end.
    pub final_state: Option<StateKind>,
    /// The edges of bus and pins, where the setup has them recorded.
    pub waves: Option<Waves>,
    /// Time simulated for this flight, tilting included, s.
    pub simulated_s: f64,
    /// Part of this for which the core was awake, s.
    pub busy_s: f64,
}

impl FlightRecord {
    /// Figures of an axis' true angle.
    ///
    /// # Errors
    /// The axis was upright at the release.
    pub fn response(&self, axis: Axis) -> Result<StepResponse, ResponseError> {
        let released = std::iter::once((0.0, self.start_rad[axis.index()]));
        let after = self.motion.iter().map(|motion| {
            let since = motion.time.saturating_sub(self.released);
            (since.as_secs_f64(), motion.tilt_rad[axis.index()])
        });
        StepResponse::new(released.chain(after.filter(|(t, _)| *t > 0.0)), 0.0)
    }
}

/// How a drone in a joint is let go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release {
    /// Pitch and roll, rad.
    pub tilt_rad: [f64; Axis::COUNT],
    /// Rate in the direction of the tilt, rad/s.
    pub rate_rad_s: f64,
    /// Rate about its own vertical, rad/s.
    pub spin_rad_s: f64,
}

/// Boots `image`, sends it its parameters and waits for standby.
///
/// # Errors
/// The rig stopped, or the image does not come to standby.
pub fn prepare(image: &Image, setup: &Setup, progress: Watch<'_>) -> Flown<Ready> {
    let mut ready = boot(image, setup)?;
    let begin = ready.rig.now();
    while ready.station.state() != Some(StateKind::Standby) {
        if ready.rig.now() - begin > STANDBY_PATIENCE {
            let Ready { rig, station, .. } = &mut ready;
            station.wait_for_state(rig, Ticks::ZERO, StateKind::Standby)?;
        }
        ready.watch(Stage::Boot, PROGRESS, progress)?;
    }
    ready.watch(Stage::Boot, LEARN, progress)?;
    Ok(ready)
}

/// Boots `image` with the drone held at `start_rad` from power-on, arms and releases it at the
/// first instant at which the image lets it, and records the flight for `seconds`.
///
/// # Errors
/// The rig stopped, or the image does not let it be armed in time.
pub fn fly_at_once(
    image: &Image,
    setup: &Setup,
    start_rad: f64,
    seconds: f64,
    progress: Watch<'_>,
) -> Flown<FlightRecord> {
    let mut setup = setup.clone();
    setup.rig.bench.start_rad = start_rad;
    let mut ready = boot(image, &setup)?;
    let begun = Mark::of(&ready.rig);
    ready.arm(Stage::Boot, STANDBY_PATIENCE, progress)?;
    ready.station.release(&mut ready.rig, 0.0)?;
    ready.fly_on([start_rad, 0.0], seconds, begun, progress)
}

/// Boots `image` and sends it its parameters.
fn boot(image: &Image, setup: &Setup) -> Flown<Ready> {
    let mut ready = Ready {
        rig: Rig::new(image, &setup.rig)?,
        station: GroundStation::default(),
        seed: setup.rig.seed,
    };
    let Ready { rig, station, .. } = &mut ready;
    station.connect(rig)?;
    for (name, value) in setup.servo.parameters() {
        station.set_parameter(rig, name, *value)?;
    }
    for (name, value) in &setup.parameters {
        station.set_parameter(rig, name, *value)?;
    }
    Ok(ready)
}

impl Ready {
    /// On a clone of the rig: tilts the drone to `start_rad`, arms it, releases it with
    /// `rate_rad_s` and records the flight for `seconds`.
    ///
    /// # Errors
    /// The rig stopped, or the image refuses.
    pub fn fly(
        &self,
        start_rad: f64,
        rate_rad_s: f64,
        seconds: f64,
        progress: Watch<'_>,
    ) -> Flown<FlightRecord> {
        let release = Release { tilt_rad: [start_rad, 0.0], rate_rad_s, spin_rad_s: 0.0 };
        self.fly_from(&release, seconds, progress)
    }

    /// The same from a tilt of either axis or both, with a spin.
    ///
    /// # Errors
    /// As [`Ready::fly`].
    pub fn fly_from(
        &self,
        release: &Release,
        seconds: f64,
        progress: Watch<'_>,
    ) -> Flown<FlightRecord> {
        let begun = Mark::of(&self.rig);
        let mut fork = self.armed(release.tilt_rad, progress)?;
        fork.rig.environment.spin_rad_s = release.spin_rad_s;
        fork.station.release(&mut fork.rig, release.rate_rad_s)?;
        fork.fly_on(release.tilt_rad, seconds, begun, progress)
    }

    /// On a clone of the rig, which has a rocket on its pad: tilts the rail to `tilt_rad`, arms the
    /// image, waits for `countdown_s`, ignites the engine and records the flight for `seconds` from
    /// there. No order releases it: the image sees the launch.
    ///
    /// # Errors
    /// As [`Ready::fly`].
    pub fn launch(
        &self,
        tilt_rad: [f64; Axis::COUNT],
        countdown_s: f64,
        seconds: f64,
        progress: Watch<'_>,
    ) -> Flown<FlightRecord> {
        let begun = Mark::of(&self.rig);
        let mut fork = self.armed(tilt_rad, progress)?;
        fork.watch(Stage::Tilt, Ticks::from_secs_f64(countdown_s), progress)?;
        fork.rig.environment.truth.clear();
        fork.rig.release(0.0);
        fork.fly_on(tilt_rad, seconds, begun, progress)
    }

    /// A clone with the drone tilted to `start_rad`, pitch and roll, and armed, at a random phase
    /// of the servo frame.
    pub(super) fn armed(&self, start_rad: [f64; Axis::COUNT], progress: Watch<'_>) -> Flown<Self> {
        let mut fork = self.clone();
        fork.tilt(start_rad, progress)?;
        fork.arm(Stage::Tilt, ARM_PATIENCE, progress)?;
        // A person releases the drone at a random phase of the servo frame.
        let [pitch, roll] = start_rad.map(f64::to_bits);
        let mut dice = generator(self.seed ^ pitch ^ roll.rotate_left(1), Stream::Release);
        fork.station.run(&mut fork.rig, Ticks::from_us(dice.random_range(0..20_000)))?;
        Ok(fork)
    }

    /// Arms the drone, at rest, as soon as the image lets it be armed.
    pub(super) fn arm(&mut self, stage: Stage, patience: Ticks, progress: Watch<'_>) -> Flown {
        let end = self.rig.now() + patience;
        while let Err(refused) = self.station.arm(&mut self.rig) {
            if self.rig.now() > end {
                return Err(refused.into());
            }
            self.watch(stage, PROGRESS, progress)?;
        }
        Ok(())
    }

    /// Records the flight of the vehicle that was let go just now.
    fn fly_on(
        mut self,
        start_rad: [f64; Axis::COUNT],
        seconds: f64,
        begun: Mark,
        progress: Watch<'_>,
    ) -> Flown<FlightRecord> {
        let released = self.rig.now();
        self.station.begin_measurement();
        self.rig.environment.truth.waves.iter_mut().for_each(Waves::clear);
        let mark = Mark::of(&self.rig);
        let length = Ticks::from_secs_f64(seconds);
        self.watch_until(Stage::Flight, released, released + length, progress)?;
        self.record(start_rad, released..released + length, begun, mark)
    }

    fn tilt(&mut self, start_rad: [f64; Axis::COUNT], progress: Watch<'_>) -> Flown {
        self.rig.environment.tilt_clamp_to(start_rad);
        while !self.rig.environment.clamp_rests() {
            self.watch(Stage::Tilt, PROGRESS, progress)?;
        }
        self.watch(Stage::Tilt, REST, progress)
    }

    fn watch(&mut self, stage: Stage, length: Ticks, progress: Watch<'_>) -> Flown {
        let begin = self.rig.now();
        self.watch_until(stage, begin, begin + length, progress)
    }

    /// Runs a stage that began at `begin` until `end`.
    pub(super) fn watch_until(
        &mut self,
        stage: Stage,
        begin: Ticks,
        end: Ticks,
        progress: Watch<'_>,
    ) -> Flown {
        while self.rig.now() < end {
            let slice = PROGRESS.min(end - self.rig.now());
            self.station.run(&mut self.rig, slice)?;
            progress(&self.progress(stage, self.rig.now() - begin));
        }
        Ok(())
    }

    fn progress(&self, stage: Stage, time: Ticks) -> Progress {
        let drone = self.rig.environment.vehicle();
        Progress {
            stage,
            time_s: time.as_secs_f64(),
            tilt_rad: drone.tilt_rad(),
            rudders_rad: drone.rudders_rad(),
            state: self.station.state(),
        }
    }

    fn record(
        mut self,
        start_rad: [f64; Axis::COUNT],
        window: Range<Ticks>,
        begun: Mark,
        mark: Mark,
    ) -> Flown<FlightRecord> {
        let now = Mark::of(&self.rig);
        let final_state = self.station.state();
        // Messages of the last steps are still on their way.
        self.station.run(&mut self.rig, Ticks::from_ms(50))?;
        let truth = self.rig.truth();
        let mut motion = truth.motion_since(window.start).to_vec();
        motion.retain(|m| m.time <= window.end);
        let received = self.station.received().clone();
        Ok(FlightRecord {
            start_rad,
            released: window.start,
            timing: LoopTiming::over(truth, window.clone()),
            missing: missing(&self.rig, &received, &window),
            pulses: truth.pulses_since(Axis::Pitch, window.start).to_vec(),
            roll_pulses: truth.pulses_since(Axis::Roll, window.start).to_vec(),
            waves: truth.waves.clone(),
            motion,
            link: self.station.counts(),
            received,
            cpu_load: mark.load_until(&now),
            stack_high_water: self.rig.stack_high_water(),
            priorities: self.rig.chip.priorities(),
            final_state,
            simulated_s: (now.at - begun.at).as_secs_f64(),
            busy_s: begun.load_until(&now) * (now.at - begun.at).as_secs_f64(),
        })
    }
}

/// Every control step reports its servo output, every burst its attitude and counts. The offset of
/// the image's clock from the rig's follows from the bursts and the samples that report them.
fn missing(rig: &Rig, received: &Received, window: &Range<Ticks>) -> Missing {
    let truth = rig.truth();
    let within = |time: &Ticks| window.contains(time);
    let steps = truth.steps.iter().map(|s| s.start).filter(within);
    let bursts = truth.bursts.iter().filter(|burst| within(&burst.start));
    let Some(offset) = clock_offset_us(rig, received, false) else {
        return Missing {
            attitudes: bursts.clone().count(),
            servos: steps.count(),
            samples: bursts.count(),
        };
    };
    let steps: Vec<f64> = steps.map(|t| t.as_us_f64() - offset).collect();
    // The time of a sample is that of a whole burst; one of the rates alone begins later.
    let alone_offset = clock_offset_us(rig, received, true).unwrap_or(offset);
    let bursts: Vec<f64> = bursts
        .map(|burst| burst.start.as_us_f64() - if burst.alone { alone_offset } else { offset })
        .collect();
    let servos = received.servos.iter().map(|m| f64::from(m.time_us));
    let samples = received.samples.iter().map(|m| m.time_us as f64);
    let attitudes = received.attitudes.iter().map(|m| f64::from(m.time_ms) * 1e3 + 500.0);
    Missing {
        attitudes: events_without(&bursts, attitudes),
        servos: events_without(&steps, servos),
        samples: events_without(&bursts, samples),
    }
}

/// Offset of the start of bursts, whole or of the rates `alone`, on the rig's clock from the time
/// of their samples on the image's, us: the median over those that came over USB.
fn clock_offset_us(rig: &Rig, received: &Received, alone: bool) -> Option<f64> {
    let bursts = &rig.truth().bursts;
    let mut offsets: Vec<f64> = received
        .samples
        .iter()
        .filter_map(|sample| {
            // The newest burst with these counts that had ended when the message came.
            let until = bursts.partition_point(|b| b.end <= sample.at);
            let burst = bursts[..until]
                .iter()
                .rev()
                .take(5)
                .find(|b| b.words == sample.words())
                .filter(|b| b.alone == alone)?;
            Some(burst.start.as_us_f64() - sample.time_us as f64)
        })
        .collect();
    offsets.sort_by(f64::total_cmp);
    offsets.get(offsets.len() / 2).copied()
}

/// The chip's counters at one moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mark {
    pub(crate) at: Ticks,
    pub(crate) counters: Counters,
}

impl Mark {
    pub(crate) fn of(rig: &Rig) -> Self {
        Self { at: rig.now(), counters: rig.chip.counters() }
    }

    /// Share of the time between two marks for which the core was awake.
    pub(crate) fn load_until(&self, later: &Self) -> f64 {
        let all = (later.at - self.at).0 as f64;
        let asleep = (later.counters.sleep_ticks - self.counters.sleep_ticks) as f64;
        if all > 0.0 { 1.0 - asleep / all } else { 0.0 }
    }
}
