//! `tvc test`: arms and releases the vehicle, watches a manoeuvre, disarms it and prints the
//! figures.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Error, Result, bail, ensure};
use clap::{Args, Subcommand};
use client::state::is_in_operation;
use client::{Failure, Frame, RefusalKind, StateKind, request};
use tvc_nano::Axis;

use crate::logs::report::{conclude, figures, sweep};
use crate::signals;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::VehicleOptions;
use crate::vehicle::watch::Watched;
use flights::arguments::AxisName;
use flights::figures::response;
use flights::log::{Flight, Release};
use report::arguments::{number, seconds};
use report::exit::Verdict;
use report::kind;
use report::measure::figure;
use report::progress::spinner;

/// Options of `tvc test`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc test step                      arm, release, three seconds, disarm: the step response
  tvc test step --log step.tlog --report step.html
  tvc test hold --seconds 30         how well it stays upright
  tvc test chirp                     swings the set point faster and faster: bandwidth, delay
  tvc test chirp --axis roll         the same of roll, of a vehicle with two axes

Hold the drone still at its start for the first seconds. However the test ends (Ctrl-C, SIGTERM,
SIGHUP, an error), the vehicle is disarmed. Meanwhile FS_HOST is 1: if the tool is killed or the port
goes away, the vehicle goes to its failsafe, with the rudder at neutral, after three seconds.
Exit status: 0 every requirement met, 1 one missed, refused or failed, 2 unusable input.")]
pub struct Test {
    /// What to do.
    #[command(subcommand)]
    pub manoeuvre: Manoeuvre,

    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,

    /// The axis that is tilted, held or swung; roll needs a vehicle with two (AXES 2).
    #[arg(long, value_enum, default_value_t, global = true)]
    pub axis: AxisName,

    /// Keep every frame in a new telemetry log.
    #[arg(long, value_name = "FILE", global = true, value_parser = kind::new_log)]
    pub log: Option<PathBuf>,

    /// Write an HTML report.
    #[arg(long, value_name = "FILE.html", global = true, value_parser = kind::page)]
    pub report: Option<PathBuf>,
}

/// The manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Subcommand)]
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

impl Manoeuvre {
    /// From the tilt at which it is held, in the usual length.
    pub const STEP: Self = Self::Step { seconds: 3.0 };
    /// Upright, in the usual length.
    pub const HOLD: Self = Self::Hold { seconds: 15.0 };
    /// In the usual length and amplitude.
    pub const CHIRP: Self = Self::Chirp { seconds: 30.0, amplitude: 4.0 };

    /// The same, of another length, s, if one is given.
    ///
    /// # Errors
    /// The length is not 1 to 600 s.
    pub fn lasting(mut self, length_s: Option<f64>) -> Result<Self> {
        let (Self::Step { seconds } | Self::Hold { seconds } | Self::Chirp { seconds, .. }) =
            &mut self;
        *seconds = length_s.unwrap_or(*seconds);
        ensure!((1.0..=600.0).contains(seconds), "a test lasts 1 to 600 s");
        Ok(self)
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Step { .. } => "step",
            Self::Hold { .. } => "hold",
            Self::Chirp { .. } => "chirp",
        }
    }
}

fn amplitude(text: &str) -> Result<f64, String> {
    number(text, f64::MIN_POSITIVE..=15.0, "an amplitude is above 0 and at most 15 deg")
}

/// How long the vehicle may refuse to be armed: it passes its self-test and learns the gyro's
/// offset at rest.
const ARM_PATIENCE: Duration = Duration::from_secs(20);
/// Time between two attempts.
const ARM_RETRY: Duration = Duration::from_millis(500);
/// Time between arming and release, so that the vehicle's recorder has steps from before the
/// release.
const ARMED: Duration = Duration::from_millis(250);
/// Time upright before the set point begins to swing.
const SETTLE: Duration = Duration::from_secs(3);
/// The parameters with the set points, by axis.
const SET_POINTS: [&str; Axis::COUNT] = ["PITCH_SET_DEG", "ROLL_SET_DEG"];
/// Time between two set points.
const SET_PERIOD: Duration = Duration::from_millis(20);
/// Without a heartbeat for so long the vehicle counts as gone; it sends one a second.
const SILENCE: Duration = Duration::from_secs(3);

/// What is under way in a manoeuvre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage<'a> {
    /// The drone is to be held still until the vehicle can be armed; the last refusal, if there was
    /// one.
    Still(Option<&'a str>),
    /// Released, so long ago and for so long.
    Released(Duration, Duration),
    /// The set point swings, since so long and for so long.
    Swinging(Duration, Duration),
}

impl Stage<'_> {
    /// In words.
    pub fn words(&self) -> &'static str {
        match self {
            Self::Still(_) => "hold the drone still",
            Self::Released(..) => "released",
            Self::Swinging(..) => "the set point swings",
        }
    }

    /// How far it is, in words.
    fn progress(&self) -> String {
        match self {
            Self::Still(refusal) => refusal.unwrap_or_default().to_owned(),
            Self::Released(now, length) | Self::Swinging(now, length) => {
                format!("{:.1} of {:.1} s", now.as_secs_f64(), length.as_secs_f64())
            }
        }
    }
}

/// Flies the manoeuvre that `options` ask for.
///
/// # Errors
/// No vehicle, its refusal, a failsafe in flight, or a log that cannot be written.
pub fn run(options: &Test) -> Result<Verdict> {
    let stop = signals::on_signal()?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let log = options.log.clone().unwrap_or_else(|| folder.path().join("test.tlog"));
    let mut vehicle = Watched::new(Vehicle::connect(&options.vehicle.port)?);
    vehicle.keep_log(&log)?;
    if vehicle.state().is_some_and(is_in_operation) {
        bail!("the vehicle is not in standby: `tvc disarm` first");
    }
    let axis = options.axis.into();
    if axis == Axis::Roll && vehicle.parameter("AXES")? != 2.0 {
        bail!(
            "the vehicle has one axis (AXES 1), which is pitch: docs/guides/two_axes.md adds the second"
        );
    }
    vehicle.begin(stop);
    let progress = spinner("{spinner} {prefix}  {msg}");
    let flown = vehicle.watch_host().and_then(|()| {
        fly(&mut vehicle, options.manoeuvre, axis, &mut |stage| {
            progress.set_prefix(stage.words());
            progress.set_message(stage.progress());
            progress.tick();
        })
    });
    progress.finish_and_clear();
    let flown = vehicle.leave(flown);
    let ended = vehicle.link().end_log();
    if let (Some(path), Ok(())) = (&options.log, &ended) {
        eprintln!("wrote {}", path.display());
    }
    if let Err(error) = flown.and(ended) {
        return fell(&error, &log, options).and(Err(error));
    }
    let flight = Flight::read(&log)?;
    let was_tilted = |release: &Release| response(release, axis).is_some();
    if matches!(options.manoeuvre, Manoeuvre::Step { .. })
        && axis == Axis::Roll
        && !flight.releases().iter().any(was_tilted)
    {
        bail!("it was released upright: hold it tilted to the side, by 3 deg at least");
    }
    let figures = figures(&flight);
    let (page, json) = (options.report.as_deref(), options.vehicle.json);
    conclude(&flight, figures, &log, page, json)
}

/// Hands over what there is of a manoeuvre that ended with an error: the figures if the vehicle was
/// released, and for a script an object in any case.
fn fell(error: &Error, log: &Path, options: &Test) -> Result<Verdict> {
    let flight = Flight::read(log).unwrap_or_default();
    let json = options.vehicle.json;
    if !json && flight.releases().is_empty() {
        return Ok(Verdict::Missed);
    }
    let figures = figures(&flight).and(figure("error", format!("{error:#}")));
    conclude(&flight, figures, log, options.report.as_deref(), json)
}

/// Arms, releases and flies the manoeuvre of an axis, and calls `show` with what is under way again
/// and again. What it changes is put back once the vehicle is [left](Watched::leave), which disarms
/// it.
///
/// # Errors
/// The vehicle refuses, falls silent or gives up, or the person wants an end.
pub fn fly(
    vehicle: &mut Watched,
    manoeuvre: Manoeuvre,
    axis: Axis,
    show: &mut dyn FnMut(Stage<'_>),
) -> Result<()> {
    show(Stage::Still(None));
    vehicle.command(request::CALIBRATE)?;
    arm(vehicle, &mut |why| show(Stage::Still(Some(why))))?;
    vehicle.wait(ARMED)?;
    vehicle.command(request::RELEASE)?;
    let (Manoeuvre::Step { seconds }
    | Manoeuvre::Hold { seconds }
    | Manoeuvre::Chirp { seconds, .. }) = manoeuvre;
    let length = Duration::from_secs_f64(seconds);
    let Manoeuvre::Chirp { amplitude, .. } = manoeuvre else {
        return watch(vehicle, length, |_, time, _| {
            show(Stage::Released(time, length));
            Ok(())
        });
    };
    let set_point = SET_POINTS[axis.index()];
    let before = vehicle.parameter(set_point)?;
    vehicle.put_back_later(set_point, before);
    watch(vehicle, SETTLE, |_, time, _| {
        show(Stage::Released(time, SETTLE));
        Ok(())
    })?;
    let mut due = Duration::ZERO;
    watch(vehicle, length, |vehicle, time, _| {
        show(Stage::Swinging(time, length));
        if time < due {
            return Ok(());
        }
        due += SET_PERIOD;
        let phase = sweep::phase(time.as_secs_f64(), seconds);
        let set = f64::from(before) + amplitude * phase.sin();
        // No answer is waited for, and none repeated: the next one follows.
        let message = request::set_parameter(set_point, set as f32);
        vehicle.link().send(&message)
    })
}

/// Arms the vehicle as soon as it says that it may be armed, to which no word of refusal is told;
/// `wait` is called meanwhile, with why it may not.
///
/// # Errors
/// The vehicle's refusal, after [`ARM_PATIENCE`] or where waiting does not help.
pub fn arm(vehicle: &mut Vehicle, wait: &mut dyn FnMut(&str)) -> Result<()> {
    let end = vehicle.now() + ARM_PATIENCE;
    loop {
        let Err(refusal) = vehicle.command(request::MAY_ARM) else {
            break;
        };
        let kind = refusal.downcast_ref().and_then(Failure::refusal);
        // A refusal without a reason is of a firmware that does not know the question.
        // Where the polarity check is missing, waiting does not help.
        let is_worth_waiting = |why: &RefusalKind| *why != RefusalKind::Polarity;
        let Some(why) = kind.filter(is_worth_waiting).filter(|_| vehicle.now() <= end) else {
            break;
        };
        let (why, again) = (why.to_string(), vehicle.now() + ARM_RETRY);
        while vehicle.now() < again {
            vehicle.receive()?;
            wait(&why);
        }
    }
    vehicle.command(request::ARM)
}

/// Receives for a while and calls `each` with the time since the start and what has come.
///
/// # Errors
/// A failsafe, silence, the person wants an end, or those of `each`.
pub fn watch(
    vehicle: &mut Vehicle,
    length: Duration,
    mut each: impl FnMut(&mut Vehicle, Duration, &[Frame]) -> Result<()>,
) -> Result<()> {
    let begun = vehicle.now();
    while vehicle.now() - begun < length {
        let frames = vehicle.receive()?;
        let lasted = vehicle.now() - begun;
        each(vehicle, lasted, &frames)?;
        if vehicle.state() == Some(StateKind::Failsafe) {
            bail!("the vehicle gave up: {}", vehicle.reason());
        }
        let link = vehicle.link();
        let now = link.now();
        let is_silent = |heard| now.saturating_sub(heard) > SILENCE;
        if link.client().heard().is_some_and(is_silent) {
            bail!(
                "nothing from the vehicle for {} s: does the firmware still run?",
                SILENCE.as_secs()
            );
        }
    }
    Ok(())
}
