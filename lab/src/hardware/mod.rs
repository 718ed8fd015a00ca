//! `lab hardware`: flights with chips, sensors and computers that differ from the default.

mod row;
mod settings;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use maud::html;
use rig::bench::Hardware;
use rig::bench::hardware::keys;
use rig::{Image, ServoKind, Setup};
use row::{Ending, Flown};

use ground::flight::fly::flights::STARTS_RAD;
use ground::image::ImageOption;
use report::campaign::{CampaignOptions, carry_out};
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

Each row is an argument of `tvc fly --hardware`. With it the image boots and flies from 0.2, 0.4 and
0.8 rad, with an analog and with a digital servo. A row has the worst of its flights, which must meet
what `tvc fly` requires. `burst` and `longest` are what the image reports of its sensor's transfers.

Three misses are expected. A sensor that holds the bus longer than some 280 us in each byte cannot be
flown within 8 ms of latency with both servos. Above some 365 us the image refuses to arm. Where
SysTick stops in sleep, the image has no time: it latches a fault and keeps the servos at neutral.

Exit status: 0 every row ended as expected, 1 one did not or something failed, 2 unusable input.")]
pub struct HardwareCampaign {
    /// Only settings with one of these keys [default: all].
    #[arg(long, value_name = "KEY", num_args = 1..)]
    pub only: Vec<String>,

    /// One flight a setting, from 0.4 rad with the analog servo.
    #[arg(long)]
    pub quick: bool,

    /// How flights are carried out.
    #[command(flatten)]
    pub campaign: CampaignOptions,

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
        figure("seed", options.campaign.seed).shown("seed", "", 0),
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
    if let Some(unknown) = only.iter().find(|name| keys().all(|key| key.name != **name)) {
        let names: Vec<&str> = keys().map(|key| key.name).collect();
        let names = names.join(", ");
        return Err(BadInput::new(format!("there is no key `{unknown}`; the keys are {names}")));
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
    let mut setups = Vec::new();
    for (setting, _) in settings {
        for servo in servos {
            let mut setup = Setup::with_polarity(*servo, options.campaign.seed);
            setup.rig.hardware = setting.parse::<Hardware>().map_err(BadInput::new)?;
            setups.push(setup);
        }
    }
    carry_out("boots", &setups, options.campaign.jobs, |setup| Ok(row::fly(image, setup, starts)))
}
