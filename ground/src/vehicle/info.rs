//! `tvc info`: everything that may stand between a person and a flight, and what to do next.

mod next;
pub mod vehicle;

use std::path::Path;

use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::cli::TOOL;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::machine::{Access, Program, access, holders, is_running, names};
use crate::vehicle::port::{self, Life, PortOptions, VehicleOptions};
use crate::{config, image};
use next::Standing;
use report::exit::Verdict;
use report::measure::{Figures, data, figure, note, shown};
use vehicle::Told;

/// Options of `tvc info`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc info                           port, programs on it, builds, calibration, what to do next
  tvc info --port ./nano             a given port
  tvc info --ports                   every serial port, with what is behind it
  tvc info --json | jq -r .next      one JSON object

It asks the vehicle and changes nothing. `tvc doctor` is the same.
Exit status: 0 all is well, 1 there is something to do, 2 the vehicle cannot be reached.")]
pub struct Info {
    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,

    /// List the serial ports instead.
    #[arg(long, conflicts_with = "port")]
    pub ports: bool,
}

/// What was found.
#[derive(Debug, Default)]
struct Found {
    /// The image that `tvc fly` and `tvc flash` take.
    image: Option<ImageFound>,
    port: Option<PortFound>,
    /// ModemManager runs, which opens new ports to look for modems.
    modem_manager: Option<bool>,
    vehicle: Option<Told>,
    /// Why the vehicle cannot be reached.
    problem: Option<String>,
}

/// Where an image comes from, and its build id.
#[derive(Debug, Serialize)]
struct ImageFound {
    from: String,
    build: String,
}

#[derive(Debug, Default, Serialize)]
struct PortFound {
    name: String,
    /// What runs on it, if it is a Nano by its USB ids.
    #[serde(skip)]
    life: Option<Life>,
    nano: bool,
    bootloader: bool,
    access: Option<Access>,
    /// Other programs that have it open.
    held_by: Option<Vec<Program>>,
}

/// Looks, and says what to do next.
///
/// # Errors
/// Standard output cannot be written.
pub fn run(options: &Info) -> Result<Verdict> {
    if options.ports {
        return port::list(options.vehicle.json);
    }
    let (standing, figures) = judged(&options.vehicle.port);
    figures.conclude(options.vehicle.json, None)?;
    Ok(standing.verdict())
}

/// What is found at a port, and how things stand.
pub fn judged(port: &PortOptions) -> (Standing, Figures) {
    let found = look(port);
    let (standing, next) = next::next(&found);
    (standing, figures(&found, standing, &next))
}

fn look(options: &PortOptions) -> Found {
    let mut found = Found {
        image: image::at_hand().map(|(from, build)| ImageFound { from, build }),
        modem_manager: is_running("ModemManager"),
        ..Found::default()
    };
    let port = match &options.rig {
        Some(_) => Ok(PortFound { name: "the rig".to_owned(), nano: true, ..PortFound::default() }),
        None => port::find(options.port.as_deref()).map(PortFound::named),
    };
    let told = port.and_then(|port| {
        let port = found.port.insert(port);
        // Two programs at one port take each other's bytes.
        next::obstacle(port).map_or(Ok(()), Err)?;
        let image = found.image.as_ref().map(|image| &*image.build);
        vehicle::ask(&mut Vehicle::connect(options)?, image)
    });
    match told {
        Ok(told) => found.vehicle = Some(told),
        Err(problem) => found.problem = Some(format!("{problem:#}")),
    }
    found
}

/// What was found and what follows, a line each.
fn figures(found: &Found, standing: Standing, next: &str) -> Figures {
    let files = config::files();
    let mut figures =
        vec![figure("tool", TOOL).shown("tool", "", 0), data("configuration", &files)];
    figures.extend(files.iter().map(|file| shown("configuration", file.display().to_string())));
    let image = found.image.as_ref();
    let image = image.map_or("none".into(), |image| format!("{}, {}", image.build, image.from));
    figures.push(data("image", &found.image).said("image", image));
    let port = found.port.as_ref();
    let name = port.map_or("none".into(), PortFound::words);
    figures.push(data("port", &found.port).said("port", name));
    if let Some(access) = port.and_then(|port| port.access.as_ref()) {
        let member = if access.member { "" } else { "not " };
        let (owner, group, rights) = (&access.owner, &access.group, access.rights());
        let words = format!("{rights} {owner}:{group}; you are {member}in the group");
        figures.push(shown("rights", words));
    }
    if let Some(holders) = port.and_then(|port| port.held_by.as_ref()) {
        figures.push(shown("used by", names(holders)));
    }
    let modem_manager = figure("modem_manager", found.modem_manager);
    figures.push(match found.modem_manager {
        Some(true) => modem_manager.said(
            "ModemManager",
            "runs, and may open a new port for some seconds: see docs/guides/tool.md",
        ),
        _ => modem_manager,
    });
    let vehicle = found.vehicle.as_ref();
    figures.push(figure("vehicle", vehicle.map(Told::figures)));
    figures.extend([
        figure("problem", found.problem.as_deref()),
        data("standing", &standing),
        figure("next", next),
        note(format!("{}: {next}", standing.words())),
    ]);
    Figures::from(figures)
}

impl PortFound {
    fn named(name: String) -> Self {
        let life = port::life(&name);
        Self {
            access: access(Path::new(&name)),
            held_by: holders(Path::new(&name)),
            nano: life.is_some(),
            bootloader: life == Some(Life::Bootloader),
            life,
            name,
        }
    }

    fn words(&self) -> String {
        match Life::words(self.life) {
            "" => self.name.clone(),
            what => format!("{} ({what})", self.name),
        }
    }
}
