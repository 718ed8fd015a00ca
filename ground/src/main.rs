//! `tvc`: the ground tool. Messages for people go to standard error, data to standard output.

mod cli;
mod failure;
mod flash;
mod fly;
mod model;
mod output;
mod page;
mod plot;
mod uf2;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command};
use failure::{BadInput, Verdict};

fn main() -> ExitCode {
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
        Command::Flash(options) => flash::run(&options),
        Command::Model(options) => model::run(&options),
    }
}

/// The command line parser's complaint as one line.
fn usage(error: &clap::Error) -> BadInput {
    let text = error.to_string();
    let what = text.lines().next().unwrap_or_default();
    BadInput::new(format!(
        "{} (see --help)",
        what.trim_start_matches("error: ")
    ))
}
