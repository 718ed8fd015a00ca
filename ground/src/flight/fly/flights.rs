//! Flights from one or several tilts: boot once, fork for each start.

use std::time::Instant;

use anyhow::{Context, Result};
use client::{LinkCounts, StateKind};
use rig::bench::FaultEntry;
use rig::flight::{FlightRecord, Ready, Setup};
use rig::measure::{LoopTiming, Spread};
use rig::{Ticks, prepare};
use tvc_nano::Axis;

use super::figures::{Emulation, Measured};
use super::live::Live;
use super::{Flying, report};
use ::report::file::WholeFile;
use ::report::measure::Figures;
use flights::figures::Run;

/// Tilts that are flown from, rad.
pub const STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.8];
/// Pitch rate at release, rad/s.
pub const START_RATE_RAD_S: f64 = 0.2;
/// Length of a flight, s.
pub const FLIGHT_S: f64 = 3.0;
/// Length of the flight without wait states, which only gives cycles, s.
const CYCLES_S: f64 = 1.0;

impl Flying<'_> {
    /// Flies every start at the chip's own wait state, and one more without for its cycles.
    pub(super) fn starts(&self, faults: Vec<FaultEntry>) -> Result<(Figures, String)> {
        let Self { image, options, .. } = self;
        let starts = options.start.map_or(STARTS_RAD.to_vec(), |start| vec![start]);
        let (servo, seed) = (options.servo, options.seed);
        let begun = Instant::now();
        let mut emulation = Emulation::default();
        let mut boot = |what: String, setup: &Setup| -> Result<Ready> {
            let live = Live::begin(what);
            let ready = prepare(image, setup, &mut |progress| live.flight(progress))?;
            let awake =
                ready.rig.now().saturating_sub(Ticks(ready.rig.chip.counters().sleep_ticks));
            emulation.add(ready.rig.now().as_secs_f64(), awake.as_secs_f64());
            live.end();
            Ok(ready)
        };
        let ready = boot(format!("boot, servo {}, seed {seed}", servo.name()), &self.setup(seed))?;
        let mut without_wait_states = self.with_wait_states(0);
        without_wait_states.rig.bench.faults.clear();
        let unhindered = boot("cycles without wait states".into(), &without_wait_states)?;
        let mut fly = |ready: &Ready, start: f64, seconds: f64| -> Result<FlightRecord> {
            let live = Live::begin(format!("from {start} rad"));
            let rate = START_RATE_RAD_S.copysign(start);
            let record = ready.fly(start, rate, seconds, &mut |progress| live.flight(progress));
            let record = record.with_context(|| format!("flying from {start} rad"))?;
            live.end();
            emulation.add(record.simulated_s, record.busy_s);
            Ok(record)
        };
        let records = starts.iter().map(|start| fly(&ready, *start, FLIGHT_S));
        let records = records.collect::<Result<Vec<_>>>()?;
        let unhindered = fly(&unhindered, starts[0], CYCLES_S)?;
        if let (Some(path), Some(waves)) = (&options.vcd, &records[0].waves) {
            let mut file = WholeFile::create(path)?;
            waves.write(&mut file).with_context(|| format!("writing {}", path.display()))?;
            file.keep()?;
        }
        let stacks = records.iter().map(|record| record.stack_high_water);
        let load: f64 = records.iter().map(|record| record.cpu_load).sum();
        let measured = Measured {
            image: image.sizes(),
            stack_bytes: stacks.max().unwrap_or(0),
            unhindered: unhindered.timing,
            timing: pooled(&records),
            cpu_load: load / records.len() as f64,
            link: link(&records),
            runs: records.iter().map(run).collect::<Result<_>>()?,
            faults,
            disturbances: self.setup.rig.bench.disturbances.report(),
            emulation: Emulation { wall_s: begun.elapsed().as_secs_f64(), ..emulation },
            replay: None,
        };
        let title = format!("Flight on the virtual rig: servo {}, seed {seed}", servo.name());
        let plots = records.iter().map(report::flown).collect::<Result<Vec<_>>>()?;
        Ok(report::told(&title, measured.figures(servo), &plots))
    }
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
pub fn pooled(records: &[FlightRecord]) -> LoopTiming {
    let timings = || records.iter().map(|record| &record.timing);
    let spread = |of: fn(&LoopTiming) -> Spread| {
        let all = || timings().map(of);
        let count: usize = all().map(|spread| spread.count).sum();
        let sum: f64 = all().map(|spread| spread.mean * spread.count as f64).sum();
        let mean = if count > 0 { sum / count as f64 } else { 0.0 };
        Spread { mean, max: all().map(|spread| spread.max).fold(0.0, f64::max), count }
    };
    LoopTiming {
        rate_hz: timings().map(|timing| timing.rate_hz).fold(f64::INFINITY, f64::min),
        jitter_us_max: timings().map(|timing| timing.jitter_us_max).fold(0.0, f64::max),
        cycles_per_step: spread(|timing| timing.cycles_per_step),
        latency_us: spread(|timing| timing.latency_us),
        sample_age_us: spread(|timing| timing.sample_age_us),
        steps: timings().map(|timing| timing.steps).sum(),
        bursts: timings().map(|timing| timing.bursts).sum(),
        strays: timings().map(|timing| timing.strays).sum(),
    }
}
