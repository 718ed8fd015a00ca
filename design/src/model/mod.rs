//! `tvc model`: the drone's physics, simulated and made linear.

mod linear;
mod options;
mod simulate;
mod what_if;

use std::path::Path;

pub use options::{Linear, Model, ModelCommand, Simulate, WhatIf};
use report::exit::{BadInput, Verdict};
use report::input;

/// Carries out what `options` say.
pub fn run(options: &Model) -> anyhow::Result<Verdict> {
    match &options.command {
        ModelCommand::Linear(options) => linear::run(options),
        ModelCommand::Simulate(options) => simulate::run(options),
        ModelCommand::WhatIf(options) => what_if::run(options),
    }
}

/// The text of an input file.
fn read(path: &Path) -> Result<String, BadInput> {
    input::text(path).map_err(|error| BadInput::new(format!("{}: {error}", path.display())))
}
