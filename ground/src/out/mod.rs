//! What a command hands over: figures, tables, plots, pages, files and its exit status.

pub mod distribution;
pub mod exit;
pub mod file;
pub mod gauge;
pub mod kind;
pub mod measure;
pub mod page;
pub mod plot;
pub mod table;
