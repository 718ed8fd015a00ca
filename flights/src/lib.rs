//! Flights as a log or the rig has them: telemetry logs, the figures of a release, what is required
//! of it, and files of the vehicle's parameters.

#![forbid(unsafe_code)]
#![allow(
    rustdoc::private_intra_doc_links,
    missing_docs,
    unreachable_pub,
    clippy::missing_errors_doc,
    reason = "shared by the programs of this tree alone: `pub` marks what a module offers to others"
)]

pub mod arguments;
pub mod figures;
pub mod log;
pub mod param_file;
pub mod requirements;
