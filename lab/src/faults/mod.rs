//! `lab faults`: faults of the sensor, its cable, the chip, the program and the host, at random
//! instants of a flight; and sound vehicles, whose defences are to leave them alone.

mod named;
mod options;
pub mod report;
mod scenario;
pub mod summary;
pub mod table;

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use indicatif::ProgressBar;
use rig::faults::{Campaign, Case, Kind, Phase, Plan, Sound};
use rig::{Image, ServoKind, Setup, Ticks, prepare};
use serde::{Deserialize, Serialize};

use ::report::campaign::{carry_out, read_run};
use ::report::exit::{BadInput, Verdict};
use ::report::file::write_table;
use ::report::kind;
use ::report::measure::{Figures, figure};
use design::vehicle::{VehicleChoice, VehicleKind};
use ground::flight::sensor::Kind as Sensor;
use ground::flight::sensor::{self, SensorOption};
pub use options::Faults;
use options::{FaultsCommand, Rerun};
pub use scenario::Scenario;
use table::{End, Row};

/// What pages are named.
const NAME: &str = "faults";
/// Runs of each kind where their number is not given.
const RUNS_OF_EACH: u32 = 50;
/// Instants at which each bit of the timer flips where the number of runs is not given.
const INSTANTS: u32 = 20;
/// Runs of each kind, vehicle, servo and phase of sound vehicles.
const SOUND_OF_EACH: u32 = 2;
/// Unsafe runs that are written as files.
const WRITTEN: usize = 100;

/// Carries out what `options` say.
pub fn run(options: &Faults) -> Result<Verdict> {
    match &options.command {
        None => fly(options),
        Some(FaultsCommand::Merge(options)) => options.run(NAME, |rows| present(rows, None)),
        Some(FaultsCommand::Rerun(options)) => rerun(options),
    }
}

/// What is flown, and what its faults disturb.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flown {
    /// Of all that is random.
    pub seed: u64,
    /// What is tried.
    #[serde(rename = "campaign", with = "named")]
    pub plan: Plan,
    /// What hangs on the rig.
    pub vehicle: VehicleKind,
    /// Its servo.
    #[serde(with = "named")]
    pub servo: ServoKind,
    /// What the parts are like, as `--hardware` takes it.
    pub hardware: String,
    /// Its sensors, as `--sensor` takes them.
    #[serde(default = "bno055", skip_serializing_if = "is_bno055")]
    pub sensor: String,
    /// What it does when a fault begins.
    #[serde(with = "named")]
    pub phase: Phase,
    /// Length of a run of a sound vehicle, s, if it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<u16>,
}

/// What files of runs with a BNO055 leave out.
fn bno055() -> String {
    Sensor::default().name().to_owned()
}

fn is_bno055(sensor: &String) -> bool {
    *sensor == bno055()
}

/// The figures and the page of a campaign's rows.
fn present(rows: &[Row], wall_s: Option<f64>) -> Result<(Figures, String)> {
    let figures = summary::figures(rows, wall_s);
    let page = report::render(&figures, rows)?;
    Ok((figures, page))
}

/// Carries out the campaign, prints its table, and names every unsafe run.
fn fly(options: &Faults) -> Result<Verdict> {
    let all = options.flown()?;
    let report = options.output.page(NAME)?;
    kind::try_folder(&options.unsafe_runs)?;
    let begun = Instant::now();
    let of_each = runs_of_each(options, &all)?;
    let (part, parts) = options.shard.unwrap_or((0, 1));
    // Runs of all shards so far.
    let mut index = 0;
    let mut is_of_shard = || {
        index += 1;
        (index - 1) % parts == part
    };
    let image = sealed(options.image.image()?);
    let (mut rows, mut bad) = (Vec::new(), Vec::new());
    for flown in &all {
        let base = Base::new(&image, flown)?;
        let of_each = match (flown.plan, options.runs) {
            (Plan::TimerBits, None) => INSTANTS * base.timer_bits(),
            _ => of_each,
        };
        let kinds = kinds(options, flown).into_iter();
        let cases = kinds.flat_map(|kind| (0..of_each).map(move |number| Case { kind, number }));
        let cases: Vec<Case> = cases.filter(|_| is_of_shard()).collect();
        let flown_rows =
            carry_out("runs", &cases, options.campaign.jobs, |case| base.row(flown, *case))?;
        for (case, row) in cases.iter().zip(&flown_rows) {
            if row.end.is_bad() {
                bad.push((Scenario::new(flown, *case, &image), row.clone()));
            }
        }
        rows.extend(flown_rows);
    }
    if rows.is_empty() {
        return Err(BadInput::new("--shard: this part of the campaign has no run").into());
    }
    let (figures, page) = present(&rows, Some(begun.elapsed().as_secs_f64()))?;
    let mut verdict = options.output.conclude(&rows, &figures, (&report, page));
    for (place, (scenario, row)) in bad.iter().enumerate() {
        let how = match row.end {
            End::Alarmed => "alarmed",
            _ => "unsafe",
        };
        eprintln!("{how}: {}: {}", row.story(), row.why);
        if place < WRITTEN {
            let path = scenario.write(&options.unsafe_runs, row);
            let told =
                path.map(|path| eprintln!("  again: cargo lab faults rerun {}", path.display()));
            verdict = verdict.and_then(|verdict| told.map(|()| verdict));
        }
    }
    verdict
}

/// Carries out one run again.
fn rerun(options: &Rerun) -> Result<Verdict> {
    let scenario = read_run(&options.file, Scenario::parse)?;
    let image = sealed(options.image.image()?);
    let (flown, case) = scenario.flown(&image);
    let row = Base::new(&image, flown)?.row(flown, case)?;
    let figures = summary::figures(std::slice::from_ref(&row), None);
    let said = Figures::from([
        figure("run", row.story()).shown("run", "", 0),
        figure("ended", format!("{:?}", row.end).to_lowercase()).shown("ended", "", 0),
        figure("why", row.why.as_str()).shown("why", "", 0),
    ]);
    if !options.json {
        eprint!("{}", said.text());
    }
    let verdict = figures.conclude(options.json, None);
    write_table(options.out.as_deref(), &[row]).and(verdict)
}

/// What runs are carried out on.
enum Base {
    /// The flight, or another phase, that faults disturb.
    Faults(Box<Campaign>),
    /// Sound vehicles, each with a flight of its own.
    Sound(Box<Sound>),
}

impl Base {
    /// The flight, or another phase, that is to be disturbed, or the vehicle that is sound.
    fn new(image: &Image, flown: &Flown) -> Result<Self> {
        let mut setup = Setup::with_polarity(flown.servo, flown.seed);
        setup.rig.hardware = flown.hardware.parse().map_err(BadInput::new)?;
        VehicleChoice::Known(flown.vehicle).read(flown.servo)?.hang(&mut setup.rig)?;
        if !is_bno055(&flown.sensor) {
            let sensor = Some(sensor::kind(&flown.sensor).map_err(BadInput::new)?);
            SensorOption { sensor }.fit(&mut setup.rig)?;
        }
        if flown.plan == Plan::Sound {
            let sound = Sound::new(image, setup, flown.phase).with_hardware(&flown.hardware);
            let mut sound = sound.map_err(BadInput::new)?;
            let length = |seconds| Ticks::from_ms(1000 * u64::from(seconds));
            sound.length = flown.seconds.map(length);
            return Ok(Self::Sound(Box::new(sound)));
        }
        let bar = ProgressBar::new_spinner()
            .with_message("boot and flight, or another phase, without a fault");
        bar.enable_steady_tick(Duration::from_millis(120));
        let ready = prepare(image, &setup, &mut |_| {})?;
        let frame_hz = f64::from(flown.servo.frame_hz());
        let mut campaign = Campaign::new(&ready, frame_hz, flown.phase, flown.seed)
            .with_context(|| format!("phase {}, which is to be disturbed", flown.phase))?;
        bar.finish_and_clear();
        campaign.plan = flown.plan;
        Ok(Self::Faults(Box::new(campaign)))
    }

    /// The row of a run: the same for the same image, whatever was run before or beside it.
    fn row(&self, flown: &Flown, case: Case) -> Result<Row> {
        let outcome = match (self, case.kind) {
            (Self::Sound(sound), Kind::Sound(kind)) => sound.run(kind, case.number),
            (Self::Sound(_), _) => unreachable!("the plan has kinds of sound vehicles alone"),
            (Self::Faults(campaign), _) => campaign.run(case),
        };
        let outcome =
            outcome.with_context(|| format!("run {} of fault {}", case.number, case.kind));
        Ok(Row::new(flown, &outcome?))
    }

    /// How many bits of the servo timer there are to flip.
    fn timer_bits(&self) -> u32 {
        match self {
            Self::Faults(campaign) => campaign.timer_bits().len() as u32,
            Self::Sound(_) => 0,
        }
    }
}

/// Runs of each kind where the plan does not count them otherwise.
///
/// # Errors
/// The phase does not have a kind.
fn runs_of_each(options: &Faults, all: &[Flown]) -> Result<u32> {
    let sensor_kind =
        options.kind.iter().find(|kind| matches!(kind, Kind::Sensor(_) | Kind::Onboard(_)));
    let other_phase = all.iter().find(|flown| flown.phase != Phase::Flight);
    if let (Some(kind), Some(flown)) = (sensor_kind, other_phase) {
        let why = format!("--phase {}: {kind} is a fault of phase flight", flown.phase);
        return Err(BadInput::new(why).into());
    }
    let kinds: usize = all.iter().map(|flown| kinds(options, flown).len()).sum();
    let is_sound = all.iter().any(|flown| flown.plan == Plan::Sound);
    let usual = if is_sound { SOUND_OF_EACH } else { RUNS_OF_EACH };
    Ok(options.runs.map_or(usual, |runs| runs.div_ceil(kinds.max(1) as u32)))
}

/// What fails.
fn kinds(options: &Faults, flown: &Flown) -> Vec<Kind> {
    let mut kinds = flown.plan.kinds(flown.phase);
    kinds.retain(|kind| match kind {
        Kind::Sensor(_) => flown.sensor != Sensor::Lsm6ds3.name(),
        Kind::Onboard(_) => !is_bno055(&flown.sensor),
        Kind::System(_) | Kind::Sound(_) => true,
    });
    if !options.kind.is_empty() {
        kinds.retain(|kind| options.kind.contains(kind));
    }
    kinds
}

/// The image, with a warning where it does not check itself.
fn sealed(image: Image) -> Image {
    if !image.is_sealed() {
        eprintln!(
            "warning: the image is not sealed and does not check itself: damage to it goes unnoticed; `cargo tvc flash --elf FILE` seals one"
        );
    }
    image
}
