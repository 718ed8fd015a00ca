//! What a command hands over: figures, tables, plots, pages, files and its exit status.

#![forbid(unsafe_code)]
#![allow(
    rustdoc::private_intra_doc_links,
    missing_docs,
    unreachable_pub,
    clippy::missing_errors_doc,
    reason = "shared by the programs of this tree alone: `pub` marks what a module offers to others"
)]

pub mod distribution;
pub mod exit;
pub mod file;
pub mod gauge;
pub mod kind;
pub mod measure;
pub mod page;
pub mod plot;
pub mod table;
