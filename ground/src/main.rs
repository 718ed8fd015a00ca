//! `tvc`: the ground tool.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    ground::main()
}
