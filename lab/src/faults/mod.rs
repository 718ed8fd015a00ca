//! `lab faults`: faults of the sensor, its cable, the chip, the program and the host, at random
//! instants of a flight; and sound vehicles, whose defences are to leave them alone.

mod options;
pub mod report;
mod scenario;
pub mod summary;
pub mod table;

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use rig::faults::{Campaign, Case, Kind, Outcome, Phase, Plan, Sound};
use rig::flight::FlightError;
use rig::{Image, ServoKind, Setup, Ticks, prepare};

use ::report::exit::{BadInput, Verdict};
use ::report::file::write_table;
use ::report::kind::{self, Kind as FileKind};
use ::report::measure::{Figures, figure};
use ground::flight::vehicle::VehicleKind;
pub use options::Faults;
use options::{FaultsCommand, Merge, Rerun};
pub use scenario::Scenario;
use table::{End, Row};

/// Runs of each kind where their number is not given.
const RUNS_OF_EACH: u32 = 50;
/// Instants at which each bit of the timer flips where the number of runs is not given.
const INSTANTS: u32 = 20;
/// Where the page goes if no place is named.
const REPORT: &str = "report/faults.html";
/// Runs of each kind, vehicle, servo and phase of sound vehicles.
const SOUND_OF_EACH: u32 = 2;
/// Unsafe runs that are written as files.
const WRITTEN: usize = 100;

/// Carries out what `options` say.
pub fn run(options: &Faults) -> Result<Verdict> {
    match &options.command {
        None => fly(options),
        Some(FaultsCommand::Merge(options)) => merge(options),
        Some(FaultsCommand::Rerun(options)) => rerun(options),
    }
}

/// What is flown, and what its faults disturb.
#[derive(Clone, Debug)]
pub struct Flown {
    /// What is tried.
    pub plan: Plan,
    /// What hangs on the rig.
    pub vehicle: VehicleKind,
    /// Its servo.
    pub servo: ServoKind,
    /// What it does when a fault begins.
    pub phase: Phase,
    /// What the parts are like, as `--hardware` takes it.
    pub hardware: String,
    /// Of all that is random.
    pub seed: u64,
    /// Length of a run of a sound vehicle, s, if it is given.
    pub seconds: Option<u16>,
}

/// Carries out the campaign, prints its table, and names every unsafe run.
fn fly(options: &Faults) -> Result<Verdict> {
    let all = options.flown()?;
    let report = kind::given_or(options.report.as_deref(), REPORT, FileKind::Page)?;
    kind::try_folder(&options.unsafe_runs)?;
    let begun = Instant::now();
    let mut of_shard = Shard::of(options, &all)?;
    let image = options.image.image()?;
    let mut rows = Vec::new();
    for flown in &all {
        let campaign = campaign(&image, flown)?;
        let cases = of_shard.cases(options, flown, &campaign);
        rows.extend(carry_out(&campaign, &cases, flown, options)?);
    }
    if rows.is_empty() {
        return Err(BadInput::new("--shard: this part of the campaign has no run").into());
    }
    let figures = summary::figures(&rows, Some(begun.elapsed().as_secs_f64()));
    let page = report::render(&figures, &rows)?;
    let verdict = figures.conclude(options.json, Some((&report, page)));
    // What cannot be written is complained of when everything else has been handed over.
    let mut written = write_table(options.out.as_deref(), &rows);
    let bad = rows.iter().filter(|row| row.end.is_bad());
    for (place, row) in bad.enumerate() {
        let how = match row.end {
            End::Alarmed => "alarmed",
            _ => "unsafe",
        };
        eprintln!("{how}: {}: {}", row.story(), row.why);
        if place < WRITTEN {
            let scenario = Scenario::new(options.hardware.text(), row);
            let path = scenario.write(&options.unsafe_runs, place + 1, row);
            let told = path.map(|path| eprintln!("  again: lab faults rerun {}", path.display()));
            written = written.and(told);
        }
    }
    written.and(verdict)
}

/// Joins the tables of shards.
fn merge(options: &Merge) -> Result<Verdict> {
    let files: Vec<&Path> = options.files.iter().map(AsRef::as_ref).collect();
    if let Some(out) = &options.out {
        kind::keep_apart(out, files.iter().copied())?;
    }
    let report = kind::given_or(options.report.as_deref(), REPORT, FileKind::Page)?;
    let rows = table::merge(&files)?;
    let figures = summary::figures(&rows, None);
    let page = report::render(&figures, &rows)?;
    let verdict = figures.conclude(options.json, Some((&report, page)));
    write_table(options.out.as_deref(), &rows).and(verdict)
}

/// Carries out one run again.
fn rerun(options: &Rerun) -> Result<Verdict> {
    let (flown, case) = Scenario::read(&options.file)?;
    let outcome = campaign(&options.image.image()?, &flown)?.run(case)?;
    let row = Row::new(&flown, &outcome);
    let figures = summary::figures(std::slice::from_ref(&row), None);
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

/// What runs are carried out on.
enum Base {
    /// The flight, or another phase, that faults disturb.
    Faults(Box<Campaign>),
    /// Sound vehicles, each with a flight of its own.
    Sound(Box<Sound>),
}

impl Base {
    fn run(&self, case: Case) -> Result<Outcome, FlightError> {
        match (self, case.kind) {
            (Self::Sound(sound), Kind::Sound(kind)) => sound.run(kind, case.number),
            (Self::Sound(_), _) => unreachable!("the plan has kinds of sound vehicles alone"),
            (Self::Faults(campaign), _) => campaign.run(case),
        }
    }

    /// How many bits of the servo timer there are to flip.
    fn timer_bits(&self) -> u32 {
        match self {
            Self::Faults(campaign) => campaign.timer_bits().len() as u32,
            Self::Sound(_) => 0,
        }
    }
}

/// The flight, or another phase, that is to be disturbed, or the vehicle that is sound.
fn campaign(image: &Image, flown: &Flown) -> Result<Base> {
    let mut setup = Setup::with_polarity(flown.servo, flown.seed);
    setup.rig.hardware = flown.hardware.parse().map_err(BadInput::new)?;
    flown.vehicle.hang(&mut setup.rig)?;
    if flown.plan == Plan::Sound {
        let sound = Sound::new(image, setup, flown.phase).with_hardware(&flown.hardware);
        let sound = sound.map_err(BadInput::new)?;
        let sound = match flown.seconds {
            Some(seconds) => sound.lasting(Ticks::from_ms(1000 * u64::from(seconds))),
            None => sound,
        };
        return Ok(Base::Sound(Box::new(sound)));
    }
    let bar = spinner("boot and flight, or another phase, without a fault");
    let ready = prepare(image, &setup, &mut |_| {})?;
    let frame_hz = f64::from(flown.servo.frame_hz());
    let campaign = Campaign::new(&ready, frame_hz, flown.phase, flown.seed)
        .with_context(|| format!("phase {}, which is to be disturbed", flown.phase))?;
    bar.finish_and_clear();
    Ok(Base::Faults(Box::new(campaign.by(flown.plan))))
}

/// The runs of this shard.
struct Shard {
    /// Runs of each kind.
    of_each: u32,
    part: u64,
    parts: u64,
    /// Runs of all shards so far.
    index: u64,
}

impl Shard {
    /// # Errors
    /// A kind is none of the phase's.
    fn of(options: &Faults, all: &[Flown]) -> Result<Self> {
        let sensor_kind = options
            .kind
            .iter()
            .find(|kind| matches!(kind, Kind::Sensor(_)));
        let other_phase = all.iter().find(|flown| flown.phase != Phase::Flight);
        if let (Some(kind), Some(flown)) = (sensor_kind, other_phase) {
            let why = format!("--phase {}: {kind} is a fault of phase flight", flown.phase);
            return Err(BadInput::new(why).into());
        }
        let kinds: usize = all.iter().map(|flown| kinds(options, flown).len()).sum();
        let is_sound = all.iter().any(|flown| flown.plan == Plan::Sound);
        let usual = if is_sound {
            SOUND_OF_EACH
        } else {
            RUNS_OF_EACH
        };
        let of_each = options
            .runs
            .map_or(usual, |runs| runs.div_ceil(kinds.max(1) as u32));
        let (part, parts) = options.shard.unwrap_or((0, 1));
        Ok(Self {
            of_each,
            part,
            parts,
            index: 0,
        })
    }

    /// The runs of a campaign, by kind and number.
    fn cases(&mut self, options: &Faults, flown: &Flown, campaign: &Base) -> Vec<Case> {
        let of_each = match (flown.plan, options.runs) {
            (Plan::TimerBits, None) => INSTANTS * campaign.timer_bits(),
            _ => self.of_each,
        };
        let kinds = kinds(options, flown).into_iter();
        let all = kinds.flat_map(|kind| (0..of_each).map(move |number| Case { kind, number }));
        all.filter(|_| {
            self.index += 1;
            (self.index - 1) % self.parts == self.part
        })
        .collect()
    }
}

/// What fails.
fn kinds(options: &Faults, flown: &Flown) -> Vec<Kind> {
    let mut kinds = flown.plan.kinds(flown.phase);
    if !options.kind.is_empty() {
        kinds.retain(|kind| options.kind.contains(kind));
    }
    kinds
}

fn carry_out(campaign: &Base, cases: &[Case], flown: &Flown, options: &Faults) -> Result<Vec<Row>> {
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
                Ok(Row::new(flown, &outcome))
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
