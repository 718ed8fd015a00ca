//! A recording through the whole image: the emulated BNO055 plays it, the image estimates the
//! attitude from it, and what arrives over USB is scored and compared with the host's library.

use crate::fly::flight::{FlightError, Mark};
use crate::ground_station::{Attitude, GroundStation, RawImu, Received};
use crate::image::Image;
use crate::observe::measure::LoopTiming;
use crate::rig::{Rig, RigConfig};
use client::{LinkCounts, StateKind};
use recordings::{Recording, Score, Scorer};
use samd21::board::Ticks;
use std::collections::BTreeMap;
use std::sync::Arc;
use tvc_nano::failsafe::BootReport;
use tvc_nano::{Flight, Micros, Params, RawSample};

/// How often progress is reported.
const PROGRESS: Ticks = Ticks::from_ms(100);

/// How the image's quaternions compare with the host library's on the same counts and times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parity {
    /// Samples whose quaternion is the same, bit for bit.
    pub equal: usize,
    /// Samples compared.
    pub compared: usize,
}

/// What came out of a replay.
#[derive(Clone, Debug)]
pub struct ReplayRecord {
    /// Errors over the movement; `None` if the movement was not reached.
    pub score: Option<Score>,
    /// Image against host library.
    pub parity: Parity,
    /// Timing of the control loop from standby on.
    pub timing: LoopTiming,
    /// Counts of the link.
    pub link: LinkCounts,
    /// What came over USB.
    pub received: Received,
    /// Number of attitudes that belong to no burst on the bus; 0 unless messages were lost.
    pub unmatched: usize,
    /// Share of the time for which the core was awake.
    pub cpu_load: f64,
    /// Deepest stack, bytes.
    pub stack_high_water: u32,
    /// Time simulated, s.
    pub simulated_s: f64,
}

/// Plays `recording` from power-on to its end, or for `longest_s`. The drone stays in its clamp;
/// the sensor's own imperfections are off, the recording has its own. `progress` gets the time
/// played, s.
///
/// # Errors
/// The rig stopped, or the image does not answer.
pub fn replay(
    image: &Image,
    recording: &Arc<Recording>,
    config: &RigConfig,
    longest_s: f64,
    progress: &mut dyn FnMut(f64),
) -> Result<ReplayRecord, FlightError> {
    let mut rig = Rig::new(image, config)?;
    rig.environment.sensor.play(recording.clone(), Ticks::ZERO);
    let mut station = GroundStation::default();
    let begin = Mark::of(&rig);
    let end = Ticks::from_secs_f64(recording.duration_s().min(longest_s));
    station.connect(&mut rig)?;
    station.list_parameters(&mut rig)?;
    while rig.now() < end {
        let slice = PROGRESS.min(end - rig.now());
        station.run(&mut rig, slice)?;
        progress(rig.now().as_secs_f64());
    }
    let finish = Mark::of(&rig);
    let received = station.received().clone();
    let pairs = pair(&received);
    let (score, unmatched) = score(&rig, recording, &pairs);
    let parity = parity(&received.parameters, &pairs);
    Ok(ReplayRecord {
        score,
        parity,
        timing: LoopTiming::over(rig.truth(), standby(&received)..end),
        link: station.counts(),
        unmatched,
        received,
        cpu_load: begin.load_until(&finish),
        stack_high_water: rig.stack_high_water(),
        simulated_s: finish.at.as_secs_f64(),
    })
}

/// When the image reached standby, or power-on if it never did. Its timing is measured from then
/// on: before, the sensor starts up.
fn standby(received: &Received) -> Ticks {
    let mut heartbeats = received.heartbeats.iter();
    heartbeats
        .find(|heartbeat| heartbeat.state == Some(StateKind::Standby))
        .map_or(Ticks::ZERO, |heartbeat| heartbeat.at)
}

/// Every raw sample that came over USB, with the attitude of the same step: the last attitude of
/// its millisecond, because a step without a sample may have ended just before the burst began.
pub fn pair(received: &Received) -> Vec<(RawImu, Attitude)> {
    let mut attitudes = received.attitudes.iter().peekable();
    received
        .samples
        .iter()
        .filter_map(|sample| {
            let time_ms = (sample.time_us / 1000) as u32;
            while attitudes.next_if(|a| a.time_ms < time_ms).is_some() {}
            let attitude = std::iter::from_fn(|| attitudes.next_if(|a| a.time_ms == time_ms));
            Some((*sample, *attitude.last()?))
        })
        .collect()
}

/// Scores attitudes against the reference of the sample that their burst read; also returns the
/// number of those that belong to no burst.
fn score(rig: &Rig, recording: &Recording, pairs: &[(RawImu, Attitude)]) -> (Option<Score>, usize) {
    let mut bursts = rig.truth().bursts.iter();
    let mut scorer = Scorer::default();
    let mut unmatched = 0;
    let mut before = None;
    for (sample, attitude) in pairs {
        // Bursts and messages come in the same order; bursts may be left over. Rates that jump are
        // held: their sample has the rates of the sample before.
        let (words, mut ahead) = (sample.words(), bursts.clone());
        let is_held = before.replace(sample.gyr) == Some(sample.gyr);
        let found = ahead.find(|burst| {
            let [rest @ .., _, _, _] = burst.words;
            burst.words == words || is_held && words.starts_with(&rest)
        });
        let Some(burst) = found else {
            unmatched += 1;
            continue;
        };
        bursts = ahead;
        let shown = burst.refresh.recorded.map(|i| recording.samples()[i]);
        if let Some(truth) = shown
            && truth.movement
            && let Some(reference) = truth.reference
        {
            scorer.add(attitude.quaternion.map(f64::from), reference);
        }
    }
    (scorer.score(), unmatched)
}

/// Runs the host's library on the counts and times that came over USB, with the image's own
/// parameters, and compares quaternions bit for bit.
pub fn parity(parameters: &BTreeMap<String, f32>, pairs: &[(RawImu, Attitude)]) -> Parity {
    let mut params = Params::default();
    let known = parameters.iter().all(|(name, value)| params.set(name, *value).is_ok());
    let mut refresh = params.refresh();
    let Ok(mut flight) = Flight::new(params, BootReport::default()) else {
        return Parity::default();
    };
    let mut parity = Parity::default();
    for (sample, attitude) in pairs {
        let time = Micros(sample.time_us);
        let raw = RawSample { time, acc: sample.acc, gyr: sample.gyr, mag: sample.mag };
        let host = flight.step(time, Ok(refresh.read(raw)));
        let host = host.orientation.parts();
        let host = [host.w, host.x, host.y, host.z].map(f32::to_bits);
        parity.compared += 1;
        parity.equal += usize::from(known && host == attitude.quaternion.map(f32::to_bits));
    }
    parity
}
