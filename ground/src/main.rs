//! `tvc`: the ground tool. Messages for people go to standard error, data to standard output.

#![forbid(unsafe_code)]
// Nothing of a program is reachable from outside; `pub` marks what a module offers to the others.
#![allow(unreachable_pub)]

mod arguments;
mod cli;
mod config;
#[cfg(test)]
mod examples;
mod filters;
mod flight;
#[cfg(test)]
mod fuzz;
mod image;
mod input;
mod logs;
mod model;
mod out;
mod param_file;
mod shell;
mod signals;
mod vehicle;

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches};

use cli::{Cli, Command};
use config::Config;
use out::exit::{BadInput, Verdict};

fn main() -> ExitCode {
    // In `tvc ... | head` the reader ends first, which is no error.
    #[cfg(unix)]
    sigpipe::reset();
    let config = Config::load(&config::files()).map_err(BadInput::new);
    let command = config
        .as_ref()
        .unwrap_or(&Config::default())
        .apply(Cli::command());
    let parsed = command
        .try_get_matches()
        .and_then(|found| Cli::from_arg_matches(&found));
    out::exit::exit_code(match (parsed, config) {
        (Err(error), _) if !error.use_stderr() => error.exit(),
        (Err(error), _) => Err(usage(&error).into()),
        (Ok(_), Err(error)) => Err(error.into()),
        (Ok(cli), Ok(_)) => run(cli.command),
    })
}

fn run(command: Command) -> anyhow::Result<Verdict> {
    match command {
        Command::Fly(options) => flight::fly::run(&options),
        Command::Fuse(options) => filters::fuse::run(&options),
        Command::Experiment(options) => filters::experiment::run(&options),
        Command::Flash(options) => vehicle::flash::run(&options),
        Command::Model(options) => model::run(&options),
        Command::Identify(options) => model::identify::run(&options),
        Command::Tune(options) => model::tune::run(&options),
        Command::MonteCarlo(options) => model::montecarlo::run(&options),
        Command::Rig(options) => flight::rig::run(&options),
        Command::Info(options) => vehicle::info::run(&options),
        Command::Ports(options) => vehicle::port::list(&options),
        Command::Bringup(options) => vehicle::bringup::run(&options),
        Command::Param(options) => vehicle::param::run(&options),
        Command::Arm(options) => vehicle::arm::arm(&options),
        Command::Disarm(options) => vehicle::arm::disarm(&options),
        Command::Release(options) => vehicle::release::run(&options),
        Command::Reboot(options) => vehicle::arm::reboot(&options),
        Command::Monitor(options) => vehicle::monitor::run(&options),
        Command::Record(options) => vehicle::record::run(&options),
        Command::Recorder(options) => vehicle::recorder::run(&options),
        Command::Forward(options) => vehicle::forward::run(&options),
        Command::Cycles(options) => filters::cycles::run(&options),
        Command::Calibrate(options) => vehicle::calibrate::run(&options),
        Command::Faults(options) => flight::faults::run(&options),
        Command::Hardware(options) => flight::hardware_campaign::run(&options),
        Command::Profile(options) => flight::profile::run(&options),
        Command::Stack(options) => flight::stack::run(&options),
        Command::Replay(options) => logs::replay::run(&options),
        Command::Log(options) => logs::inspect::run(&options),
        Command::Convert(options) => logs::convert::run(&options),
        Command::Report(options) => logs::report::run(&options),
        Command::Test(options) => vehicle::test::run(&options),
        Command::Completions(options) => shell::completions(&options, Cli::command()),
        Command::Man(options) => shell::man(&options, Cli::command()),
        Command::Web(options) => vehicle::web::run(&options),
    }
}

/// The command line parser's complaint as one line: its first paragraph, which may list the values
/// that would be accepted, and the name that may have been meant.
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
    let tip = text.lines().map(str::trim).find_map(|line| {
        // Other tips are about names that begin with a dash.
        line.strip_prefix("tip: ")
            .filter(|tip| tip.contains("similar"))
    });
    let tip = tip.map_or(String::new(), |tip| format!("; {tip}"));
    BadInput::new(format!(
        "{}{tip} (see --help)",
        what.join(" ").trim_start_matches("error: ")
    ))
}
