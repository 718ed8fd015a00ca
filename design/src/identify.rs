//! `tvc identify`: thrust, inertia, servo speed and delay from a recorded run.

use std::fmt::Write;
use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use csv::StringRecord;
use plant::identify::{Identification, IdentifyError, Reading, Record, identify};
use recordings::Lines;
use rig::ServoKind;
use tvc_nano::Axis;

use crate::control_law;
use flights::arguments::AxisName;
use flights::log::{Flight, Release};
use report::exit::{BadInput, Verdict};
use report::file::write_whole;
use report::kind;
use report::measure::{Figures, data, figure, rows};

/// Options of `tvc identify`.
#[derive(Debug, Args)]
#[command(after_help = "\
The log is of the free drone's motion from the release on, a release or a chirp: a telemetry log
(.tlog, .mcap), of which one release is taken, or a table with a head:

  time_s,pitch_rad,rate_rad_s,pulse_us   a pulse by its rising edge; cells may be empty, so that
                                         readings and pulses can have rows of their own
  the columns of `tvc record --csv`      steps of the vehicle: time_us, q_w to q_z,
                                         pitch_rate_rad_s, pulse_us; those in the state active

Standard deviations are of the record's noise, not of what the model leaves out. One that is as
large as before the record was seen says that the record does not show the quantity.

Examples:
  tvc identify step.tlog                         estimates with their uncertainty
  tvc identify evening.tlog --release 3          of the third release of a log
  tvc identify both.tlog --axis roll             of the roll axis of a vehicle with two
  tvc identify release.csv --out drone.toml      and as a parameter file
  tvc tune --drone drone.toml                    gains for that drone

Exit status: 0 done, 1 no parameters explain the record, 2 unusable input.")]
pub struct Identify {
    /// The recorded run (.tlog, .mcap, .csv).
    #[arg(value_name = "LOG")]
    pub log: PathBuf,

    /// The release of a telemetry log, counted from 1 [default: the only one].
    #[arg(long, value_name = "N")]
    pub release: Option<usize>,

    /// The axis of a telemetry log; roll needs a vehicle with two.
    #[arg(long, value_enum, default_value_t)]
    pub axis: AxisName,

    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoKind::S3003)]
    pub servo: ServoKind,

    /// Nominal drone, servo and timing where they differ from the servo's preset
    /// (docs/explanation/model.md).
    #[arg(long, value_name = "FILE.toml")]
    pub drone: Option<PathBuf>,

    /// Where to write the estimates, as a parameter file.
    #[arg(long, value_name = "FILE.toml", value_parser = kind::toml)]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Identifies as `options` say, prints the estimates and writes them.
pub fn run(options: &Identify) -> Result<Verdict> {
    if let Some(out) = &options.out {
        kind::keep_apart(out, options.drone.as_deref())?;
    }
    let record = read(&options.log, options.release, options.axis.into())?;
    let nominal = control_law::setup(options.servo, options.drone.as_deref())?;
    let found = identify(&nominal, &record).map_err(|error| match error {
        IdentifyError::NoFit => anyhow::Error::new(error),
        _ => BadInput::of(&options.log, error).into(),
    })?;
    figures(&found).conclude(options.json, None)?;
    if let Some(out) = &options.out {
        write_whole(out, parameter_file(&found, &options.log).as_bytes())?;
        eprintln!("parameters: {}", out.display());
    }
    Ok(Verdict::Met)
}

/// Columns of a table that a record is made of.
enum Columns {
    /// Time, pitch, rate, pulse: in s, rad, rad/s, us.
    Plain([usize; 4]),
    /// Time, quaternion, rate, pulse, state: a vehicle's steps.
    Steps([usize; 8]),
}

impl Columns {
    fn of(head: &StringRecord) -> Result<Self, String> {
        let place = |name: &str| head.iter().position(|column| column.trim() == name);
        let all = |names: &[&'static str]| -> Result<Vec<usize>, &'static str> {
            names.iter().map(|name| place(name).ok_or(*name)).collect()
        };
        let plain = all(&["time_s", "pitch_rad", "rate_rad_s", "pulse_us"]);
        let steps =
            all(&["time_us", "q_w", "q_x", "q_y", "q_z", "pitch_rate_rad_s", "pulse_us", "state"]);
        match (plain, steps) {
            (Ok(p), _) => Ok(Self::Plain([p[0], p[1], p[2], p[3]])),
            (_, Ok(s)) => Ok(Self::Steps([s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]])),
            (Err(missing), _) => Err(format!(
                "no column {missing}: a log has time_s, pitch_rad, rate_rad_s, pulse_us, or what `tvc record` writes"
            )),
        }
    }
}

/// Reads a record, the one of a release in a telemetry log.
///
/// # Errors
/// [`BadInput`] naming the file and what is wrong with it.
pub fn read(path: &Path, release: Option<usize>, axis: Axis) -> Result<Record> {
    if kind::is_log(path) {
        let flight = Flight::read(path)?;
        let release = flight.release(release).map_err(|error| BadInput::of(path, error))?;
        if !release.axes().contains(&axis) {
            let why = "the vehicle had one axis in it (AXES 1), which is pitch";
            return Err(BadInput::of(path, why).into());
        }
        return Ok(of_release(&release, axis));
    }
    if axis == Axis::Roll {
        return Err(BadInput::of(path, "a table has pitch only").into());
    }
    if release.is_some() {
        return Err(BadInput::of(path, "a table has no numbers of releases").into());
    }
    let file = File::open(path).map_err(|error| BadInput::of(path, error))?;
    let mut reader = csv::Reader::from_reader(Lines::new(file));
    let head = reader.headers().map_err(|error| BadInput::of(path, error))?;
    let columns = Columns::of(head).map_err(|error| BadInput::of(path, error))?;
    let mut record = Record::default();
    for (index, row) in reader.records().enumerate() {
        let row = row.map_err(|error| BadInput::of(path, error))?;
        take(&columns, &row, &mut record)
            .map_err(|error| BadInput::of(path, format!("row {}: {error}", index + 2)))?;
    }
    Ok(record)
}

/// The motion of an axis from a release on. The pulses are those of the first servo: for roll, what
/// they would be there.
fn of_release(release: &Release<'_>, axis: Axis) -> Record {
    let [first, own] = [Axis::Pitch, axis].map(|axis| release.params.fitting(axis));
    let turned = f64::from(first.direction * own.direction);
    let as_first = |pulse_us: u16| {
        f64::from(first.centre_us) + turned * (f64::from(pulse_us) - f64::from(own.centre_us))
    };
    let steps = release.steps.iter().zip(release.motion(axis));
    let mut record = Record::default();
    for (step, (_, pitch_rad)) in steps {
        let time_s = step.time_s();
        let (rate_rad_s, pulse_us) = match axis {
            Axis::Pitch => (step.rate_rad_s[1], step.pulses_us[0].into()),
            Axis::Roll => (step.rate_rad_s[0], as_first(step.pulses_us[1])),
        };
        record.readings.push(Reading { time_s, pitch_rad, rate_rad_s: rate_rad_s.into() });
        record.pulses.push((time_s, pulse_us));
    }
    record
}

/// Adds a row to the record. Empty cells are left out.
fn take(columns: &Columns, row: &StringRecord, record: &mut Record) -> Result<(), String> {
    let cell = |place: usize| row.get(place).unwrap_or_default().trim();
    let number = |place: usize| -> Result<Option<f64>, String> {
        match cell(place) {
            "" => Ok(None),
            text => text.parse().map(Some).map_err(|_| format!("{text} is no number")),
        }
    };
    let (time_s, pitch_rad, rate_rad_s, pulse_us) = match columns {
        Columns::Plain(p) => (number(p[0])?, number(p[1])?, number(p[2])?, number(p[3])?),
        Columns::Steps([time, w, x, y, z, rate, pulse, state]) => {
            if cell(*state) != "active" {
                return Ok(());
            }
            let q = [number(*w)?, number(*x)?, number(*y)?, number(*z)?];
            let pitch = match q {
                [Some(w), Some(x), Some(y), Some(z)] => {
                    Some((2.0 * (w * y - x * z)).clamp(-1.0, 1.0).asin())
                }
                _ => None,
            };
            let time_s = number(*time)?.map(|us| 1e-6 * us);
            (time_s, pitch, number(*rate)?, number(*pulse)?)
        }
    };
    let time_s = time_s.ok_or("no time")?;
    if let (Some(pitch_rad), Some(rate_rad_s)) = (pitch_rad, rate_rad_s) {
        record.readings.push(Reading { time_s, pitch_rad, rate_rad_s });
    }
    if let Some(width_us) = pulse_us {
        record.pulses.push((time_s, width_us));
    }
    Ok(())
}

/// The whole setup as a parameter file, with the estimates and their deviations as comments.
fn parameter_file(found: &Identification, log: &Path) -> String {
    let mut text = format!("# Identified from {}.\n", log.display());
    for estimate in found.estimates.iter().chain([&found.pitch_gain]) {
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "# {:<20} {:.6} +- {:.6} (nominal {:.6})",
            estimate.name, estimate.value, estimate.deviation, estimate.nominal
        );
    }
    text + "\n" + &found.setup.to_toml()
}

/// The estimates as the terminal shows them.
fn figures(found: &Identification) -> Figures {
    let estimates = found.estimates.iter().chain([&found.pitch_gain]);
    let number = |value: f64, label| figure("", value).shown(label, "", 6);
    Figures::from([
        rows(
            "",
            estimates.map(|estimate| {
                [
                    figure("", estimate.name).shown("parameter", "", 0),
                    number(estimate.nominal, "nominal"),
                    number(estimate.value, "found"),
                    number(estimate.deviation, "deviation"),
                    number(estimate.prior, "before"),
                ]
            }),
        ),
        data("setup", &found.setup),
        data("estimates", &found.estimates),
        data("pitch_gain", &found.pitch_gain),
        figure("pitch_rms_rad", found.pitch_rms_rad)
            .shown("misfit of pitch, rms", "mrad", 2)
            .scaled(1e3),
        figure("rate_rms_rad_s", found.rate_rms_rad_s)
            .shown("misfit of the rate, rms", "mrad/s", 1)
            .scaled(1e3),
        figure("iterations", found.iterations).shown("steps of the search", "", 0),
    ])
}
