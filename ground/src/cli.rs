//! The command line: what can be said, with examples; a file for each command. Commands are carried
//! out elsewhere, by the module of the same name.

mod burst;
mod calibrate;
mod cycles;
mod disturbance;
mod experiment;
mod faults;
mod flash;
mod fly;
mod fuse;
mod identify;
mod link;
mod log;
mod model;
mod montecarlo;
mod operate;
mod param;
mod rig;
mod test;
mod tune;
mod watch;
mod web;

pub use burst::Burst;
pub use calibrate::{Calibrate, Day, Place, Sensor, Servo, SetUp, place};
pub use cycles::{Cycles, Optimise};
pub use disturbance::Disturb;
pub use experiment::{Experiment, ExperimentCommand, GyroBias, Sensing};
pub use faults::Faults;
pub use flash::Flash;
pub use fly::{Fly, ServoChoice};
pub use fuse::{FilterName, Fuse, Mode, Scalar, Setting, said};
pub use identify::Identify;
pub use link::Port;
pub use log::{Convert, Replay, Report};
pub use model::{Linear, Model, ModelCommand, Rocket, Simulate, Validate};
pub use montecarlo::{Merge, MonteCarlo, MonteCarloCommand, ReplayRun};
pub use operate::{Operate, Ports};
pub use param::{Param, ParamAction, ParamPort};
pub use rig::Rig;
pub use test::{Manoeuvre, Test};
pub use tune::Tune;
pub use watch::{Forward, Monitor, Record};
pub use web::Web;

use clap::{Parser, Subcommand};

/// Fly thrust-vector-control firmware on a virtual rig, and put it on the real one.
#[derive(Debug, Parser)]
#[command(name = "tvc", version, about, max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of the tool, in the order of the help: the rig, the vehicle, its logs, the physics, the filters.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build the image, boot it on the virtual rig and let it bring the drone upright.
    Fly(Fly),
    /// Fail sensor and cable at random instants of a flight, and count how it ends.
    Faults(Faults),
    /// Run the virtual rig in real time, its port behind a pseudo-terminal.
    Rig(Rig),
    /// List the serial ports.
    Ports(Ports),
    /// Build the image and put it on a Nano, or write it as a file.
    Flash(Flash),
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
    /// Fly a manoeuvre on the tether and measure it.
    Test(Test),
    /// Fetch the steps around the last release from the vehicle's own memory.
    Burst(Burst),
    /// Make an HTML report of a log.
    Report(Report),
    /// Run the firmware's library on a log, bit for bit or with something changed.
    Replay(Replay),
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
    /// Repeat the thesis' two navigation experiments with simulated sensors.
    Experiment(Experiment),
    /// Measure what one update of every filter costs on the chip, beside the crates of the field.
    Cycles(Cycles),
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
