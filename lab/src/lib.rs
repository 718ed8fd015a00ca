//! The laboratory: what maintainers measure on the image and the filters. Its commands are started
//! by `cargo lab`.

#![forbid(unsafe_code)]
#![allow(
    rustdoc::private_intra_doc_links,
    missing_docs,
    unreachable_pub,
    clippy::missing_errors_doc,
    reason = "shared by the programs of this tree alone: `pub` marks what a module offers to others"
)]

pub mod cycles;
pub mod faults;
mod functions;
pub mod hardware;
pub mod profile;
pub mod stack;

use ::report::exit::Verdict;
use clap::{Parser, Subcommand};

/// Measure the image and the filters of tvc-nano, for who maintains them.
#[derive(Debug, Parser)]
#[command(name = "lab", version, about, max_term_width = 100)]
pub struct Lab {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of the laboratory.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Find the worst case of the stack from the calls of an image.
    Stack(stack::Stack),
    /// Say where the cycles of an image go, by function.
    Profile(profile::Profile),
    /// Measure cycles, code and stack of the filters, of other AHRS crates, or of a control law.
    Cycles(cycles::Cycles),
    /// Fail sensor and cable at random instants of a flight, and count how it ends.
    Faults(faults::Faults),
    /// Fly the image with chips, sensors and computers that differ, and print one table.
    Hardware(hardware::HardwareCampaign),
}

impl Lab {
    /// Carries out the command.
    ///
    /// # Errors
    /// Whatever the command reports.
    pub fn run(self) -> anyhow::Result<Verdict> {
        match self.command {
            Command::Stack(options) => stack::run(&options),
            Command::Profile(options) => profile::run(&options),
            Command::Cycles(options) => cycles::run(&options),
            Command::Faults(options) => faults::run(&options),
            Command::Hardware(options) => hardware::run(&options),
        }
    }
}
