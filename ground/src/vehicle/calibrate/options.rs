//! Options of `tvc calibrate`.

use crate::vehicle::port::VehicleOptions;
use anyhow::Result;
use calibration::{STANDARD_GRAVITY, Sensor, Wanted};
use clap::{Args, Subcommand};
use report::arguments::{number, numbers, seconds};
use report::kind::{self, Kind};
use std::path::{Path, PathBuf};
use tvc_nano::Axis;
use world_magnetic_model::time::{Date, Month};

/// Options of `tvc calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Without --from it leads through the procedure at a vehicle. Lay the sensor down and leave it alone for
ten seconds. Rest it on all six faces, two seconds each. Turn it slowly through all directions, away
from iron. Stand the body level. Then it shows what it has found and, if you agree, writes it to the
vehicle and into its flash, and reads it back. It is kept as a recording, which gives the same again.

Examples:
  tvc calibrate --place 55.79,12.52                      the only Nano, guided
  tvc calibrate --port ./nano --yes                      a given port, without a question
  tvc calibrate --only mag,level                         some of the steps
  tvc calibrate --from walk.tlog                         out of a recording
  tvc calibrate --from log.csv --place 55.79,12.52       declination from the world magnetic model
  tvc calibrate --from log.csv --only gyr,acc --level 5  mount from the rest at 5 s, body level
  tvc param load report/calibration.parm                 and onto the vehicle
  tvc calibrate servo                                    then centre, angle, direction, ends
  tvc calibrate servo --second                           the same of the second servo
  tvc calibrate polarity                                 then see the rudder answer a tilt
  tvc calibrate hold                                     then, on the tether, the lateral offset
  tvc rig --pty --link ./nano --blank --sensor-errors worst     a virtual rig to try it at

Exit status: 0 calibrated, 1 the data do not allow it (standard error says why) or it was declined,
2 unusable input.")]
#[command(args_conflicts_with_subcommands = true)]
pub struct Calibrate {
    /// What else is set up.
    #[command(subcommand)]
    pub step: Option<SetUp>,

    /// The recording: a telemetry log (.tlog, .mcap), a CSV file with counts (acc_x ... mag_z) or
    /// in SI units (gx_rad_s, ax_m_s2, mx_ut ...), or IMUQ16v1.
    #[arg(long, value_name = "LOG", conflicts_with_all = ["port", "yes", "record"])]
    pub from: Option<PathBuf>,

    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,

    /// Yes to every question: write what was found to the vehicle.
    #[arg(long, global = true)]
    pub yes: bool,

    /// Where to keep the recording of a guided calibration [default: report/calibration.tlog].
    #[arg(long, value_name = "FILE.tlog", value_parser = kind::log)]
    pub record: Option<PathBuf>,

    /// Only these steps [default: all].
    #[arg(long, value_enum, value_delimiter = ',', value_name = "SENSOR")]
    pub only: Vec<Sensor>,

    /// At this time of the recording, in s from its start, the body was at rest and level: gives
    /// the mount's roll and pitch.
    #[arg(long, value_name = "S", requires = "from")]
    pub level: Option<f64>,

    /// Magnetic declination, in deg, east positive.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, conflicts_with = "place", value_parser = declination)]
    pub declination: Option<f64>,

    /// Latitude and longitude, in deg, north and east positive: declination by the world magnetic
    /// model.
    #[arg(long, value_name = "LAT,LON", allow_negative_numbers = true, value_parser = place)]
    pub place: Option<Place>,

    /// The day for --place [default: today].
    #[arg(long, value_name = "YYYY-MM-DD", requires = "place", value_parser = day)]
    pub date: Option<Date>,

    /// Gravity where it was recorded, m/s^2.
    #[arg(long, value_name = "M_S2", default_value_t = STANDARD_GRAVITY, value_parser = gravity)]
    pub gravity: f64,

    /// Where to write the firmware's parameters [default: report/calibration.parm].
    #[arg(long, value_name = "FILE.parm", value_parser = kind::parameters)]
    pub out: Option<PathBuf>,

    /// Where to write the HTML report [default: report/calibrate.html].
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,
}

/// The files that a calibration of the sensors writes.
#[derive(Debug)]
pub struct Files {
    /// The recording, if the calibration makes one.
    pub record: PathBuf,
    /// The firmware's parameters.
    pub out: PathBuf,
    /// The page.
    pub report: PathBuf,
}

impl Files {
    /// As the options name them.
    ///
    /// # Errors
    /// A place takes no such file.
    pub fn of(options: &Calibrate) -> Result<Self> {
        let place = |given: &Option<PathBuf>, usual: &str, kind| {
            kind::given_or(given.as_deref(), Path::new("report").join(usual), kind)
        };
        Ok(Self {
            record: place(&options.record, "calibration.tlog", Kind::Log)?,
            out: place(&options.out, "calibration.parm", Kind::Parameters)?,
            report: place(&options.report, "calibrate.html", Kind::Page)?,
        })
    }

    /// Beside a recording.
    pub fn beside(record: &Path) -> Self {
        Self {
            record: record.to_owned(),
            out: record.with_extension("parm"),
            report: record.with_extension("html"),
        }
    }
}

/// What is set up besides the sensors.
#[derive(Debug, Subcommand)]
pub enum SetUp {
    /// The servo: centre, us per degree, direction, travel ends, each given here or found with the
    /// servo in sight. Turn thrust off.
    Servo(Servo),
    /// Tilt the vehicle by hand and see the rudder answer the right way, without which nothing is
    /// armed. Turn thrust off.
    Polarity,
    /// Fly upright for a while and take the servo angle that holds the drone against a lateral
    /// offset of its mass, so that the rudder rests there before the next release. Thrust on, on
    /// the tether. As `tvc test`, it ends with the vehicle disarmed, and FS_HOST is 1 meanwhile.
    Hold {
        /// How long it is measured, after three seconds of settling.
        #[arg(long, value_name = "S", default_value_t = 8.0, value_parser = seconds)]
        seconds: f64,
    },
}

/// Options of `tvc calibrate servo`. What is not given is asked for, or stays with --yes.
#[derive(Debug, Default, Args)]
pub struct Servo {
    /// The second servo, on D2, which steers roll where AXES is 2. Its angle is that of the first.
    #[arg(long)]
    pub second: bool,

    /// Pulse at which the rudder has no effect, us.
    #[arg(long, value_name = "US")]
    pub centre: Option<f32>,

    /// Change of the pulse for a degree of the servo's horn, us.
    #[arg(long, value_name = "US")]
    pub us_per_deg: Option<f32>,

    /// 1 where a longer pulse pushes the nose down (the second servo: the right side up), -1 where
    /// it does the opposite.
    #[arg(long, value_name = "SIGN", allow_negative_numbers = true)]
    pub direction: Option<f32>,

    /// Shortest pulse at which nothing touches, us.
    #[arg(long, value_name = "US")]
    pub min: Option<f32>,

    /// Longest pulse at which nothing touches, us.
    #[arg(long, value_name = "US")]
    pub max: Option<f32>,
}

impl Servo {
    /// The axis whose servo is set up.
    pub fn axis(&self) -> Axis {
        if self.second { Axis::Roll } else { Axis::Pitch }
    }
}

impl Calibrate {
    /// What the fits are asked for.
    pub fn wanted(&self) -> Wanted {
        Wanted { only: self.only.clone(), gravity: self.gravity, level_s: self.level }
    }
}

/// A place on earth, deg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// North positive.
    pub latitude_deg: f32,
    /// East positive.
    pub longitude_deg: f32,
}

fn declination(text: &str) -> Result<f64, String> {
    const WHAT: &str = "a declination is a number of degrees from -180 to 180, such as 4.37";
    number(text, -180.0..=180.0, WHAT)
}

fn gravity(text: &str) -> Result<f64, String> {
    number(text, 9.7..=9.9, "gravity on earth is 9.7 to 9.9 m/s^2")
}

/// Latitude and longitude, deg.
pub fn place(text: &str) -> Result<Place, String> {
    const WHAT: &str = "a place is latitude and longitude in degrees, such as 55.79,12.52";
    let (latitude, longitude) = numbers(text, [-90.0..=90.0, -180.0..=180.0], WHAT)?;
    Ok(Place { latitude_deg: latitude as f32, longitude_deg: longitude as f32 })
}

fn day(text: &str) -> Result<Date, String> {
    let parse = || match text.split('-').collect::<Vec<_>>().as_slice() {
        [year, month, day] => {
            let month = Month::try_from(month.parse::<u8>().ok()?).ok()?;
            Date::from_calendar_date(year.parse().ok()?, month, day.parse().ok()?).ok()
        }
        _ => None,
    };
    parse().ok_or_else(|| "a date is year, month and day, such as 2026-05-31".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_dates() {
        let place = place("55.79, 12.52").unwrap();
        assert_eq!((place.latitude_deg, place.longitude_deg), (55.79, 12.52));
        for bad in ["55.79", "91,0", "0,181", "a,b", "NaN,0"] {
            assert!(super::place(bad).is_err(), "{bad}");
        }
        let date = day("2026-05-31").unwrap();
        assert_eq!(date.to_calendar_date(), (2026, Month::May, 31));
        for bad in ["2026", "2026-05", "May 31", "2026-5-31-1", "2026-02-30"] {
            assert!(day(bad).is_err(), "{bad}");
        }
        assert!(gravity("1").is_err() && declination("NaN").is_err());
    }
}
