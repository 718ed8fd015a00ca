//! `tvc model`: the physics, simulated and made linear, and a rocket's margins.

mod linear;
mod margins;
mod options;
mod simulate;
mod what_if;

pub use options::{Linear, Margins, Model, ModelCommand, Simulate, WhatIf};
use report::exit::Verdict;

/// Carries out what `options` say.
pub fn run(options: &Model) -> anyhow::Result<Verdict> {
    match &options.command {
        ModelCommand::Linear(options) => linear::run(options),
        ModelCommand::Margins(options) => margins::run(options),
        ModelCommand::Simulate(options) => simulate::run(options),
        ModelCommand::WhatIf(options) => what_if::run(options),
    }
}
