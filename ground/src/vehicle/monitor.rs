//! `tvc monitor`: the vehicle's status, live: on a terminal in lines that stay in place, elsewhere
//! a line every second.

use std::fmt::Display;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Error, Result};
use clap::Args;
use client::{Failure, ServoMap, Status, StatusTracker};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget};
use mavlink::dialects::common::MavAutopilot;
use tvc_nano::{Axis, Params};

use crate::signals;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::PortOptions;
use report::arguments::seconds;
use report::exit::{BadInput, Verdict};
use report::file::{print, print_json};
use report::gauge::gauge;
use report::kind;
use report::progress::spinner;

/// Options of `tvc monitor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc monitor                        attitude, servo, state, losses, live; Ctrl-C ends it
  tvc monitor --json | jq .state     one JSON object a line
  tvc monitor --seconds 10 --log f.tlog    and keep everything

Exit status: 0 ended, 1 the vehicle went away or something failed, 2 unusable input.")]
pub struct Monitor {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// Print JSON objects on standard output, one a line, and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Time between two lines [default: 0.1 on a terminal, else 1].
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub every: Option<f64>,

    /// End by itself after this many seconds.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,

    /// Keep every frame in a new telemetry log (.tlog, .mcap).
    #[arg(long, value_name = "FILE", value_parser = kind::new_log)]
    pub log: Option<PathBuf>,
}

/// Texts shown on a terminal.
const TEXTS: usize = 4;

/// Shows the vehicle until Ctrl-C.
///
/// # Errors
/// The log cannot be written, there is no vehicle, or it went away.
pub fn run(options: &Monitor) -> Result<Verdict> {
    let stop = signals::on_signal()?;
    let mut vehicle = Vehicle::connect(&options.port)?;
    let mut tracker = StatusTracker::new(servo_maps(&mut vehicle)?);
    if let Some(log) = &options.log {
        vehicle.keep_log(log)?;
    }
    let terminal = std::io::stdout().is_terminal() && !options.json;
    let mut screen = terminal.then(Screen::new);
    let every = options.every.unwrap_or(if terminal { 0.1 } else { 1.0 });
    let every = Duration::from_secs_f64(every);
    let begun = vehicle.now();
    let mut due = begun + every;
    while !signals::asked(stop, vehicle.now() - begun, options.seconds) {
        for frame in vehicle.receive()? {
            tracker.take(&frame.message);
        }
        if vehicle.now() < due {
            continue;
        }
        due += every;
        let status = tracker.next(vehicle.link().client());
        match &mut screen {
            Some(screen) => screen.show(&status),
            None => report(&status, options.json)?,
        }
    }
    vehicle.link().end_log()?;
    Ok(Verdict::Met)
}

/// The vehicle's maps from servo angle to pulse, by axis; those of the defaults where the vehicle
/// is of another firmware, which is said.
///
/// # Errors
/// The port went away, or the person wants an end.
pub fn servo_maps(vehicle: &mut Vehicle) -> Result<[ServoMap; Axis::COUNT]> {
    let autopilot = vehicle.link().client().autopilot();
    // Another one would not answer.
    let is_ours = autopilot == Some(MavAutopilot::MAV_AUTOPILOT_GENERIC);
    let why = match is_ours.then(|| told_maps(vehicle)) {
        Some(Ok(maps)) => return Ok(maps),
        Some(Err(error)) if !is_unknown(&error) => return Err(error),
        Some(Err(error)) => format!("{error:#}; is this tvc-nano?"),
        None => {
            let number = autopilot.map_or(0, |autopilot| autopilot as u8);
            format!("this is no tvc-nano (MAVLink's autopilot {number}).")
        }
    };
    eprintln!("{why} Servo angles are those of tvc-nano's defaults.");
    Ok([ServoMap::of(&Params::default(), Axis::Pitch); Axis::COUNT])
}

/// Whether the vehicle does not know or does not tell what it was asked for.
fn is_unknown(error: &Error) -> bool {
    let is_silent = matches!(error.downcast_ref(), Some(Failure::Silence(_)));
    is_silent || error.is::<BadInput>()
}

/// By the vehicle's parameters. An older firmware has one servo.
fn told_maps(vehicle: &mut Vehicle) -> Result<[ServoMap; Axis::COUNT]> {
    let mut value = |name| vehicle.parameter(name);
    let us_per_deg = value("SRV_US_PER_DEG")?;
    let first = ServoMap::new(value("SRV_CENTRE_US")?, us_per_deg, value("SRV_DIR")?);
    let second = match (value("SRV2_CENTRE_US"), value("SRV2_DIR")) {
        (Ok(centre_us), Ok(direction)) => ServoMap::new(centre_us, us_per_deg, direction),
        _ => first,
    };
    Ok([first, second])
}

/// Prints a status as a line.
fn report(status: &Status, json: bool) -> Result<()> {
    if json {
        return print_json(status);
    }
    for text in &status.texts {
        print(format_args!("{:10.3} s  {text}\n", status.timestamp))?;
    }
    print(lines(status).join("  ") + "\n")
}

/// From this estimate on, in those of `PITCH_GAIN`, the plant's gain is worth showing.
const QUICK: f32 = 1.2;

/// What not every vehicle tells: the second servo, how uncertain tilt and heading are, and a plant
/// that is quicker than `PITCH_GAIN` says.
fn beside(status: &Status) -> String {
    let second = status.second_servo.map(|second| {
        let angle_deg = second.servo_rad.to_degrees();
        format!("  second {angle_deg:+5.1} deg ({} us)", second.pulse_us)
    });
    let known = |what: &str, sd_deg: Option<f32>| {
        sd_deg.map_or_else(String::new, |sd_deg| format!("  {what} \u{b1} {sd_deg:.1} deg"))
    };
    let gain = status.plant_gain.filter(|gain| *gain >= QUICK);
    let gain = gain.map_or_else(String::new, |gain| format!("  gain x{gain:.2}"));
    second.unwrap_or_default()
        + &known("tilt", status.tilt_sd_deg)
        + &known("heading", status.heading_sd_deg)
        + &gain
}

/// A status for a person: time and state, attitude, link.
pub fn lines(status: &Status) -> [String; 3] {
    let [roll, pitch, yaw] = status.attitude_rad.map(f64::to_degrees);
    let rate = f64::from(status.rate_rad_s[1]).to_degrees();
    let health = &status.health;
    [
        format!("{:10.3} s  {}", status.timestamp, status.state),
        format!(
            "pitch {pitch:+6.1} deg ({rate:+7.1} deg/s)  roll {roll:+6.1}  yaw {yaw:+6.1}  servo {:+5.1} deg ({} us)",
            status.servo_rad.to_degrees(),
            status.pulse_us
        ) + &beside(status),
        format!(
            "{:5.1} attitudes/s  lost {}  damaged {}  dropped {}  missed {}  bus errors {}  load {} %{}",
            health.attitude_hz,
            health.lost,
            health.crc_errors,
            told(health.dropped),
            told(health.missed),
            told(health.bus_errors),
            told(health.load.map(|load| (100.0 * load).round())),
            match status.healthy {
                Some(true) => "",
                Some(false) => "  UNHEALTHY",
                None => "  health not told yet",
            }
        ),
    ]
}

/// A value of what the vehicle tells once a second.
fn told(value: Option<impl Display>) -> String {
    value.map_or("?".to_owned(), |value| value.to_string())
}

/// Lines that stay in place.
struct Screen {
    _all: MultiProgress,
    bars: Vec<ProgressBar>,
    texts: Vec<String>,
}

impl Screen {
    fn new() -> Self {
        let all = MultiProgress::with_draw_target(ProgressDrawTarget::stdout());
        let bars = (0..5 + TEXTS).map(|_| all.add(spinner("{wide_msg}"))).collect();
        Self { _all: all, bars, texts: Vec::new() }
    }

    fn show(&mut self, status: &Status) {
        for text in &status.texts {
            self.texts.push(format!("{:10.3} s  {text}", status.timestamp));
        }
        let old = self.texts.len().saturating_sub(TEXTS);
        self.texts.drain(..old);
        let [state, attitude, link] = lines(status);
        let [roll, pitch, _] = status.attitude_rad.map(f64::to_degrees);
        let servo = status.servo_rad.to_degrees();
        let second = status.second_servo.map_or(String::new(), |second| {
            let second = gauge(second.servo_rad.to_degrees());
            format!("  roll {}  second {second}", gauge(roll))
        });
        let shown = [
            format!("{state}: {}", status.reason),
            attitude,
            format!("pitch {}  servo {}{second}", gauge(pitch), gauge(servo)),
            link,
            "Ctrl-C ends the monitor; `tvc disarm` stops the vehicle".to_owned(),
        ];
        for (bar, line) in self.bars.iter().zip(shown.iter().chain(&self.texts)) {
            bar.set_message(line.clone());
        }
    }
}
