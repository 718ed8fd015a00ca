//! `tvc faults`: faults of the sensor, its cable, the chip, the program and the host, at random
//! instants of a flight.

mod options;
mod report;
mod scenario;
mod summary;
mod table;

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use rig::bench::Hardware;
use rig::faults::{Campaign, Case, GLITCHES, Kind, Phase};
use rig::{ServoKind, Setup, prepare};

use crate::flight::vehicle::VehicleKind;
use crate::image::ImageOption;
use crate::out::exit::{BadInput, Verdict};
use crate::out::kind;
use crate::out::measure::{Figures, figure};
pub use options::Faults;
use options::{FaultsCommand, Merge, Replay};
pub use scenario::Scenario;
use table::{End, Row};

/// Runs of each kind where their number is not given.
const RUNS_OF_EACH: u32 = 50;
/// Unsafe runs that are written as files.
const WRITTEN: usize = 100;

/// Carries out what `options` say.
pub fn run(options: &Faults) -> Result<Verdict> {
    match &options.command {
        None => fly(options),
        Some(FaultsCommand::Merge(options)) => merge(options),
        Some(FaultsCommand::Replay(options)) => replay(options),
    }
}

/// Carries out the campaign, prints its table, and names every unsafe run.
fn fly(options: &Faults) -> Result<Verdict> {
    if options.vehicle == VehicleKind::Rocket {
        return Err(BadInput::new(
            "--vehicle rocket: the campaign's flights are those of a drone; take drone or drone2",
        )
        .into());
    }
    if options.glitches && options.phase != Phase::Flight {
        return Err(BadInput::new("--phase: glitches are flown, in phase flight").into());
    }
    let cases = cases(options)?;
    let begun = Instant::now();
    let campaign = campaign(
        &options.image,
        options.vehicle,
        options.hardware.hardware()?,
        options.phase,
        options.seed,
        options.glitches,
    )?;
    let rows = carry_out(&campaign, &cases, options)?;
    if rows.is_empty() {
        return Err(BadInput::new("--shard: this part of the campaign has no run").into());
    }
    if let Some(out) = &options.out {
        table::write(out, &rows)?;
    }
    let figures = summary::figures(&rows, options.glitches, Some(begun.elapsed().as_secs_f64()));
    let page = report::render(&figures, &rows)?;
    let verdict = figures.conclude(options.json, Some((&options.report, page)))?;
    let unsafe_runs = rows.iter().filter(|row| row.end == End::Unsafe);
    for (place, row) in unsafe_runs.enumerate() {
        eprintln!("unsafe: {}: {}", row.story(), row.why);
        if place < WRITTEN {
            let scenario = Scenario::new(options, row);
            let path = scenario.write(&options.unsafe_runs, place + 1, row)?;
            eprintln!("  again: tvc faults replay {}", path.display());
        }
    }
    Ok(verdict)
}

/// Joins the tables of shards.
fn merge(options: &Merge) -> Result<Verdict> {
    let files: Vec<&Path> = options.files.iter().map(AsRef::as_ref).collect();
    if let Some(out) = &options.out {
        kind::keep_apart(out, files.iter().copied())?;
    }
    let rows = table::merge(&files)?;
    if let Some(out) = &options.out {
        table::write(out, &rows)?;
    }
    let figures = summary::figures(&rows, false, None);
    let page = report::render(&figures, &rows)?;
    figures.conclude(options.json, Some((&options.report, page)))
}

/// The page of a table of runs, as [`merge`] makes it: for the fuzzer.
///
/// # Errors
/// The file is no table of runs.
#[cfg(test)]
pub fn merged(path: &Path) -> Result<String> {
    let rows = table::merge(&[path])?;
    report::render(&summary::figures(&rows, false, None), &rows)
}

/// Carries out one run again.
fn replay(options: &Replay) -> Result<Verdict> {
    let (scenario, vehicle, phase, case) = Scenario::read(&options.file)?;
    let hardware = scenario.hardware.parse().map_err(BadInput::new)?;
    let campaign = campaign(
        &options.image,
        vehicle,
        hardware,
        phase,
        scenario.seed,
        scenario.glitches,
    )?;
    let outcome = campaign.run(case)?;
    let row = Row::new(scenario.seed, vehicle.name(), phase, &outcome);
    let figures = summary::figures(std::slice::from_ref(&row), false, None);
    let said = Figures::from([
        figure("run", row.story()).shown("run", "", 0),
        figure("ended", format!("{:?}", row.end).to_lowercase()).shown("ended", "", 0),
        figure("why", row.why.as_str()).shown("why", "", 0),
    ]);
    if !options.json {
        eprint!("{}", said.text());
    }
    figures.conclude(options.json, None)
}

/// The flight, or another phase, that is to be disturbed.
fn campaign(
    image: &ImageOption,
    vehicle: VehicleKind,
    hardware: Hardware,
    phase: Phase,
    seed: u64,
    glitches: bool,
) -> Result<Campaign> {
    let image = image.image()?;
    let bar = spinner("boot and flight, or another phase, without a fault");
    let mut setup = Setup::with_polarity(ServoKind::S3003, seed);
    setup.rig.hardware = hardware;
    vehicle.hang(&mut setup.rig)?;
    let ready = prepare(&image, &setup, &mut |_| {})?;
    let frame_hz = f64::from(setup.servo.frame_hz());
    let campaign = Campaign::new(&ready, frame_hz, phase, seed)
        .with_context(|| format!("phase {phase}, which is to be disturbed"))?;
    bar.finish_and_clear();
    Ok(if glitches {
        campaign.of_glitches()
    } else {
        campaign
    })
}

/// The runs of this shard, by kind and number.
///
/// # Errors
/// A kind is none of the phase's.
fn cases(options: &Faults) -> Result<Vec<Case>> {
    let mut kinds = Kind::all();
    if options.glitches {
        kinds = GLITCHES.map(Kind::Sensor).to_vec();
    } else if !options.kind.is_empty() {
        kinds.retain(|kind| options.kind.contains(kind));
    } else if options.phase != Phase::Flight {
        kinds.retain(|kind| matches!(kind, Kind::System(_)));
    }
    let of_sensor = kinds.iter().find(|kind| matches!(kind, Kind::Sensor(_)));
    if let Some(kind) = of_sensor
        && options.phase != Phase::Flight
    {
        let why = format!(
            "--phase {}: {kind} is a fault of phase flight",
            options.phase
        );
        return Err(BadInput::new(why).into());
    }
    let of_each = options
        .runs
        .map_or(RUNS_OF_EACH, |runs| runs.div_ceil(kinds.len() as u32));
    let (part, parts) = options.shard.unwrap_or((0, 1));
    let all = kinds
        .into_iter()
        .flat_map(|kind| (0..of_each).map(move |number| Case { kind, number }))
        .enumerate()
        .filter(|(index, _)| *index as u64 % parts == part);
    Ok(all.map(|(_, case)| case).collect())
}

fn carry_out(campaign: &Campaign, cases: &[Case], options: &Faults) -> Result<Vec<Row>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.jobs.map_or(0, usize::from))
        .build()?;
    let bar = ProgressBar::new(cases.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} runs, {eta} to go") {
        bar.set_style(style);
    }
    let rows = pool.install(|| {
        cases
            .par_iter()
            .map(|&case| {
                let outcome = campaign
                    .run(case)
                    .with_context(|| format!("run {} of fault {}", case.number, case.kind))?;
                bar.inc(1);
                let vehicle = options.vehicle.name();
                Ok(Row::new(options.seed, vehicle, options.phase, &outcome))
            })
            .collect()
    });
    bar.finish_and_clear();
    rows
}

fn spinner(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(what);
    bar.enable_steady_tick(Duration::from_millis(120));
    bar
}
