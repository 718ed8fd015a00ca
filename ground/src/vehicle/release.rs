//! `tvc release`: an armed vehicle is let go, and watched until the command ends.

use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use client::{StateKind, request};

use crate::signals;
use crate::vehicle::calibrate::keyboard::{Keyboard, Typed, is_attended, is_yes};
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::VehicleOptions;
use crate::vehicle::test::arm;
use crate::vehicle::watch::Watched;
use report::arguments::seconds;
use report::exit::{BadInput, Verdict};
use report::measure::{Figures, figure, note};

/// Options of `tvc release`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc arm && tvc release       asks, lets go, keeps control until Ctrl-C, disarms
  tvc release --yes --seconds 5      without a question, for five seconds
  tvc release --yes --seconds 5 --rig    arms the virtual rig and lets it go

The vehicle must be armed. Once it is let go, it is disarmed however the command ends (Ctrl-C,
SIGTERM, SIGHUP, an error). Meanwhile FS_HOST is 1: if the tool is killed or the port goes away, the
vehicle goes to its failsafe, with the rudder at neutral, after three seconds. `tvc test` measures a
release.
Exit status: 0 released and disarmed again, 1 refused, declined, or a failsafe, 2 unusable input.")]
pub struct Release {
    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,

    /// Release without a question.
    #[arg(long)]
    pub yes: bool,

    /// End by itself this long after the release.
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
}

/// Releases, watches and disarms.
///
/// # Errors
/// Nobody to ask; no vehicle, one that is not armed, its refusal, or a failsafe.
pub fn run(options: &Release) -> Result<Verdict> {
    if !options.yes && !is_attended() {
        bail!(BadInput::new("nobody can be asked here: --yes releases without a question"));
    }
    let stop = signals::on_signal()?;
    let mut vehicle = Watched::new(Vehicle::connect(&options.vehicle.port)?);
    if options.vehicle.port.rig.is_some() {
        // Nobody else can have armed this vehicle.
        arm(&mut vehicle, &mut |_| {})?;
    }
    if vehicle.state() != Some(StateKind::Armed) {
        let state = vehicle.link().client().state_name();
        bail!("release refused: the vehicle is in {state}; `tvc arm` first");
    }
    vehicle.heed(Some(stop));
    if !options.yes && !is_agreed(&mut vehicle)? {
        eprintln!("not released; the vehicle is still armed");
        return Ok(Verdict::Missed);
    }
    vehicle.begin(stop);
    let released = release(&mut vehicle, |lasted| signals::asked(stop, lasted, options.seconds));
    let seconds = vehicle.leave(released)?;
    let words = format!("in control for {seconds:.1} s, then disarmed");
    Figures::from([figure("seconds", seconds), note(words)]).conclude(options.vehicle.json, None)
}

fn is_agreed(vehicle: &mut Vehicle) -> Result<bool> {
    eprint!("Let go now? The rudder is in control until Ctrl-C, which disarms. [y/N] ");
    let keyboard = Keyboard::listen();
    loop {
        // So that the vehicle goes on hearing its host.
        vehicle.receive()?;
        match keyboard.poll() {
            Typed::Nothing => {}
            Typed::Line(answer) => return Ok(is_yes(&answer)),
            Typed::Nobody => return Ok(false),
        }
    }
}

/// Releases and watches until `is_over`; how long control was on, s.
fn release(vehicle: &mut Watched, is_over: impl Fn(Duration) -> bool) -> Result<f64> {
    vehicle.watch_host()?;
    vehicle.command(request::RELEASE)?;
    eprintln!("released");
    let begun = vehicle.now();
    while !is_over(vehicle.now() - begun) {
        match vehicle.receive() {
            Err(_) if is_over(vehicle.now() - begun) => break,
            received => received?,
        };
        match vehicle.state() {
            Some(StateKind::Armed | StateKind::Active) | None => {}
            Some(StateKind::Standby) => bail!("the vehicle was disarmed by somebody else"),
            Some(_) => bail!("the vehicle gave up: {}", vehicle.reason()),
        }
    }
    Ok((vehicle.now() - begun).as_secs_f64())
}
