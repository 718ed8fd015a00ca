//! `lab`: what maintainers measure.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    ground::carry_out(lab::Lab::run)
}
