//! The command line: every command with what it does, in the order of the help. The options and
//! the code of a command are in the module of its name.

use clap::{Parser, Subcommand};

use crate::filters::fuse::Fuse;
use crate::flight::{fly::Fly, rig::Rig};
use crate::logs::{convert::Convert, inspect::LogCommand, replay::Replay, report::Report};
use crate::model::{Model, identify::Identify, montecarlo::MonteCarlo, tune::Tune};
use crate::shell::{Completions, Man};
use crate::vehicle::arm::Operate;
use crate::vehicle::bringup::Bringup;
use crate::vehicle::calibrate::Calibrate;
use crate::vehicle::flash::Flash;
use crate::vehicle::forward::Forward;
use crate::vehicle::info::Info;
use crate::vehicle::monitor::Monitor;
use crate::vehicle::param::Param;
use crate::vehicle::port::Ports;
use crate::vehicle::record::Record;
use crate::vehicle::recorder::Recorder;
use crate::vehicle::release::Release;
use crate::vehicle::test::Test;
use crate::vehicle::web::Web;

/// Version of the tool, and what tells builds of it apart: a sum over its sources and the image's.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " ", env!("TVC_TOOL_BUILD"));

/// Fly thrust-vector-control firmware on a virtual rig, and put it on the real one.
#[derive(Debug, Parser)]
#[command(name = "tvc", version = VERSION, about, max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
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
    /// List the serial ports.
    Ports(Ports),
    /// Build the image and put it on a Nano, or write it as a file.
    Flash(Flash),
    /// Examine a board for the first time: chip, clocks, sensor, servo, watchdog.
    Bringup(Bringup),
    /// Calibrate the sensors, guided at a vehicle or from a recording, and set up the servo.
    Calibrate(Calibrate),
    /// Show, change, compare, load and keep parameters.
    Param(Param),
    /// Watch the vehicle live.
    Monitor(Monitor),
    /// Watch, tune and stop the vehicle from a page in the browser.
    Web(Web),
    /// Keep everything that the vehicle sends in a log.
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
    /// Fetch the steps around the last release from the vehicle's own memory.
    #[command(alias = "burst")]
    Recorder(Recorder),
    /// Make an HTML report of a log.
    Report(Report),
    /// Run the firmware's library on a log, bit for bit or with something changed.
    Replay(Replay),
    /// Say what a log holds, cut a part out of it, recover a broken one.
    Log(LogCommand),
    /// Write a log in another form: for Foxglove, for QGroundControl, as a table.
    Convert(Convert),
    /// Find thrust, inertia, servo speed and delay from a recorded run.
    Identify(Identify),
    /// The drone's physics: simulate it, make it linear, validate it, scale it to a rocket.
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
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }
}
