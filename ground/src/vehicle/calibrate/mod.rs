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
mod picture;
pub mod polarity;
pub mod readings;
mod report;
pub mod servo;
pub mod session;
mod terminal;
pub mod write;

use anyhow::Result;
use calibration::fit;

use crate::out::exit::Verdict;
use crate::out::file::print_figures;
use figures::Figures;
use options::SetUp;
pub use options::{Calibrate, place};
use outcome::Outcome;

/// Calibrates as `options` say, prints the figures, writes the parameters and the report.
///
/// # Errors
/// The recording or the vehicle cannot be used, or a file cannot be written.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    match (&options.step, &options.from) {
        (Some(SetUp::Servo(servo)), _) => servo::run(servo, options),
        (Some(SetUp::Polarity), _) => polarity::run(options),
        (Some(SetUp::Hold { seconds }), _) => hold::run(*seconds, options),
        (None, None) => guided::run(options),
        (None, Some(log)) => {
            let declination_deg = declination::asked_deg(options)?;
            let readings = readings::read(log)?;
            let found = fit::fit(&readings, &options.wanted());
            let outcome = Outcome::report(log, &readings, &found, declination_deg, options)?;
            outcome.tell(options, &mut |words| eprintln!("{words}"));
            print_figures(&outcome.figures, options.port.json, Figures::text)?;
            if outcome.is_refused() {
                return Ok(Verdict::Missed);
            }
            outcome.write_parameters(options)?;
            eprintln!("parameters: {}", options.out.display());
            Ok(Verdict::Met)
        }
    }
}
