//! The command line: every command with what it does, in the order of the help. The options and
//! the code of a command are in the module of its name.

use clap::{CommandFactory, Parser, Subcommand};

use crate::filters::fuse::Fuse;
use crate::flight::{fly::Fly, rig::Rig};
use crate::logs::{inspect::LogCommand, replay::Replay, report::Report};
use crate::shell::{Completions, Man};
use crate::vehicle::arm::Operate;
use crate::vehicle::bringup::Bringup;
use crate::vehicle::calibrate::Calibrate;
use crate::vehicle::flash::Flash;
use crate::vehicle::forward::Forward;
use crate::vehicle::info::Info;
use crate::vehicle::monitor::Monitor;
use crate::vehicle::param::Param;
use crate::vehicle::record::Record;
use crate::vehicle::release::Release;
use crate::vehicle::support::Support;
use crate::vehicle::test::Test;
use crate::vehicle::web::Web;
use design::{identify::Identify, model::Model, montecarlo::MonteCarlo, tune::Tune};

/// Version of the tool, and what tells builds of it apart: a sum over its sources and the image's.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " ", env!("TVC_TOOL_BUILD"));

/// This tool: a log that it keeps begins with these words, as a text of the ground station.
pub const TOOL: &str = concat!("tvc ", env!("CARGO_PKG_VERSION"), " ", env!("TVC_TOOL_BUILD"));

/// Fly thrust-vector-control firmware on a virtual rig, and put it on the real one.
#[derive(Debug, Parser)]
#[command(name = "tvc", version = VERSION, about, max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands by what they are for, in the order of the help.
const GROUPS: [(&str, &str); 4] = [
    ("Fly the image on the virtual rig", "fly rig"),
    (
        "Vehicle, the real one or the rig's",
        "info support flash bringup calibrate param monitor web record forward arm disarm release \
         reboot test",
    ),
    ("Logs", "report replay log"),
    ("Design", "model identify tune montecarlo fuse"),
];

/// The command line, whose help has the commands in groups.
pub fn command() -> clap::Command {
    let command = Cli::command();
    let mut help = String::from("{about}\n\nUsage: tvc COMMAND --help has options and examples\n");
    for (heading, names) in GROUPS {
        help += &format!("\n{heading}:\n");
        for name in names.split_whitespace() {
            let about = command.find_subcommand(name).and_then(|found| found.get_about());
            help += &format!("  {name:<12}{}\n", about.cloned().unwrap_or_default());
        }
    }
    help += "\nIn the source tree `cargo tvc` starts it. `tvc completions`, `tvc man`: docs/guides/tool.md.";
    command.help_template(help)
}

/// The commands of the tool, in the order of the help: the rig, the vehicle, its logs, the physics,
/// the filters.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build the image, boot it on the virtual rig and let it bring the drone upright.
    Fly(Fly),
    /// Run the virtual rig in real time, its port behind a pseudo-terminal.
    Rig(Rig),
    /// Look at port, vehicle, builds and calibration, and say what to do next.
    #[command(alias = "doctor")]
    Info(Info),
    /// Collect what a bug report needs in one file, without anything personal.
    Support(Support),
    /// Build the image and put it on a Nano, or write it as a file.
    Flash(Flash),
    /// Examine a board for the first time: chip, clocks, sensor, servo, watchdog.
    Bringup(Bringup),
    /// Calibrate sensors, servo and polarity, guided at the vehicle or from a recording.
    Calibrate(Calibrate),
    /// Show, change, compare, load and keep parameters.
    Param(Param),
    /// Watch the vehicle live.
    Monitor(Monitor),
    /// Watch, tune and stop the vehicle from a page in the browser.
    Web(Web),
    /// Keep in a log what the vehicle sends, or its own record of the last release.
    Record(Record),
    /// Pass everything on to QGroundControl and PlotJuggler.
    Forward(Forward),
    /// Arm the vehicle.
    Arm(Operate),
    /// Disarm the vehicle: rudder to neutral.
    Disarm(Operate),
    /// Let an armed vehicle go, and disarm it at the end.
    Release(Release),
    /// Start the vehicle anew.
    Reboot(Operate),
    /// Fly a manoeuvre on the tether and measure it.
    Test(Test),
    /// Make an HTML report of a log.
    Report(Report),
    /// Run the firmware's library on a log, bit for bit or with something changed.
    Replay(Replay),
    /// Say what a log holds, cut a part out, recover a broken one, write it in another form.
    Log(LogCommand),
    /// Find thrust, inertia, servo speed and delay from a recorded run.
    Identify(Identify),
    /// The drone's physics: simulate it, make it linear, fly a log's release again.
    Model(Model),
    /// Find gains for a drone and servo from requirements.
    Tune(Tune),
    /// Fly many dispersed drones on the model and say how many pass.
    #[command(name = "montecarlo")]
    MonteCarlo(MonteCarlo),
    /// Run an attitude filter on recordings, and score it against their references.
    Fuse(Fuse),
    /// Print the completions of a shell.
    Completions(Completions),
    /// Write manual pages of all commands.
    Man(Man),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_in_a_group_of_the_help_which_is_short() {
        let command = command();
        let grouped: Vec<_> =
            GROUPS.iter().flat_map(|(_, names)| names.split_whitespace()).collect();
        let own = ["completions", "man"];
        let names = command.get_subcommands().map(|command| command.get_name().to_owned());
        let lost: Vec<_> =
            names.filter(|name| !own.contains(&&**name) && !grouped.contains(&&**name)).collect();
        assert_eq!(lost, [""; 0]);
        let help = |words: &[&str]| {
            let asked = command.clone().try_get_matches_from(words);
            asked.unwrap_err().to_string()
        };
        let own = help(&["tvc", "--help"]);
        assert!(own.lines().count() <= 40, "{own}");
        let help = help(&["tvc", "fly", "--help"]);
        assert!(help.lines().count() <= 60, "{help}");
        let wide: Vec<_> = help.lines().filter(|line| line.chars().count() > 110).collect();
        assert_eq!(wide, [""; 0]);
    }

    #[test]
    fn the_definition_is_consistent() {
        command().debug_assert();
        // It fits the text of a message.
        assert!(TOOL.len() <= 50, "{TOOL}");
    }
}
