//! `tvc bringup`: the first hour with a board as one command, the same against the rig and a board
//! (docs/guides/bringup.md).

mod board;
mod faults;
mod row;
mod sensor;
mod session;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use client::StateKind;
use client::state::is_in_operation;
use indicatif::ProgressBar;
use maud::html;
use row::Row;
use session::Session;

use crate::vehicle::calibrate::keyboard::is_attended;
use crate::vehicle::link::Link;
use crate::vehicle::port::VehicleOptions;
use report::exit::Verdict;
use report::kind;
use report::measure::{Figures, figure, rows};
use report::page::{page, verdict};

/// Options of `tvc bringup`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc bringup                        examine the Nano that is connected (docs/guides/bringup.md)
  tvc bringup --report board.html    with a page to keep
  tvc bringup --rig                  the same on the virtual rig
  tvc bringup --rig='--hardware jumper=no,field=dead'   what differences look like

Put a jumper from D3 to D2 and connect no servo. The parameters are saved once; the board is made to fail its self-check and to hang, and recovers.
Exit status: 0 nothing differs or fails, 1 something does or went wrong, 2 unusable input.")]
pub struct Bringup {
    /// Where the board is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,

    /// Skip what needs hands: turning the sensor.
    #[arg(long)]
    pub no_hands: bool,

    /// Write an HTML report.
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,
}

/// Examines the board, prints the table and writes the report.
///
/// # Errors
/// No board; one that is armed; one that no longer answers.
pub fn run(options: &Bringup) -> Result<Verdict> {
    let port = &options.vehicle.port;
    let hands = !options.no_hands && port.rig.is_none() && is_attended();
    let found = examine(Link::open(port)?, hands)?;
    let met = !found.iter().any(Row::is_missed);
    let missed = found.iter().filter(|row| row.is_missed()).map(|row| row.check);
    let advice: Vec<_> = missed.map(|check| format!("{}: {}", check.name, check.meaning)).collect();
    let figures = Figures::from([rows("rows", found.iter().map(Row::figures)), figure("met", met)]);
    let page = options.report.as_deref().map(|path| {
        let body = html! {
            (verdict(met, if met { "Nothing differs." } else { "Something differs." }))
            (figures.table("rows").markup())
            @for line in &advice { p { (line) } }
        };
        (path, page("The first hour with a board", body))
    });
    let concluded = figures.conclude(options.vehicle.json, page);
    for line in &advice {
        eprintln!("{line}");
    }
    concluded.map(|_| Verdict::of(met))
}

/// All rows, in the order of the first hour.
pub fn examine(link: Link, hands: bool) -> Result<Vec<Row>> {
    /// How long the sensor may take from power-on until it is sampled.
    const START: Duration = Duration::from_secs(8);
    let progress = ProgressBar::new_spinner();
    let at = |what: &str| {
        progress.set_message(what.to_owned());
        progress.tick();
    };
    at("waiting for the vehicle");
    let mut session = Session::begin(link)?;
    if session.state().is_some_and(is_in_operation) {
        bail!("the vehicle is armed or in failsafe: disarm it first (tvc disarm)");
    }
    if session.state() == Some(StateKind::Latched) {
        let reason = session.reason();
        bail!("{reason}: acknowledge it first (tvc disarm)");
    }
    session.wait(START, |session| session.state() == Some(StateKind::Standby))?;
    at("who it is");
    let mut rows = board::identity(&mut session)?;
    at("clocks and sensor");
    rows.extend(board::clocks(&mut session)?);
    rows.extend(sensor::rows(&mut session)?);
    rows.extend(board::levels(&mut session)?);
    at("servo, flash, stack");
    rows.push(board::servo(&mut session)?);
    rows.push(board::flash(&mut session)?);
    rows.push(board::engine(&mut session)?);
    rows.push(board::stack(&mut session)?);
    at("USB");
    rows.push(faults::usb(&mut session)?);
    progress.suspend(|| sensor::scale(&mut session, hands)).map(|row| rows.push(row))?;
    at("a failed self-check and a hang on purpose");
    rows.push(faults::crash(&mut session)?);
    rows.push(faults::watchdog(&mut session)?);
    progress.finish_and_clear();
    Ok(rows)
}
