//! What commands share: how they read arguments and files, carry out many runs, and hand over
//! figures, tables, plots, pages, files and their exit status.

#![forbid(unsafe_code)]
#![allow(
    rustdoc::private_intra_doc_links,
    missing_docs,
    unreachable_pub,
    clippy::missing_errors_doc,
    reason = "shared by the programs of this tree alone: `pub` marks what a module offers to others"
)]

pub mod arguments;
pub mod campaign;
pub mod distribution;
pub mod exit;
pub mod file;
pub mod gauge;
pub mod input;
pub mod kind;
pub mod measure;
pub mod page;
pub mod plot;
pub mod progress;
pub mod table;
