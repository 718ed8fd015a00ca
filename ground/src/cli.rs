//! The command line: what can be said, with examples; a file for each command. Commands are carried
//! out elsewhere, by the module of the same name.

mod flash;
mod fly;
mod model;

pub use flash::Flash;
pub use fly::{Fly, ServoChoice};
pub use model::{Model, ModelCommand, Simulate};

use clap::{Parser, Subcommand};

/// Fly thrust-vector-control firmware on a virtual rig, and put it on the real one.
#[derive(Debug, Parser)]
#[command(name = "tvc", version, about, max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of the tool.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build the image, boot it on the virtual rig and let it bring the drone upright.
    Fly(Fly),
    /// Build the image and put it on a Nano, or write it as a file.
    Flash(Flash),
    /// The drone's physics: simulate a scenario.
    Model(Model),
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
