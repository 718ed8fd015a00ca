//! The command line: every command with what it does, in the order of the help. The options and
//! the code of a command are in the module of its name.

use anyhow::Result;
use clap::{CommandFactory, Parser, Subcommand};

use crate::filters::fuse;
use crate::flight::{fly, rig};
use crate::image::ImageOption;
use crate::logs::{inspect, replay, report};
use crate::shell;
use crate::vehicle::{
    arm, bringup, calibrate, flash, forward, info, monitor, param, record, release, support, test,
    web,
};
use ::report::exit::Verdict;
use design::{identify, model, montecarlo, tune};

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

/// The commands of the tool: its options, and the function that carries it out, for each.
macro_rules! commands {
    ($($(#[$about:meta])* $name:ident($options:ty) => $run:path;)+) => {
        /// The commands of the tool.
        #[derive(Debug, Subcommand)]
        pub enum Command {
            $($(#[$about])* $name($options),)+
        }

        impl Command {
            /// Carries out the command.
            pub fn run(&self) -> Result<Verdict> {
                match self {
                    $(Self::$name(options) => $run(options),)+
                }
            }
        }
    };
}

commands! {
    /// Build the image, boot it on the virtual rig and let it bring the drone upright.
    Fly(fly::Fly) => fly::run;
    /// Run the virtual rig in real time, its port behind a pseudo-terminal.
    Rig(rig::Rig) => rig::run;
    /// Look at port, vehicle, builds and calibration, and say what to do next.
    #[command(alias = "doctor")]
    Info(info::Info) => info::run;
    /// Collect what a bug report needs in one file, without anything personal.
    Support(support::Support) => support::run;
    /// Build the image and put it on a Nano, or write it as a file.
    Flash(flash::Flash) => flash::run;
    /// Examine a board for the first time: chip, clocks, sensor, servo, watchdog.
    Bringup(bringup::Bringup) => bringup::run;
    /// Calibrate sensors, servo and polarity, guided at the vehicle or from a recording.
    Calibrate(calibrate::Calibrate) => calibrate::run;
    /// Show, change, compare, load and keep parameters.
    Param(param::Param) => param::run;
    /// Watch the vehicle live.
    Monitor(monitor::Monitor) => monitor::run;
    /// Watch, tune and stop the vehicle from a page in the browser.
    Web(web::Web) => web::run;
    /// Keep in a log what the vehicle sends, or its own record of the last release.
    Record(record::Record) => record::run;
    /// Pass everything on to QGroundControl and PlotJuggler.
    Forward(forward::Forward) => forward::run;
    /// Arm the vehicle.
    Arm(arm::Operate) => arm::arm;
    /// Disarm the vehicle: rudder to neutral.
    Disarm(arm::Operate) => arm::disarm;
    /// Let an armed vehicle go, and disarm it at the end.
    Release(release::Release) => release::run;
    /// Start the vehicle anew.
    Reboot(arm::Operate) => arm::reboot;
    /// Fly a manoeuvre on the tether and measure it.
    Test(test::Test) => test::run;
    /// Make an HTML report of a log.
    Report(report::Report) => report::run;
    /// Run the firmware's library on a log, bit for bit or with something changed.
    Replay(replay::Replay) => replay::run;
    /// Say what a log holds, cut a part out, recover a broken one, write it in another form.
    Log(inspect::LogCommand) => inspect::run;
    /// Find thrust, inertia, servo speed and delay from a recorded run.
    Identify(identify::Identify) => identify::run;
    /// The drone's physics: simulate it, make it linear, fly a log's release again.
    Model(model::Model) => model::run;
    /// Find gains for a drone and servo from requirements.
    Tune(tune::Tune) => run_tune;
    /// Fly many dispersed drones on the model and say how many pass.
    #[command(name = "montecarlo")]
    MonteCarlo(montecarlo::MonteCarlo) => montecarlo::run;
    /// Run an attitude filter on recordings, and score it against their references.
    Fuse(fuse::Fuse) => fuse::run;
    /// Print the completions of a shell.
    Completions(shell::Completions) => shell::completions;
    /// Write manual pages of all commands.
    Man(shell::Man) => shell::man;
}

fn run_tune(options: &tune::Tune) -> Result<Verdict> {
    tune::run(options, || ImageOption::default().image())
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
