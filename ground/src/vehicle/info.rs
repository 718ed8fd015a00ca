//! `tvc info`: everything that may stand between a person and a flight, and what to do next.

mod next;
pub mod vehicle;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::logs::log::TOOL;
use crate::vehicle::port::machine::{Access, Program, access, holders, is_running, names};
use crate::vehicle::port::{self, Life, PortOptions};
use crate::{config, image};
use next::Standing;
use report::exit::Verdict;
use report::file::print_figures;
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
    /// Where the vehicle is.
    #[command(flatten)]
    pub port: PortOptions,

    /// List the serial ports instead.
    #[arg(long, conflicts_with = "port")]
    pub ports: bool,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// What was found.
#[derive(Debug, Default, Serialize)]
struct Found {
    /// This tool and its build.
    tool: &'static str,
    /// Files of the configuration, the one that goes before the other first.
    configuration: Vec<PathBuf>,
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

#[derive(Debug, Serialize)]
struct PortFound {
    name: String,
    /// A Nano by its USB ids, in its bootloader or not.
    nano: bool,
    bootloader: bool,
    access: Option<Access>,
    /// Other programs that have it open.
    held_by: Option<Vec<Program>>,
}

/// What was found, and what follows.
#[derive(Debug, Serialize)]
struct Answer {
    #[serde(flatten)]
    found: Found,
    standing: Standing,
    next: String,
}

/// Looks, and says what to do next.
///
/// # Errors
/// Standard output cannot be written.
pub fn run(options: &Info) -> Result<Verdict> {
    if options.ports {
        return port::list(options.json);
    }
    let found = look(&options.port);
    let (standing, next) = next::next(&found);
    let answer = Answer {
        found,
        standing,
        next,
    };
    print_figures(&answer, options.json, words)?;
    Ok(standing.verdict())
}

fn look(options: &PortOptions) -> Found {
    let mut found = Found {
        tool: TOOL,
        configuration: config::files(),
        image: image::at_hand().map(|(from, build)| ImageFound { from, build }),
        modem_manager: is_running("ModemManager"),
        ..Found::default()
    };
    let port = port::find(options.port.as_deref()).map(|name| {
        let life = port::life(&name);
        PortFound {
            access: access(Path::new(&name)),
            held_by: holders(Path::new(&name)),
            nano: life.is_some(),
            bootloader: life == Some(Life::Bootloader),
            name,
        }
    });
    let told = port.and_then(|port| {
        let port = found.port.insert(port);
        // Two programs at one port take each other's bytes.
        next::obstacle(port).map_or(Ok(()), Err)?;
        vehicle::ask(options, found.image.as_ref().map(|image| &*image.build))
    });
    match told {
        Ok(told) => found.vehicle = Some(told),
        Err(problem) => found.problem = Some(format!("{problem:#}")),
    }
    found
}

/// The answer for a person, a line each.
fn words(answer: &Answer) -> String {
    let found = &answer.found;
    let mut text = String::new();
    let mut line = |label: &str, words: &str| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{label:<15}{words}");
    };
    line("tool", found.tool);
    for path in &found.configuration {
        line("configuration", &path.display().to_string());
    }
    match &found.image {
        Some(image) => line("image", &format!("{}, {}", image.build, image.from)),
        None => line("image", "none"),
    }
    match &found.port {
        Some(port) => {
            line("port", &port.words());
            if let Some(access) = &port.access {
                let member = if access.member { "" } else { "not " };
                let (owner, group, rights) = (&access.owner, &access.group, access.rights());
                let words = format!("{rights} {owner}:{group}; you are {member}in the group");
                line("rights", &words);
            }
            if let Some(holders) = &port.held_by {
                line("used by", &names(holders));
            }
        }
        None => line("port", "none"),
    }
    if found.modem_manager == Some(true) {
        line(
            "ModemManager",
            "runs, and may open a new port for some seconds: see docs/tool.md",
        );
    }
    if let Some(vehicle) = &found.vehicle {
        vehicle.lines(line);
    }
    let _ = writeln!(text, "\n{}: {}", answer.standing, answer.next);
    text
}

impl PortFound {
    fn words(&self) -> String {
        let what = match (self.nano, self.bootloader) {
            (false, _) => "",
            (true, false) => " (SAMD21 Nano)",
            (true, true) => " (SAMD21 Nano in its bootloader)",
        };
        format!("{}{what}", self.name)
    }
}
