//! `tvc arm` and `tvc disarm`.

use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use clap::Args;
use client::StateKind;
use client::request::{self, Order};
use client::state::is_in_operation;

use crate::out::exit::Verdict;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::PortOptions;

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
///
/// # Errors
/// No vehicle, its refusal, or a state that does not follow.
pub fn arm(options: &Operate) -> Result<Verdict> {
    order(options, request::ARM, StateKind::is_armed)
}

/// Disarms.
///
/// # Errors
/// As [`arm`].
pub fn disarm(options: &Operate) -> Result<Verdict> {
    order(options, request::DISARM, |state| !is_in_operation(state))
}

fn order(options: &Operate, order: Order, obeyed: fn(StateKind) -> bool) -> Result<Verdict> {
    let mut vehicle = Vehicle::connect(&options.port)?;
    vehicle.command(order)?;
    let end = Instant::now() + PATIENCE;
    while !vehicle.state().is_some_and(obeyed) {
        if Instant::now() >= end {
            bail!(
                "the vehicle accepted the order to {} and is in {}",
                order.name,
                vehicle.link().client().state_name()
            );
        }
        vehicle.receive()?;
    }
    let state = vehicle.link().client().state_name();
    if options.json {
        println!("{}", serde_json::json!({ "state": state }));
    } else {
        println!("{state}");
    }
    Ok(Verdict::Met)
}
