//! `tvc arm`, `tvc disarm` and `tvc reboot`.

use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use client::StateKind;
use client::request::{self, Order};
use client::state::is_in_operation;

use crate::vehicle::link::Vehicle;
use crate::vehicle::port::VehicleOptions;
use report::exit::Verdict;
use report::measure::{Figures, figure, note};

/// Options of `tvc arm`, `tvc disarm` and `tvc reboot`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc arm                            standby to armed: the rudder still rests
  tvc disarm                         the rudder to neutral, from any state; acknowledges faults
  tvc reboot                         starts anew, as after power-on; not while it is armed
  tvc disarm --port /dev/ttyACM1     a given port

In a failsafe whose fault is still there, disarm says so: the rudder is at neutral already.
Exit status: 0 obeyed, 1 refused (with the reason) or failed, 2 unusable input.")]
pub struct Operate {
    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,
}

/// How long the state may take to follow the answer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arms.
///
/// # Errors
/// No vehicle, its refusal, or a state that does not follow.
pub fn arm(options: &Operate) -> Result<Verdict> {
    let mut vehicle = Vehicle::connect(&options.vehicle.port)?;
    vehicle.command(request::ARM)?;
    follow(&mut vehicle, request::ARM, StateKind::is_armed)?;
    let state = vehicle.link().client().state_name();
    let figures = Figures::from([figure("state", &*state), note(&*state)]);
    figures.conclude(options.vehicle.json, None)
}

/// Disarms. Names the fault that keeps the vehicle in its failsafe, where the rudder is at neutral
/// too.
///
/// # Errors
/// No vehicle, or a state that does not follow.
pub fn disarm(options: &Operate) -> Result<Verdict> {
    let mut vehicle = Vehicle::connect(&options.vehicle.port)?;
    let fault = vehicle.disarm()?;
    if fault.is_none() {
        let obeyed = |state| !is_in_operation(state);
        follow(&mut vehicle, request::DISARM, obeyed)?;
    }
    let state = vehicle.link().client().state_name();
    let words = fault
        .as_ref()
        .map_or_else(|| state.clone(), |fault| format!("disarmed; fault remains: {fault}"));
    let figures = Figures::from([figure("state", state), figure("fault", fault), note(words)]);
    figures.conclude(options.vehicle.json, None)
}

/// Starts the vehicle anew.
///
/// # Errors
/// No vehicle, or its refusal.
pub fn reboot(options: &Operate) -> Result<Verdict> {
    Vehicle::connect(&options.vehicle.port)?.command(request::REBOOT)?;
    let figures = Figures::from([figure("restarting", true), note("restarting")]);
    figures.conclude(options.vehicle.json, None)
}

/// Waits for the state that an order leads to.
fn follow(vehicle: &mut Vehicle, order: Order, obeyed: fn(StateKind) -> bool) -> Result<()> {
    let end = vehicle.now() + PATIENCE;
    while !vehicle.state().is_some_and(obeyed) {
        if vehicle.now() >= end {
            bail!(
                "the vehicle accepted the order to {} and is in {}",
                order.name,
                vehicle.link().client().state_name()
            );
        }
        vehicle.receive()?;
    }
    Ok(())
}
