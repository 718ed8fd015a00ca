//! `tvc calibrate`: offsets, scales and iron out of a recording or out of a vehicle at a port, as
//! parameters of the firmware; and the set-up of its servo.

mod declination;
mod figures;
pub mod guided;
pub mod hold;
pub mod keyboard;
pub mod options;
mod outcome;
pub mod person;
pub mod polarity;
pub mod readings;
mod report;
pub mod servo;
pub mod session;
mod terminal;
pub mod write;

use anyhow::Result;
use calibration::fit;

use ::report::exit::Verdict;
use ::report::file::print_json_if;
use ::report::measure::{Figures, figure};
pub use options::{Calibrate, place};
use options::{Files, SetUp};
use outcome::Outcome;
use person::Ending;
use session::Session;

/// Calibrates as `options` say, prints the figures, writes the parameters and the report.
///
/// # Errors
/// The recording or the vehicle cannot be used, or a file cannot be written.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    match (&options.step, &options.from) {
        (Some(SetUp::Servo(given)), _) => {
            servo::check(given)?;
            lead(options, |session| servo::set_up(session, given))
        }
        (Some(SetUp::Polarity), _) => lead(options, polarity::check),
        (Some(SetUp::Hold { seconds }), _) => {
            lead(options, |session| hold::measure(session, *seconds))
        }
        (None, None) => guided::run(options),
        (None, Some(log)) => {
            let declination_deg = declination::asked_deg(options)?;
            let files = Files::of(options)?;
            let readings = readings::read(log)?;
            let found = fit::fit(&readings, &options.wanted());
            let outcome = Outcome::of(log, &readings, &found, declination_deg)?;
            let met = outcome.refused.is_empty();
            let written = outcome.write(&files, &mut |words| eprintln!("{words}"));
            let figures = outcome.figures.and(figure("written", false));
            figures.conclude(options.vehicle.json, None)?;
            written?;
            Ok(Verdict::of(met))
        }
    }
}

/// Leads through a step at the vehicle, and says on standard error how it ended.
fn lead(
    options: &Calibrate,
    step: impl FnOnce(&mut Session) -> Result<(Figures, Ending)>,
) -> Result<Verdict> {
    let mut session = Session::connect(options)?;
    let (figures, ending) = step(&mut session)?;
    print_json_if(options.vehicle.json, &figures)?;
    eprintln!("{}{}", if ending.refused { "refused: " } else { "" }, ending.words);
    if ending.met && !session.is_polarity_checked()? {
        eprintln!("next: tvc calibrate polarity, without which nothing is armed");
    }
    Ok(Verdict::of(ending.met))
}
