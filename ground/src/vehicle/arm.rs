//! `tvc arm` and `tvc disarm`.

use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use rig::operator::FlightState;
use rig::request::{self, Order};

use crate::out::exit::Verdict;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::PortOptions;
use clap::Args;

/// Options of `tvc arm` and `tvc disarm`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo tvc arm                            standby to armed: the rudder still rests
  cargo tvc disarm                         the rudder to neutral, from any state; acknowledges faults
  cargo tvc disarm --port /dev/ttyACM1     a given port

Exit status: 0 obeyed, 1 refused (with the reason) or failed, 2 unusable input.")]
pub struct Operate {
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// How long the state may take to follow the answer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arms.
pub fn arm(options: &Operate) -> Result<Verdict> {
    order(options, "arm", request::ARM, |state| {
        matches!(state, FlightState::Armed | FlightState::Active)
    })
}

/// Disarms.
pub fn disarm(options: &Operate) -> Result<Verdict> {
    order(options, "disarm", request::DISARM, |state| {
        !matches!(
            state,
            FlightState::Armed | FlightState::Active | FlightState::Failsafe
        )
    })
}

fn order(
    options: &Operate,
    name: &str,
    order: Order,
    obeyed: fn(FlightState) -> bool,
) -> Result<Verdict> {
    let mut vehicle = Vehicle::connect(&options.port)?;
    vehicle.command(name, order)?;
    let end = Instant::now() + PATIENCE;
    while !obeyed(vehicle.state()) {
        if Instant::now() >= end {
            bail!(
                "the vehicle said yes to {name} and is in {:?}",
                vehicle.state()
            );
        }
        vehicle.receive()?;
    }
    let state = state_name(vehicle.state());
    if options.json {
        println!("{}", serde_json::json!({ "state": state }));
    } else {
        println!("{state}");
    }
    Ok(Verdict::Met)
}

/// A state in words.
pub fn state_name(state: FlightState) -> String {
    match state {
        FlightState::Boot => "boot".into(),
        FlightState::SelfTest => "self-test".into(),
        FlightState::Standby => "standby".into(),
        FlightState::Armed => "armed".into(),
        FlightState::Active => "active".into(),
        FlightState::Failsafe => "failsafe".into(),
        FlightState::Latched => "latched fault".into(),
        FlightState::Unknown(code) => format!("unknown ({code})"),
    }
}
