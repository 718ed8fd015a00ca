//! `tvc identify`: thrust, inertia, servo speed and delay from a recorded run.

mod clock;

use std::collections::{HashMap, HashSet};
use std::fmt::Write;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Result;
use clap::Args;
use csv::StringRecord;
use plant::Setup;
use plant::identify::{
    Identification, IdentifyError, MOST_MISFIT_RAD, Reading, Record, identify, likeliest,
};
use recordings::Lines;
use rig::ServoKind;
use tvc_imu::{RawSample, Refresh, Sample};
use tvc_nano::Axis;
use tvc_nano::ticks::TickPlan;

use self::clock::Clock;
use crate::vehicle::{Vehicle, VehicleChoice};
use flights::arguments::AxisName;
use flights::log::{Flight, Release};
use report::exit::{BadInput, Verdict};
use report::file::write_whole;
use report::kind;
use report::measure::{Figures, data, figure, rows, some};
use report::progress;

/// Less than the period of any sensor's refresh, s.
const LEAST_PERIOD_S: f64 = 1e-4;

/// Options of `tvc identify`.
#[derive(Debug, Args)]
#[command(after_help = "\
The log is of the free drone's motion from the release on, a release or a chirp: a telemetry log
(.tlog, .mcap), of which one release is taken, or a table with a head:

  time_s,pitch_rad,rate_rad_s,pulse_us   a pulse by its rising edge; cells may be empty, so that
                                         readings and pulses can have rows of their own
  the columns of `tvc record --csv`      steps of the vehicle: time_us, q_w to q_z,
                                         pitch_rate_rad_s, pulse_us; those in the state active

Several logs are of one vehicle: together they tell more. A pulse of a telemetry log counts from its
own rising edge, which follows from the log's parameters; a reading from the sensor's refresh.

Standard deviations follow from what the model leaves of the record. One that is as large as before
the record was seen says that the record does not show the quantity. Thrust and inertia are seldom
told apart, their quotient, the pitch gain, is. A misfit of pitch above 5 mrad rms is no right
model's: the estimates are printed and written, and the command ends with status 1.

Examples:
  tvc identify step.tlog                         estimates with their uncertainty
  tvc identify evening.tlog --release 3          of the third release of a log
  tvc identify both.tlog --axis roll             of the roll axis of a vehicle with two
  tvc identify a.tlog b.tlog --out drone.toml    of two releases, and as a vehicle's file
  tvc tune --vehicle drone.toml                  gains for that drone

Exit status: 0 done, 1 no parameters explain the records, 2 unusable input.")]
pub struct Identify {
    /// Recorded runs of one vehicle (.tlog, .mcap, .csv).
    #[arg(value_name = "LOG", required = true)]
    pub logs: Vec<PathBuf>,

    /// The release of each telemetry log, counted from 1 [default: the only one].
    #[arg(long, value_name = "N")]
    pub release: Option<usize>,

    /// The axis of a telemetry log; roll needs a vehicle with two.
    #[arg(long, value_enum, default_value_t)]
    pub axis: AxisName,

    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoKind::S3003)]
    pub servo: ServoKind,

    /// The nominal drone: drone, or a FILE.toml (docs/guides/vehicles.md).
    #[arg(long, default_value = "drone")]
    pub vehicle: VehicleChoice,

    /// Where to write the drone with the estimates, as a vehicle's file.
    #[arg(long, value_name = "FILE.toml", value_parser = kind::toml)]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Identifies as `options` say, prints the estimates and writes them.
pub fn run(options: &Identify) -> Result<Verdict> {
    if let Some(out) = &options.out {
        let read = options.logs.iter().map(AsRef::as_ref);
        kind::keep_apart(out, read.chain(options.vehicle.file()))?;
    }
    let vehicle = options.vehicle.read(options.servo)?;
    let nominal = vehicle.drone()?;
    let spinner = progress::spinner("{spinner} {msg}");
    spinner.enable_steady_tick(Duration::from_millis(200));
    spinner.set_message("searching for the parameters");
    let found = search(options, &nominal);
    spinner.finish_and_clear();
    let found = found?;
    figures(&found).conclude(options.json, None)?;
    if let Some(out) = &options.out {
        let vehicle = Vehicle { setup: found.setup, ..vehicle };
        write_whole(out, vehicle_file(&vehicle, &found, &options.logs).as_bytes())?;
        eprintln!("parameters: {}", out.display());
    }
    if !found.explains() {
        eprintln!(
            "missed: the model is off by {:.1} mrad rms, and a right one by {:.0} at most: see --vehicle and --servo",
            1e3 * found.pitch_rms_rad,
            1e3 * MOST_MISFIT_RAD
        );
        return Ok(Verdict::Missed);
    }
    Ok(Verdict::Met)
}

/// Finds the parameters of the vehicle that the logs are of.
fn search(options: &Identify, nominal: &Setup) -> Result<Identification> {
    let refuse = |log: &Path, error| match error {
        IdentifyError::NoFit => anyhow::Error::new(error),
        _ => BadInput::of(log, error).into(),
    };
    let mut records = Vec::new();
    for log in &options.logs {
        let ways = read(log, options.release, options.axis.into())?;
        records.push(likeliest(nominal, ways).map_err(|error| refuse(log, error))?);
    }
    identify(nominal, &records).map_err(|error| refuse(&options.logs[0], error))
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

/// Reads a run, the one of a release in a telemetry log: records of it, one of which is right.
///
/// # Errors
/// [`BadInput`] naming the file and what is wrong with it.
pub fn read(path: &Path, release: Option<usize>, axis: Axis) -> Result<Vec<Record>> {
    if kind::is_log(path) {
        let flight = Flight::read(path)?;
        let release = flight.release(release).map_err(|error| BadInput::of(path, error))?;
        if !release.axes().contains(&axis) {
            let why = "the vehicle had one axis in it (AXES 1), which is pitch";
            return Err(BadInput::of(path, why).into());
        }
        return Ok(of_release(&flight, &release, axis));
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
    let is_summed = matches!(columns, Columns::Steps(_));
    let mut record = Record { is_summed, ..Record::default() };
    // Not the number of the record: blank lines are none.
    let line = |row: &StringRecord| row.position().map_or(0, |at| at.line());
    for row in reader.records() {
        let row = row.map_err(|error| BadInput::of(path, error))?;
        take(&columns, &row, &mut record)
            .map_err(|error| BadInput::of(path, format!("row {}: {error}", line(&row))))?;
    }
    Ok(vec![record])
}

/// The motion of an axis from a release on, once for each tick of a frame that may be the one whose
/// step the pulse carries. The pulses are those of the first servo: for roll, what they would be
/// there. A reading has the time at which the sensor refreshed its rates.
fn of_release(flight: &Flight, release: &Release<'_>, axis: Axis) -> Vec<Record> {
    let timing = release.params.timing();
    let samples = flight.steps().filter_map(|step| step.sample);
    let times_us = release.steps.iter().filter_map(|step| Some(step.sample?.time.0));
    let refreshed_us = refreshes_us(release.params.refresh(), samples, &times_us.collect());
    let read_us = f64::from(timing.second_rate_us());

    let [first, own] = [Axis::Pitch, axis].map(|axis| release.params.fitting(axis));
    let turned = f64::from(first.direction * own.direction);
    let as_first = |pulse_us: u16| {
        f64::from(first.centre_us) + turned * (f64::from(pulse_us) - f64::from(own.centre_us))
    };
    let plan = TickPlan::new(&timing);
    let tick_us = u64::from(plan.period_us(timing.frame_hz).max(1));
    let lead_us = u64::from(timing.sample_lead_us());
    let mut readings = Vec::new();
    let mut pulses = Vec::new();
    for (step, (_, pitch_rad)) in release.steps.iter().zip(release.motion(axis)) {
        let (rate_rad_s, pulse_us) = match axis {
            Axis::Pitch => (step.rate_rad_s[1], step.pulses_us[0].into()),
            Axis::Roll => (step.rate_rad_s[0], as_first(step.pulses_us[1])),
        };
        let Some(sample) = step.sample else { continue };
        let at_us = sample.time.0;
        if let Some(refreshed_us) = refreshed_us.get(&at_us) {
            let time_s = (refreshed_us + read_us) * 1e-6;
            let rate_rad_s = rate_rad_s.into();
            // Rates that changed while they were read count as new twice.
            if readings.last().is_none_or(|last: &Reading| last.time_s + LEAST_PERIOD_S < time_s) {
                readings.push(Reading { time_s, pitch_rad, rate_rad_s });
            }
        }
        pulses.push((at_us, pulse_us));
    }
    let begin_us = pulses.first().map_or(0, |(at_us, _)| *at_us);
    let per_frame = u64::from(plan.ticks_per_frame);
    let carried = |phase: u64| {
        let tick = move |at_us: u64| (at_us.saturating_sub(begin_us) + tick_us / 2) / tick_us;
        let own = pulses.iter().filter(move |(at_us, _)| tick(*at_us) % per_frame == phase);
        own.map(|(at_us, pulse_us)| ((at_us + lead_us) as f64 * 1e-6, *pulse_us)).collect()
    };
    (0..per_frame)
        .map(|phase| Record { readings: readings.clone(), pulses: carried(phase), is_summed: true })
        .collect()
}

/// When the sensor refreshed the new rates of the samples at these times, us: by the clock that
/// explains nearly all of them, or by the rates' ages where none does.
fn refreshes_us(
    mut refresh: Refresh,
    samples: impl Iterator<Item = RawSample>,
    times_us: &HashSet<u64>,
) -> HashMap<u64, f64> {
    let mut ages_us = HashMap::new();
    let mut seen = Vec::new();
    let (mut before_us, mut about_us) = (None, 0.0);
    for raw in samples {
        let now_us = raw.time.0;
        let Sample { rates, refresh_us, .. } = refresh.read(raw);
        if let (Some(rates), true) = (rates, times_us.contains(&now_us)) {
            ages_us.insert(now_us, now_us as f64 - f64::from(rates.age_us));
            seen.extend(before_us.map(|before_us| (before_us, now_us)));
        }
        (before_us, about_us) = (Some(now_us), f64::from(refresh_us));
    }
    match Clock::of(&seen, about_us) {
        Some(clock) => ages_us.into_keys().map(|at_us| (at_us, clock.before(at_us))).collect(),
        None => ages_us,
    }
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

/// The whole vehicle as a file, with the estimates and their deviations as comments.
fn vehicle_file(vehicle: &Vehicle, found: &Identification, logs: &[PathBuf]) -> String {
    let logs: Vec<_> = logs.iter().map(|log| log.display().to_string()).collect();
    let mut text = format!("# Identified from {}.\n", logs.join(", "));
    for estimate in found.estimates.iter().chain([&found.pitch_gain]) {
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "# {:<20} {:.6} +- {:.6} (nominal {:.6})",
            estimate.name, estimate.value, estimate.deviation, estimate.nominal
        );
    }
    text + "\n" + &vehicle.to_toml()
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
        data("not_told_apart", &found.alike)
            .said("not told apart", some(found.alike.iter().map(|pair| pair.join(" and ")))),
        figure("iterations", found.iterations).shown("steps of the search", "", 0),
    ])
}
