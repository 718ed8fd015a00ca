//! Flights from one or several tilts: boot once, fork for each start.

use anyhow::{Context, Result};
use client::{LinkCounts, StateKind};
use rig::bench::FaultEntry;
use rig::flight::{FlightRecord, Setup};
use rig::{Image, prepare};
use samd21::WaitStates;
use tvc_nano::Axis;

use super::Stopwatch;
use super::figures::Measured;
use super::live::Live;
use super::report::Page;
use crate::flight::figures::Run;
use crate::flight::fly::Fly;

/// Tilts that are flown from, rad.
pub const STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.8];
/// Pitch rate at release, rad/s.
pub const START_RATE_RAD_S: f64 = 0.2;
/// Length of a flight, s.
pub const FLIGHT_S: f64 = 3.0;
/// Length of the flight without wait states, which only gives cycles, s.
const CYCLES_S: f64 = 1.0;

/// Flies every start at the chip's own wait state, and one more without for its cycles.
pub fn fly(
    image: &Image,
    setup: &Setup,
    faults: Vec<FaultEntry>,
    options: &Fly,
) -> Result<(Measured, Page)> {
    let starts = options
        .start
        .map_or(STARTS_RAD.to_vec(), |start| vec![start]);
    let mut watch = Stopwatch::start();
    let servo = options.servo.name();

    let live = Live::begin(format!("boot, servo {servo}, seed {}", options.seed));
    let one = Setup {
        rig: with_wait_states(setup, 1),
        ..setup.clone()
    };
    let ready = prepare(image, &one, &mut |progress| live.flight(progress))?;
    watch.boot(&ready.rig);
    live.end();

    let mut records = Vec::new();
    for start in &starts {
        let live = Live::begin(format!("from {start} rad"));
        let record = ready
            .fly(
                *start,
                START_RATE_RAD_S.copysign(*start),
                FLIGHT_S,
                &mut |progress| live.flight(progress),
            )
            .with_context(|| format!("flying from {start} rad"))?;
        live.end();
        watch.add(record.simulated_s, record.busy_s);
        records.push(record);
    }

    let live = Live::begin("cycles without wait states".into());
    let mut zero = Setup {
        rig: with_wait_states(setup, 0),
        ..setup.clone()
    };
    zero.rig.bench.faults.clear();
    let ready = prepare(image, &zero, &mut |progress| live.flight(progress))?;
    watch.boot(&ready.rig);
    let unhindered = ready.fly(
        starts[0],
        START_RATE_RAD_S.copysign(starts[0]),
        CYCLES_S,
        &mut |progress| {
            live.flight(progress);
        },
    )?;
    watch.add(unhindered.simulated_s, unhindered.busy_s);
    live.end();

    let measured = measured(image, setup, faults, &records, &unhindered, &watch)?;
    Ok((measured, Page::flights(servo, options.seed, records)))
}

/// The rig with so many wait states of its flash.
pub fn with_wait_states(setup: &Setup, states: u8) -> rig::RigConfig {
    rig::RigConfig {
        wait_states: WaitStates::Forced(states),
        ..setup.rig.clone()
    }
}

fn measured(
    image: &Image,
    setup: &Setup,
    faults: Vec<FaultEntry>,
    records: &[FlightRecord],
    unhindered: &FlightRecord,
    watch: &Stopwatch,
) -> Result<Measured> {
    let stacks = records.iter().map(|record| record.stack_high_water);
    let load: f64 = records.iter().map(|record| record.cpu_load).sum();
    Ok(Measured {
        image: image.sizes(),
        stack_bytes: stacks.max().unwrap_or(0),
        unhindered: unhindered.timing,
        timing: pooled(records),
        cpu_load: load / records.len() as f64,
        link: link(records),
        runs: records.iter().map(run).collect::<Result<_>>()?,
        faults,
        disturbances: setup.rig.bench.disturbances.report(),
        emulation: watch.stop(),
        replay: None,
    })
}

/// What arrived over the link in all flights; a control step without its messages counts as lost.
pub fn link(records: &[FlightRecord]) -> LinkCounts {
    let mut sum = LinkCounts::default();
    for record in records {
        let missing = record.missing;
        let without = missing.attitudes + missing.servos + missing.samples;
        sum.messages += record.link.messages;
        // A frame that is missing by its sequence number is also missing at its step: the larger
        // of both counts is the number of frames lost.
        sum.lost += record.link.lost.max(without as u64);
        sum.crc_errors += record.link.crc_errors;
    }
    sum
}

pub fn run(record: &FlightRecord) -> Result<Run> {
    let in_control = record.final_state == Some(StateKind::Active);
    let [start_rad, _] = record.start_rad;
    let response = record.response(Axis::Pitch)?;
    Ok(Run::new(start_rad, &response, in_control))
}

/// Means over all flights, and the worst of each maximum.
pub fn pooled(records: &[FlightRecord]) -> rig::measure::LoopTiming {
    use rig::measure::{LoopTiming, Spread};
    let spread = |of: fn(&LoopTiming) -> Spread| {
        let all = || records.iter().map(|record| of(&record.timing));
        let count: usize = all().map(|spread| spread.count).sum();
        let sum: f64 = all().map(|spread| spread.mean * spread.count as f64).sum();
        let max = all().map(|spread| spread.max).fold(0.0, f64::max);
        Spread {
            mean: if count > 0 { sum / count as f64 } else { 0.0 },
            max,
            count,
        }
    };
    let timings = || records.iter().map(|record| &record.timing);
    LoopTiming {
        rate_hz: timings()
            .map(|timing| timing.rate_hz)
            .fold(f64::INFINITY, f64::min),
        jitter_us_max: timings()
            .map(|timing| timing.jitter_us_max)
            .fold(0.0, f64::max),
        cycles_per_step: spread(|timing| timing.cycles_per_step),
        latency_us: spread(|timing| timing.latency_us),
        sample_age_us: spread(|timing| timing.sample_age_us),
        steps: timings().map(|timing| timing.steps).sum(),
        bursts: timings().map(|timing| timing.bursts).sum(),
        strays: timings().map(|timing| timing.strays).sum(),
    }
}
