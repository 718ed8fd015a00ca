//! `tvc`: the ground tool. Messages for people go to standard error, data to standard output.

mod burst;
mod calibrate;
mod cli;
mod convert;
mod cycles;
mod experiment;
mod failure;
mod faults;
mod flash;
mod fly;
mod forward;
mod fuse;
mod identify;
mod law;
mod link;
mod log;
mod manoeuvre;
mod model;
mod monitor;
mod montecarlo;
mod operate;
mod output;
mod page;
mod param;
mod plot;
mod port;
mod record;
mod replay;
mod report;
mod status;
mod stop;
mod tune;
mod uf2;
mod virtual_rig;
mod web;

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

use cli::{Cli, Command};
use failure::{BadInput, Verdict};

fn main() -> ExitCode {
    // `tvc ... | head`: nobody reads any more, and that is no error.
    #[cfg(unix)]
    sigpipe::reset();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if !error.use_stderr() => error.exit(),
        Err(error) => return failure::exit_code(Err(usage(&error).into())),
    };
    failure::exit_code(run(cli.command))
}

fn run(command: Command) -> anyhow::Result<Verdict> {
    match command {
        Command::Fly(options) => fly::run(&options),
        Command::Fuse(options) => fuse::run(&options),
        Command::Experiment(options) => experiment::run(&options),
        Command::Flash(options) => flash::run(&options),
        Command::Model(options) => model::run(&options),
        Command::Identify(options) => identify::run(&options),
        Command::Tune(options) => tune::run(&options),
        Command::MonteCarlo(options) => montecarlo::run(&options),
        Command::Rig(options) => virtual_rig::run(&options),
        Command::Ports(options) => port::list(&options),
        Command::Param(options) => param::run(&options),
        Command::Arm(options) => operate::arm(&options),
        Command::Disarm(options) => operate::disarm(&options),
        Command::Monitor(options) => monitor::run(&options),
        Command::Record(options) => record::run(&options),
        Command::Burst(options) => burst::run(&options),
        Command::Forward(options) => forward::run(&options),
        Command::Cycles(options) => cycles::run(&options),
        Command::Calibrate(options) => calibrate::run(&options),
        Command::Faults(options) => faults::run(&options),
        Command::Replay(options) => replay::run(&options),
        Command::Convert(options) => convert::run(&options),
        Command::Report(options) => report::run(&options),
        Command::Test(options) => manoeuvre::run(&options),
        Command::Web(options) => web::run(&options),
    }
}

/// The command line parser's complaint as one line: its first paragraph, which may list what could be said instead.
fn usage(error: &clap::Error) -> BadInput {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return BadInput::new("a command is missing (see --help)");
    }
    let text = error.to_string();
    let what: Vec<_> = text
        .lines()
        .map(str::trim)
        .take_while(|line| !line.is_empty())
        .collect();
    BadInput::new(format!(
        "{} (see --help)",
        what.join(" ").trim_start_matches("error: ")
    ))
}
