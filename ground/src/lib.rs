//! The ground tool `tvc` as a library: its commands, and what the laboratory (`lab`) shares with
//! them. Messages for people go to standard error, data to standard output.

#![forbid(unsafe_code)]
#![allow(
    rustdoc::private_intra_doc_links,
    missing_docs,
    unreachable_pub,
    clippy::missing_errors_doc,
    clippy::new_without_default,
    reason = "shared by the programs of this tree alone: `pub` marks what a module offers to others"
)]

pub mod cli;
pub mod config;
pub mod filters;
pub mod flight;
pub mod image;
pub mod logs;
mod renamed;
#[cfg(all(test, unix))]
mod script;
pub mod shell;
pub mod signals;
pub mod vehicle;

use std::env;
use std::ffi::OsString;
use std::process::ExitCode;

use clap::FromArgMatches;
use clap::error::ErrorKind;

use cli::Cli;
use config::Config;
use report::exit::{BadInput, Verdict};

/// `tvc`: carries out the command line of this process.
pub fn main() -> ExitCode {
    let mut words = env::args_os();
    let name = words.next();
    let (words, renamed) = renamed::present(words.collect());
    for what in renamed {
        eprintln!("note: {what}");
    }
    let words = name.into_iter().chain(words).collect();
    carry_out(cli::command(), words, |cli: Cli| cli.command.run())
}

/// Parses a command line with the configuration's defaults, and runs it.
pub fn carry_out<C: FromArgMatches>(
    command: clap::Command,
    words: Vec<OsString>,
    run: impl FnOnce(C) -> anyhow::Result<Verdict>,
) -> ExitCode {
    // In `tvc ... | head` the reader ends first, which is no error.
    #[cfg(unix)]
    sigpipe::reset();
    let config = Config::load(&config::files()).map_err(BadInput::new);
    let command = config.as_ref().unwrap_or(&Config::default()).apply(command);
    let parsed = command.try_get_matches_from(words);
    let parsed = parsed.and_then(|found| C::from_arg_matches(&found));
    report::exit::exit_code(match (parsed, config) {
        (Err(error), _) if !error.use_stderr() => error.exit(),
        (Err(error), _) => Err(usage(&error).into()),
        (Ok(_), Err(error)) => Err(error.into()),
        (Ok(cli), Ok(_)) => run(cli),
    })
}

/// The command line parser's complaint as one line: its first paragraph, which may list the values
/// that would be accepted, and the name that may have been meant.
fn usage(error: &clap::Error) -> BadInput {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return BadInput::new("a command is missing (see --help)");
    }
    if let Some(moved) = renamed::moved(error) {
        return BadInput::new(moved);
    }
    let text = error.to_string();
    let what: Vec<_> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
    let tip = text.lines().map(str::trim).find_map(|line| {
        // Other tips are about names that begin with a dash.
        line.strip_prefix("tip: ").filter(|tip| tip.contains("similar"))
    });
    let tip = tip.map_or(String::new(), |tip| format!("; {tip}"));
    BadInput::new(format!("{}{tip} (see --help)", what.join(" ").trim_start_matches("error: ")))
}
