//! `tvc test`: the vehicle armed, released, watched and disarmed, and what came of it.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, bail};
use clap::{Args, Subcommand};
use client::{Failure, FlightState, request};
use indicatif::{ProgressBar, ProgressStyle};
use tvc_nano::Refusal;

use crate::logs::log::{Flight, Log, Writer};
use crate::logs::report::{conclude, sweep};
use crate::out::exit::Verdict;
use crate::signals;
use crate::vehicle::link::Vehicle;
use crate::vehicle::param::ParamPort;
use crate::vehicle::port::{PortOptions, seconds};

/// Options of `tvc test`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc test step                      arm, release, three seconds, disarm: the step response
  cargo tvc test step --log step.tlog --report step.html
  cargo tvc test hold --seconds 30         how well it stays upright
  cargo tvc test chirp                     swings the set point faster and faster: bandwidth, delay

Hold the drone still at its start for the first seconds. Ctrl-C disarms at once.
Exit status: 0 every requirement met, 1 one missed, refused or failed, 2 unusable input.")]
pub struct Test {
    /// What to do.
    #[command(subcommand)]
    pub manoeuvre: Manoeuvre,

    /// The port, and the form of the answer.
    #[command(flatten)]
    pub port: ParamPort,

    /// Keep every frame in a new telemetry log.
    #[arg(long, value_name = "FILE", global = true)]
    pub log: Option<PathBuf>,

    /// Write an HTML report.
    #[arg(long, value_name = "FILE.html", global = true)]
    pub report: Option<PathBuf>,
}

impl Test {
    /// As every other command has it.
    pub fn port(&self) -> PortOptions {
        self.port.port()
    }
}

/// What is flown.
#[derive(Debug, Clone, Copy, Subcommand)]
pub enum Manoeuvre {
    /// Release from the tilt at which it is held.
    Step {
        /// Length after the release.
        #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = seconds)]
        seconds: f64,
    },
    /// Release and hold upright.
    Hold {
        /// Length after the release.
        #[arg(long, value_name = "S", default_value_t = 15.0, value_parser = seconds)]
        seconds: f64,
    },
    /// Release and swing the set point through a range of frequencies.
    Chirp {
        /// Length of the sweep.
        #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = seconds)]
        seconds: f64,
        /// Amplitude of the set point, deg.
        #[arg(long, value_name = "DEG", default_value_t = 4.0, value_parser = amplitude)]
        amplitude: f64,
    },
}

fn amplitude(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(deg) if deg > 0.0 && deg <= 15.0 => Ok(deg),
        _ => Err("an amplitude is above 0 and at most 15 deg".into()),
    }
}

/// How long the vehicle may take until it lets itself be armed: self-test, and the gyro's offset at rest.
pub const ARM_PATIENCE: Duration = Duration::from_secs(20);
/// Between two attempts.
pub const ARM_RETRY: Duration = Duration::from_millis(500);
/// Armed before the release, so that the vehicle's own memory holds what was before it.
const ARMED: Duration = Duration::from_millis(250);
/// Upright before the set point begins to swing.
const SETTLE: Duration = Duration::from_secs(3);
/// Between two set points.
const SET_PERIOD: Duration = Duration::from_millis(20);

/// Flies the manoeuvre that `options` ask for.
pub fn run(options: &Test) -> Result<Verdict> {
    let stop = signals::on_signal()?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let log: PathBuf = match &options.log {
        Some(path) => path.clone(),
        None => folder.path().join("test.tlog"),
    };
    let writer = Writer::create(&log)?;
    let mut vehicle = Vehicle::connect(&options.port())?;
    vehicle.link().log_to(writer);
    vehicle.parameters()?;
    if vehicle.state().is_in_operation() {
        bail!("the vehicle is not in standby: `tvc disarm` first");
    }
    vehicle.command(request::CALIBRATE)?;
    let flown = fly(&mut vehicle, options.manoeuvre, stop);
    // Whatever happened: the rudder to neutral.
    let disarmed = vehicle.command(request::DISARM);
    vehicle.link().end_log()?;
    flown?;
    disarmed?;
    let flight = Flight::of(&Log::read(&log)?);
    if let Some(path) = &options.log {
        eprintln!("wrote {}", path.display());
    }
    conclude(&flight, &log, options.report.as_deref(), options.port.json)
}

fn fly(vehicle: &mut Vehicle, manoeuvre: Manoeuvre, stop: &AtomicBool) -> Result<()> {
    arm(vehicle, stop)?;
    let release = Instant::now() + ARMED;
    while Instant::now() < release {
        vehicle.receive()?;
    }
    vehicle.command(request::RELEASE)?;
    match manoeuvre {
        Manoeuvre::Step { seconds } | Manoeuvre::Hold { seconds } => watch(
            vehicle,
            Duration::from_secs_f64(seconds),
            stop,
            &mut |_, _| Ok(()),
        ),
        Manoeuvre::Chirp { seconds, amplitude } => {
            let before = vehicle.parameter("PITCH_SET_DEG")?;
            watch(vehicle, SETTLE, stop, &mut |_, _| Ok(()))?;
            let mut due = Duration::ZERO;
            let swung = watch(
                vehicle,
                Duration::from_secs_f64(seconds),
                stop,
                &mut |vehicle, time| {
                    if time < due {
                        return Ok(());
                    }
                    due += SET_PERIOD;
                    let phase = sweep::phase(time.as_secs_f64(), seconds);
                    let set = f64::from(before) + amplitude * phase.sin();
                    let message = request::set_parameter("PITCH_SET_DEG", set as f32);
                    vehicle.link().send(&message)
                },
            );
            vehicle.set_parameter("PITCH_SET_DEG", before)?;
            swung
        }
    }
}

/// Whether the vehicle may let itself be armed a little later: not where somebody must see its rudder answer first.
pub fn is_worth_waiting(refusal: &Error) -> bool {
    let failure = refusal.downcast_ref::<Failure>();
    failure.and_then(Failure::refusal) != Some(Refusal::Polarity)
}

/// Arms as soon as the vehicle lets itself be armed.
///
/// # Errors
/// It does not for [`ARM_PATIENCE`], with its last reason, or waiting would not help.
pub fn arm(vehicle: &mut Vehicle, stop: &AtomicBool) -> Result<()> {
    let progress = spinner("hold the drone still");
    let begun = Instant::now();
    loop {
        match vehicle.command(request::ARM) {
            Ok(()) => break,
            Err(refusal)
                if begun.elapsed() > ARM_PATIENCE
                    || stop.load(Ordering::Relaxed)
                    || !is_worth_waiting(&refusal) =>
            {
                return Err(refusal);
            }
            Err(refusal) => progress.set_message(refusal.to_string()),
        }
        let again = Instant::now() + ARM_RETRY;
        while Instant::now() < again {
            vehicle.receive()?;
            progress.tick();
        }
    }
    progress.finish_and_clear();
    Ok(())
}

/// Reads along for a while, as long as control is on.
fn watch(
    vehicle: &mut Vehicle,
    length: Duration,
    stop: &AtomicBool,
    each: &mut dyn FnMut(&mut Vehicle, Duration) -> Result<()>,
) -> Result<()> {
    let progress = spinner("released");
    let begun = Instant::now();
    while begun.elapsed() < length {
        vehicle.receive()?;
        each(vehicle, begun.elapsed())?;
        progress.set_message(format!(
            "{:.1} of {:.1} s",
            begun.elapsed().as_secs_f64(),
            length.as_secs_f64()
        ));
        if vehicle.state() == FlightState::Failsafe {
            bail!("the vehicle gave up: {}", vehicle.reason());
        }
        if stop.load(Ordering::Relaxed) {
            bail!("stopped by the operator");
        }
    }
    progress.finish_and_clear();
    Ok(())
}

fn spinner(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_prefix(what);
    if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix}  {msg}") {
        bar.set_style(style);
    }
    bar
}
