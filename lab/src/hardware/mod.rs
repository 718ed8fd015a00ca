//! `lab hardware`: flights with chips, sensors and computers that differ from the default.

mod row;
mod settings;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use maud::html;
use rayon::prelude::*;
use rig::bench::Hardware;
use rig::bench::hardware::keys;
use rig::{Image, ServoKind, Setup};
use row::{Ending, Flown};

use ground::flight::fly::flights::STARTS_RAD;
use ground::image::ImageOption;
use report::exit::{BadInput, Verdict};
use report::kind;
use report::measure::{Figures, figure, rows};
use report::page::{page, verdicts};

/// The start of `--quick`, rad.
const QUICK_START_RAD: f64 = 0.4;

/// Options of `lab hardware`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo lab hardware                            all settings, six flights each
  cargo lab hardware --quick                    all settings, one flight each
  cargo lab hardware --only stretch stop-read   those that set one of these keys
  cargo lab hardware --json > hardware.json     for a script

Each row is what --hardware of `tvc fly` would be given; the image boots with it and flies from 0.2,
0.4 and 0.8 rad, with an analog and with a digital servo. A row has the worst of its flights, which
are held to what `tvc fly` requires. `burst` and `longest` are what the image itself reports of the
transfers from its sensor. A sensor that holds the bus longer than some 280 us in each byte cannot be
flown within 8 ms of latency with both servos, and above some 365 us the image refuses to arm: both
are expected.

Exit status: 0 every row ended as expected, 1 one did not or something failed, 2 unusable input.")]
pub struct HardwareCampaign {
    /// Only settings with one of these keys [default: all].
    #[arg(long, value_name = "KEY", num_args = 1..)]
    pub only: Vec<String>,

    /// One flight a setting, from 0.4 rad with the analog servo.
    #[arg(long)]
    pub quick: bool,

    /// Seed of all that is random: sensor noise and bias, its bus, clock phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Settings at a time [default: one for each processor core].
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Where to write the HTML report.
    #[arg(long, value_name = "FILE.html", default_value = "report/hardware.html", value_parser = kind::page)]
    pub report: PathBuf,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Flies every setting and prints the table.
pub fn run(options: &HardwareCampaign) -> Result<Verdict> {
    let begun = Instant::now();
    let settings = chosen(&options.only)?;
    let image = options.image.image()?;
    let flown = fly(&image, &settings, options)?;
    let each = flown.len() / settings.len();
    let table = settings
        .iter()
        .zip(flown.chunks(each))
        .map(|((setting, expected), flown)| row::row(setting, *expected, flown, !options.quick));
    let figures = Figures::from([
        figure("seed", options.seed).shown("seed", "", 0),
        rows("rows", table),
        figure("wall_s", begun.elapsed().as_secs_f64()).shown("time that it took", "s", 1),
    ]);
    let title = format!("Parts that differ: {} settings", settings.len());
    let body = html! {
        (verdicts(&figures.missed()))
        (figures.table("rows").markup())
        (figures.lines().markup())
        footer {
            "The firmware image in flight on an emulated SAMD21 and BNO055, each row the worst of its "
            "flights. Nothing here was measured on a board."
        }
    };
    figures.conclude(options.json, Some((&options.report, page(&title, body))))
}

/// The settings with one of `only`.
fn chosen(only: &[String]) -> Result<Vec<(&'static str, Ending)>, BadInput> {
    if let Some(unknown) = only
        .iter()
        .find(|name| keys().all(|key| key.name != **name))
    {
        let names: Vec<&str> = keys().map(|key| key.name).collect();
        let names = names.join(", ");
        return Err(BadInput::new(format!(
            "there is no key `{unknown}`; the keys are {names}"
        )));
    }
    let settings = settings::with(only);
    if settings.is_empty() {
        return Err(BadInput::new("no setting of the campaign has these keys"));
    }
    Ok(settings)
}

/// The flights of every setting, one after the other for each servo.
fn fly(
    image: &Image,
    settings: &[(&'static str, Ending)],
    options: &HardwareCampaign,
) -> Result<Vec<Result<Flown, String>>> {
    let (servos, starts) = if options.quick {
        (&[ServoKind::S3003][..], &[QUICK_START_RAD][..])
    } else {
        (&[ServoKind::S3003, ServoKind::Digital][..], &STARTS_RAD[..])
    };
    let setups: Vec<Setup> = settings
        .iter()
        .flat_map(|(setting, _)| servos.iter().map(move |servo| (setting, *servo)))
        .map(|(setting, servo)| {
            let mut setup = Setup::with_polarity(servo, options.seed);
            setup.rig.hardware = setting.parse::<Hardware>().map_err(BadInput::new)?;
            Ok(setup)
        })
        .collect::<Result<_, BadInput>>()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.jobs.map_or(0, usize::from))
        .build()?;
    let bar = ProgressBar::new(setups.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} boots, {eta} to go") {
        bar.set_style(style);
    }
    let flown = pool.install(|| {
        let flights = setups.par_iter().map(|setup| {
            let flown = row::fly(image, setup, starts);
            bar.inc(1);
            flown
        });
        flights.collect()
    });
    bar.finish_and_clear();
    Ok(flown)
}
