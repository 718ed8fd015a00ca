//! `lab`: what maintainers measure.

#![forbid(unsafe_code)]

use std::env;
use std::process::ExitCode;

use clap::CommandFactory;
use lab::Lab;

fn main() -> ExitCode {
    ground::carry_out(Lab::command(), env::args_os().collect(), Lab::run)
}
