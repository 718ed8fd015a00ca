//! Flights from one or several tilts: boot once, fork for each start.

use anyhow::{Context, Result};
use client::StateKind;
use rig::bench::FaultEntry;
use rig::flight::{FlightRecord, Setup};
use rig::{Image, prepare};
use samd21::WaitStates;

use super::figures::{Figures, RunFigures, TelemetryFigures};
use super::live::Live;
use super::report::Page;
use super::{Stopwatch, image_figures, loop_figures};
use crate::flight::fly::Fly;

/// Tilts that are flown from, rad.
const STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.8];
/// Pitch rate at release, rad/s.
const START_RATE_RAD_S: f64 = 0.2;
/// Length of a flight, s.
pub const FLIGHT_S: f64 = 3.0;
/// Length of the flight without wait states, which only gives cycles, s.
const CYCLES_S: f64 = 1.0;
/// Settling band, share of the start.
const BAND: f64 = 0.05;

/// Flies every start at the chip's own wait state, and one more without for its cycles.
pub fn fly(
    image: &Image,
    setup: &Setup,
    faults: Vec<FaultEntry>,
    options: &Fly,
) -> Result<(Figures, Page)> {
    let starts = options
        .start
        .map_or(STARTS_RAD.to_vec(), |start| vec![start]);
    let mut watch = Stopwatch::start();
    let servo = setup.servo.name();

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
            .fly(*start, START_RATE_RAD_S, FLIGHT_S, &mut |progress| {
                live.flight(progress)
            })
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
    let unhindered = ready.fly(starts[0], START_RATE_RAD_S, CYCLES_S, &mut |progress| {
        live.flight(progress);
    })?;
    watch.add(unhindered.simulated_s, unhindered.busy_s);
    live.end();

    let figures = figures(image, setup, faults, &records, &unhindered, &watch);
    Ok((figures, Page::flights(servo, options.seed, records)))
}

fn with_wait_states(setup: &Setup, states: u8) -> rig::RigConfig {
    rig::RigConfig {
        wait_states: WaitStates::Forced(states),
        ..setup.rig.clone()
    }
}

fn figures(
    image: &Image,
    setup: &Setup,
    faults: Vec<FaultEntry>,
    records: &[FlightRecord],
    unhindered: &FlightRecord,
    watch: &Stopwatch,
) -> Figures {
    let stack = records
        .iter()
        .map(|record| record.stack_high_water)
        .max()
        .unwrap_or(0);
    let timing = pooled(records);
    let load = records.iter().map(|record| record.cpu_load).sum::<f64>() / records.len() as f64;
    Figures {
        image: image_figures(image, stack),
        control: loop_figures(&unhindered.timing, &timing, load),
        latency_us: timing.latency_us.into(),
        sample_age_us: timing.sample_age_us.into(),
        telemetry: records
            .iter()
            .map(telemetry)
            .fold(TelemetryFigures::default(), |sum, one| TelemetryFigures {
                messages: sum.messages + one.messages,
                lost: sum.lost + one.lost,
                crc_errors: sum.crc_errors + one.crc_errors,
            }),
        runs: records.iter().map(run).collect(),
        faults,
        disturbances: setup.rig.bench.disturbances.report(),
        emulation: watch.figures(),
        replay: None,
    }
}

fn telemetry(record: &FlightRecord) -> TelemetryFigures {
    let missing = record.missing;
    let without = missing.attitudes + missing.servos + missing.samples;
    TelemetryFigures {
        messages: record.link.messages,
        // A frame that is missing by its number is also missing at its step.
        lost: record.link.lost.max(without as u64),
        crc_errors: record.link.crc_errors,
    }
}

fn run(record: &FlightRecord) -> RunFigures {
    RunFigures {
        start_rad: record.start_rad,
        overshoot_pct: record.response.overshoot_pct(),
        rise_s: record.response.rise_s(),
        settling_5pct_s: record.response.settling_s(BAND),
        final_error_rad: record.response.final_error(),
        stayed_active: record.final_state == Some(StateKind::Active),
    }
}

/// Means over all flights, and the worst of each maximum.
fn pooled(records: &[FlightRecord]) -> rig::measure::LoopTiming {
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
    }
}
